//! The latency of a loop: the recorder, or a reader of its recording, puts each step into [`Latency`](legs::Latency); its
//! [`legs`] are [`times`] that become [`percentiles`], the ten worst [`spikes`] and a [`grade`] in the summary.

pub(crate) mod grade;
pub(crate) mod legs;
pub(crate) mod percentiles;
pub(crate) mod places;
pub(crate) mod spikes;
pub(crate) mod times;
