//! Faults as a layer around the plant and the link: the models are unaware of them.
//!
//! A fault is an event with one or more effects, each on one target:
//!
//! 1. The [`builder`] creates the fault outside the loop, with everything it needs. The effect on a target is defined
//!    by a [`kind`]; the built-in kinds are in [`kinds`], and a binary may add its own.
//! 2. The [`layer`], which the engine calls at every step, admits the fault.
//! 3. The `schedule` determines the steps at which the fault begins and ends.
//! 4. In between, each `effect` acts on its target: the plant's `parameters`, the signals or the link of a
//!    `signal_path` (whose medium is a `channel` with its `arrivals`, or a [`Bus`] of frames), or the `timing`. Its [`profile`] gives the
//!    course.

mod arrivals;
pub mod builder;
mod bus;
mod channel;
mod effect;
pub mod kind;
pub mod kinds;
pub mod layer;
mod parameters;
pub mod profile;
mod schedule;
mod signal_path;
mod timing;

pub use builder::{ArmedFault, FaultBuilder};
pub use bus::Bus;
pub use kind::{Fault, FaultKind, FaultKindEntry};
pub use layer::{Admitted, FaultLayer, SavedFaults};

#[cfg(test)]
mod tests;
