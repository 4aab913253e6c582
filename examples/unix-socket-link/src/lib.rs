//! A link of one's own: plant and controller over UNIX sockets.
//!
//! [`link`] is all that a link must be; `tests/conformance.rs` holds it against the sentences that every link
//! keeps. [`run`] is a plant and a law in lockstep over any link.

pub mod link;
pub mod run;
mod socket;
