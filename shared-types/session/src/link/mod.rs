//! The link between plant and controller over iceoryx2 shared memory.
//!
//! [`iceoryx`] is the link, [`bell`] ends the sleep of a side, [`service`] is the common base of both, and [`bare`] is
//! the same exchange without frames, for benchmarks. Like every link, it knows nothing of steps.

pub mod bare;
pub mod bell;
pub mod iceoryx;
pub mod service;

#[cfg(test)]
mod tests;
