//! Faults as a layer around the plant and the link: the models know nothing of them.
//!
//! [`layer`] is what the engine calls; it keeps every fault of the run, brings each to hold at its
//! step and ends it. What a fault does is a [`kind`]; the built-in ones are in [`kinds`], and a
//! binary may add its own. A [`profile`] is the course of a fault's size.

pub mod kind;
pub mod layer;

pub use kind::{Fault, FaultKind, FaultKindEntry};
pub use layer::FaultLayer;
