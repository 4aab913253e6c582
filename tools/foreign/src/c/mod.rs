//! The C interface: what `include/hil.h` declares.
//!
//! 1. `main` of a program in C is a call of [`hil_plant_main`](program::hil_plant_main) or
//!    [`hil_controller_main`](program::hil_controller_main) with a struct of [`interface`].
//! 2. `tables` reads its tables once, before anything starts, and refuses the first mistake by name.
//! 3. [`plant`] and [`law`] call its functions at each step over `memory` of its own.
//! 4. A function that fails keeps its reason in [`reason`]; it ends the run as that of Rust would.
//!
//! [`mathematics`] has functions whose last bit is the same everywhere, and the integrator. No panic leaves a
//! function that C calls: a program that panics ends as one of Rust does, and all else aborts with a message.

pub mod interface;
pub mod law;
pub mod mathematics;
mod memory;
pub mod plant;
pub mod program;
pub mod reason;
mod tables;
