//! Latency of a loop: the recorder, or a reader of its recording, adds each step to [`Latency`](legs::Latency); the
//! [`times`] of its [`legs`] become [`percentiles`], the ten worst [`spikes`] and a [`grade`] in the summary.

pub mod grade;
pub mod legs;
pub mod percentiles;
pub mod places;
pub mod spikes;
pub mod times;
