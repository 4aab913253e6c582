//! A rig behind a port as the plant of a run.
//!
//! One step:
//!
//! 1. [`PortModel`](model::PortModel) takes all frames that have arrived from its [media](media) and gives the newest
//!    valid values to the engine; those that are older than `stale_s` are invalid.
//! 2. The controller answers, as with any plant.
//! 3. The command is packed and sent.
//!
//! The [keeper](keeper), a process of its own, waits for the end of all that and sends the safe values.
//! Nothing is simulated here, and no clock is read but for the wait for the peer.

pub mod description;
pub mod keeper;
pub mod media;
pub mod model;
pub mod program;
