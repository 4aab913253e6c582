//! The controller: what later runs on the target hardware unchanged.
//!
//! One step, as [`runner`] runs it:
//!
//! 1. The sample of step `k` comes.
//! 2. The [`controller`], one of the [`laws`] or a user's own, computes its command from the
//!    sample; it knows no other clock.
//! 3. Command and internals go back in one frame.
//!
//! [`program`] is the process around it; a user's own controller binary is a `main` of one line that
//! calls [`program::run`]. [`job`] is what is to be done. No plant's code is used here: a law knows plant,
//! signals and units by name, and its own model of them.

pub mod controller;
pub mod job;
pub mod laws;
pub mod program;
pub mod runner;
