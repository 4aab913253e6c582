//! The plant emulator, which replaces the hardware.
//!
//! One step, as [`engine`] runs it:
//!
//! 1. [`faults`] advances the parameters to step `k`.
//! 2. The [`plant`] is measured, [`instruments`] turn its readings into sensed values, [`stimulus`] gives the reference
//!    signals, and the sample is sent.
//! 3. While the controller works, the record of step `k - 1` is published.
//! 4. The command of step `k` arrives and passes its faults and instruments; [`guard`] checks the truth under it.
//! 5. [`integrate`] advances the model in [`models`] to step `k + 1`; [`rows`] writes the record.
//!
//! `checkpoint` is the saved state from which a run can resume. Requests from other terminals arrive through [`live`],
//! which checks faults, changes, marks and pauses, and wait in [`request_queue`]; `engine::requests` serves them. A
//! change waits in [`tuning`], which creates its event when the change takes effect. `engine::handover` applies the
//! policy for a lost controller and hands over to its successor. [`job`] describes the work, and [`repeat`] repeats a
//! real-time run in lockstep.
//!
//! [`program`] is the surrounding process; a user's own plant binary is a one-line `main` that calls
//! [`program::run`].
//! Control laws are unknown here.

mod checkpoint;
pub mod engine;
pub mod faults;
pub mod guard;
mod inputs;
pub mod instruments;
pub mod integrate;
pub mod job;
pub mod live;
mod local;
pub mod models;
pub mod plant;
pub(crate) mod probe;
pub mod program;
pub mod repeat;
pub mod request_queue;
pub mod rows;
pub mod tuning;

pub use hil_config::stimulus;
