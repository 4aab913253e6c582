//! Changes of values that are asked for while a run goes on: a request to a checked change.
//!
//! Used by the plant's service for requests from a command line or a panel. The keys and values are checked
//! by the code for the `[[changes]]` of a scenario.

pub use crate::check::LiveChanges;
