//! Faults as a layer around the plant and the link: the models know nothing of them.
//!
//! [`layer`] is what the engine calls; it keeps every fault of the run, brings each to hold at its
//! step and ends it. Faults are made in the [`workshop`], away from the loop. What a fault does is a
//! [`kind`]; a binary may add its own. A [`profile`] is the course of a fault's size.

mod channel;
mod effect;
pub mod kind;
pub mod kinds;
pub mod layer;
pub mod profile;
pub mod workshop;

pub use kind::{Fault, FaultKind, FaultKindEntry};
pub use layer::{Admitted, FaultLayer};
pub use workshop::{FaultWorkshop, Prepared};
