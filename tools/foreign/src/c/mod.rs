//! The C interface, as declared in `include/hil.h`.
//!
//! 1. `main` of a C program calls [`hil_plant_main`](program::hil_plant_main) or
//!    [`hil_controller_main`](program::hil_controller_main) with a struct of [`interface`].
//! 2. `tables` reads the struct's tables once, before anything starts, and reports the first error by name.
//! 3. [`plant`] and [`law`] call its functions at each step, with `memory` for its state.
//! 4. A function that fails stores its reason with [`reason`], and ends the run like a failure in Rust.
//!
//! [`mathematics`] provides functions with the same last bit on every machine, and the integrator. No panic crosses
//! into C: a panicking program ends like one in Rust, and anything else aborts with a message.

pub mod interface;
pub mod law;
pub mod mathematics;
mod memory;
pub mod plant;
pub mod program;
pub mod reason;
mod tables;
