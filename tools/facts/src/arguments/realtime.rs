//! Flags for `[realtime]`.

use clap::{Args, ValueEnum};
use shared_types::wait::WaitStrategy;

/// Real-time settings; each is a key of `[realtime]`.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Real time")]
pub struct RealtimeArguments {
    /// Pin the plant's loop to this core
    #[arg(long, value_name = "CORE")]
    pub plant_core: Option<u32>,
    /// Pin the controller's loop to this core
    #[arg(long, value_name = "CORE")]
    pub controller_core: Option<u32>,
    /// Pin the recorder to this core
    #[arg(long, value_name = "CORE")]
    pub recorder_core: Option<u32>,
    /// SCHED_FIFO priority of both loops, 1 to 98; 0 for ordinary scheduling
    #[arg(long, value_name = "PRIORITY")]
    pub priority: Option<u32>,
    /// Lock the memory of plant and controller in RAM
    #[arg(long)]
    pub lock_memory: bool,
    /// Load all memory of plant and controller into RAM before step 0
    #[arg(long)]
    pub prefault: bool,
    /// Longest allowed wake-up time of a core during the run, in us
    #[arg(long, value_name = "US")]
    pub dma_latency: Option<u32>,
    /// Waiting strategy of both sides
    #[arg(long, value_enum, value_name = "HOW")]
    pub wait: Option<WaitKind>,
}

/// Waiting strategy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WaitKind {
    /// Poll, then yield the core or sleep, depending on earlier waits.
    Hybrid,
    /// Poll and never yield the core.
    Spin,
    /// Yield the core after each poll.
    Yield,
    /// Sleep until the other side sends.
    Sleep,
}

impl From<WaitKind> for WaitStrategy {
    fn from(kind: WaitKind) -> Self {
        match kind {
            WaitKind::Hybrid => Self::Hybrid,
            WaitKind::Spin => Self::Spin,
            WaitKind::Yield => Self::Yield,
            WaitKind::Sleep => Self::Sleep,
        }
    }
}

impl RealtimeArguments {
    /// Returns the given settings as `KEY=VALUE`.
    pub(crate) fn as_set(&self) -> impl Iterator<Item = String> {
        let number = |value: Option<u32>| value.map(|value| value.to_string());
        let flag = |is_set: bool| is_set.then(|| "true".to_owned());
        let wait = self.wait.map(|wait| WaitStrategy::from(wait).name().into());
        let all = [
            ("plant_core", number(self.plant_core)),
            ("controller_core", number(self.controller_core)),
            ("recorder_core", number(self.recorder_core)),
            ("priority", number(self.priority)),
            ("lock_memory", flag(self.lock_memory)),
            ("prefault", flag(self.prefault)),
            ("dma_latency_us", number(self.dma_latency)),
            ("wait", wait),
        ];
        (all.into_iter()).filter_map(|(key, value)| Some(format!("realtime.{key}={}", value?)))
    }
}
