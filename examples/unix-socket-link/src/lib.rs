//! A custom link: plant and controller over UNIX sockets.
//!
//! [`link`] is a complete link; `tests/conformance.rs` checks the properties that every link must have. [`run`]
//! executes a plant and a law in lockstep over any link.

pub mod link;
pub mod run;
mod socket;
