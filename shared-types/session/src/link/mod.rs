//! The link between plant and controller over iceoryx2 shared memory.
//!
//! [`iceoryx`] is the link, [`bell`] what ends a sleep of its sides, [`service`] what both stand on, [`bare`] the
//! same exchange without frames for benchmarks. It knows no step, as no link does.

pub mod bare;
pub mod bell;
pub mod iceoryx;
pub mod service;

#[cfg(test)]
mod tests;
