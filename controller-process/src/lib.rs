//! The controller, which later runs unchanged on the target hardware.
//!
//! One step, as [`runner`] runs it:
//!
//! 1. The sample of step `k` arrives.
//! 2. The [`controller`], one of the [`laws`] or a user's own, computes its command from the sample, which is its only
//!    clock.
//! 3. Command and internals go back in one frame.
//!
//! [`program`] is the surrounding process; a user's own controller binary is a `main` of one line that calls
//! [`program::run`]. [`job`] describes the work. No plant's code is used here: a law refers to plant, signals and units
//! by name, and has its own model of them.

pub mod controller;
pub mod job;
pub mod laws;
pub mod program;
pub mod runner;
