//! The latency of a loop: the recorder, or a reader of its recording, puts each step into [`Latency`](legs::Latency).
//! The [`legs`] are collected as [`times`], which become [`percentiles`], the ten worst [`spikes`] and a [`grade`] in
//! the summary, or [`bars`].

pub mod bars;
pub mod grade;
pub mod legs;
pub mod percentiles;
pub mod places;
pub mod spikes;
pub mod times;
