//! The far end of a port as the plant of a run: hardware, or a program that nobody here wrote.
//!
//! Order within a step:
//!
//! 1. [`RigModel`](model::RigModel) takes all frames that have arrived and gives the newest valid values to the engine;
//!    those that are older than `stale_s` are invalid.
//! 2. The controller answers, as with any plant.
//! 3. The command is packed and sent.
//!
//! The [keeper](crate::keeper), a process of its own, waits for the end of all that and sends the safe values.
//! Nothing is simulated here, and no clock is read but for the silence of the far end.

pub mod description;
pub mod model;
pub mod program;
pub mod simulated;
