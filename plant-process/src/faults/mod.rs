//! Faults as a layer around the plant and the link: the models know nothing of them.
//!
//! A fault is an event with one or more effects, each on one target:
//!
//! 1. The [`builder`] makes it, away from the loop, with everything it needs. What it does to its
//!    target is a [`kind`]; the built-in ones are in [`kinds`], a binary may add its own.
//! 2. The [`layer`], which the engine calls at every step, takes it.
//! 3. The `schedule` finds the step at which it takes hold and the one at which it ends.
//! 4. Between them each `effect` acts where its target is: on the plant's `parameters`, on the
//!    signals or the link of a `signal_path` (whose `channel` is the medium, with its `arrivals`), or on the
//!    `timing`; by the course of its [`profile`].

mod arrivals;
pub mod builder;
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
pub use kind::{Fault, FaultKind, FaultKindEntry};
pub use layer::{Admitted, FaultLayer, SavedFaults};

#[cfg(test)]
mod tests;
