//! Options of a run.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use hil_console::terminal::duration::seconds;
use hil_console::terminal::exit::Failure;
use hil_recording::compression::Compression;
use shared_types::number::exact;

use crate::arguments::BinaryArguments;
use crate::arguments::checkpoint::CheckpointArguments;
use crate::arguments::realtime::RealtimeArguments;
use crate::arguments::recording::{ChoiceArguments, compression};
use crate::arguments::target::TargetArguments;

/// Options of a run.
#[derive(Clone, Debug, Args)]
pub struct RunOptions {
    /// Changes of the scenario
    #[command(flatten)]
    pub changes: Changes,
    /// Binaries that run
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Machine of the controller
    #[command(flatten)]
    pub target: TargetArguments,
    /// Start of the controller: by hil, or by you with the printed command, in a debugger, an IDE or perf
    #[arg(long, value_enum, default_value_t = StartKind::Launched, value_name = "START")]
    pub controller: StartKind,
    /// Start of the plant: by hil, or by you
    #[arg(long, value_enum, default_value_t = StartKind::Launched, value_name = "START")]
    pub plant: StartKind,
    /// Link between plant and controller
    #[arg(long, value_enum, default_value_t = LinkKind::Iceoryx2, value_name = "LINK")]
    pub link: LinkKind,
    /// Folder for the run; an existing folder must be empty [default: runs/SCENARIO-TIME-SESSION]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the session: a-z, 0-9 and -, at most 24 [default: random]
    #[arg(long, value_name = "NAME")]
    pub session: Option<String>,
    /// Do not write run.mcap; digest and metrics are still computed
    #[arg(long)]
    pub no_record: bool,
    /// Compression of run.mcap
    #[arg(long, value_parser = compression(), default_value = "lz4", value_name = "HOW")]
    pub compression: Compression,
    /// Recorded part of the run
    #[command(flatten)]
    pub choice: ChoiceArguments,
    /// Longest wait for a live process, in s; inf under a debugger
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 5.0,
        allow_negative_numbers = true
    )]
    pub wait_limit: f64,
    /// Hold before the first step at or after this simulated time; continue with hil resume
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub pause_at: Option<f64>,
    /// Checkpoints to make
    #[command(flatten)]
    pub checkpoints: CheckpointArguments,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

/// Changes to a scenario.
#[derive(Clone, Debug, Args)]
pub struct Changes {
    /// Change a value of the scenario; may be given several times, once per value
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Release of each step: by the other side's answer, the monotonic clock, or both
    #[arg(long, value_enum, value_name = "CLOCK")]
    pub clock: Option<ClockKind>,
    /// Simulated seconds per second; implies --clock paced
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    pub pace: Option<f64>,
    /// Settings of the system
    #[command(flatten)]
    pub realtime: RealtimeArguments,
}

impl Changes {
    /// Refuses contradictory options.
    ///
    /// # Errors
    /// If a pace is given with the lockstep clock.
    pub fn check(&self) -> Result<(), Failure> {
        match (self.clock, self.pace) {
            (Some(ClockKind::Lockstep), Some(_)) => Err(Failure::usage(
                "--pace applies only to --clock paced: lockstep runs as fast as both sides can",
            )),
            (Some(ClockKind::Realtime), Some(_)) => Err(Failure::usage(
                "--pace applies only to --clock paced: realtime follows the clock",
            )),
            (_, Some(factor)) if !(factor.is_finite() && factor > 0.0) => Err(Failure::usage(
                format!("--pace must be above 0, not {}", exact(factor)),
            )),
            _ => Ok(()),
        }
    }

    /// Returns all changes as `KEY=VALUE`.
    #[must_use]
    pub fn as_set(&self) -> Vec<String> {
        let mut set = self.set.clone();
        set.extend(self.realtime.as_set());
        let clock = match (self.clock, self.pace) {
            (None, None) => return set,
            (_, Some(_)) | (Some(ClockKind::Paced), None) => "paced",
            (Some(ClockKind::Lockstep), None) => "lockstep",
            (Some(ClockKind::Realtime), None) => "realtime",
        };
        set.push(format!("run.clock={clock}"));
        set.extend(self.pace.map(|factor| format!("run.pace={factor:?}")));
        set
    }
}

/// Link between plant and controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LinkKind {
    /// Two processes over shared memory.
    Iceoryx2,
    /// Threads of hil, for comparison and for large numbers of runs; no process is started.
    InProcess,
}

/// Starter of a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum StartKind {
    /// hil starts it.
    Launched,
    /// You start it by hand.
    External,
}

/// Release of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ClockKind {
    /// The other side's answer: as fast as both sides can run.
    Lockstep,
    /// Both the other side's answer and the monotonic clock.
    Paced,
    /// The monotonic clock: a late command is replaced by the last one.
    Realtime,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::realtime::WaitKind;

    #[test]
    fn a_pace_implies_the_paced_clock() {
        let changes = |clock, pace| {
            Changes {
                set: vec!["a=1".into()],
                clock,
                pace,
                realtime: RealtimeArguments::default(),
            }
            .as_set()
        };
        assert_eq!(changes(None, None), ["a=1"]);
        assert_eq!(
            changes(None, Some(2.0)),
            ["a=1", "run.clock=paced", "run.pace=2.0"]
        );
        assert_eq!(
            changes(Some(ClockKind::Lockstep), None),
            ["a=1", "run.clock=lockstep"]
        );
    }

    #[test]
    fn each_real_time_flag_is_a_key_of_the_scenario() {
        let changes = |realtime| Changes {
            set: vec!["a=1".into()],
            clock: None,
            pace: None,
            realtime,
        };
        let all = RealtimeArguments {
            plant_core: Some(0),
            controller_core: Some(1),
            recorder_core: Some(2),
            priority: Some(80),
            lock_memory: true,
            prefault: true,
            dma_latency: Some(0),
            wait: Some(WaitKind::Spin),
        };
        assert_eq!(
            changes(all).as_set(),
            [
                "a=1",
                "realtime.plant_core=0",
                "realtime.controller_core=1",
                "realtime.recorder_core=2",
                "realtime.priority=80",
                "realtime.lock_memory=true",
                "realtime.prefault=true",
                "realtime.dma_latency_us=0",
                "realtime.wait=spin",
            ]
        );
    }
}
