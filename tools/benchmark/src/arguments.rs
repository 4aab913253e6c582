//! The command lines of `hil latency` and of the peer process that it starts.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Subcommand};
use hil_config::plan::Realtime;
use hil_console::files::runs::run_path;
use hil_console::terminal::duration::seconds;
use hil_facts::arguments::realtime::WaitKind;
use shared_types::frame::MAX_SIGNALS;
use shared_types::time::Rate;

/// Text behind the options in the help of `hil latency`.
pub const EXAMPLES: &str = "\
Examples:
  hil latency
  hil latency --signals 32 --rates max --steps 1000000
  hil latency --signals 8,32,128,512 --rates max,1000 --csv latency.csv --json
  hil latency --plant-core 2 --controller-core 3 --wait spin
  hil latency runs/demo";

/// Arguments of `hil latency`.
#[derive(Debug, Args)]
pub struct LatencyArguments {
    /// Folder of a run or its run.mcap, or latest: show the figures of this run instead of measuring
    #[arg(value_name = "RUN", value_parser = run_path(), conflicts_with_all = ["signals", "rates", "steps", "duration"])]
    pub run: Option<PathBuf>,
    /// Number of signals in a sample; a command has half as many
    #[arg(
        long,
        value_name = "COUNTS",
        value_delimiter = ',',
        default_value = "8,32,128",
        value_parser = signals
    )]
    pub signals: Vec<usize>,
    /// Steps per second by the clock; max is lockstep, as fast as both sides can run
    #[arg(
        long,
        value_name = "RATES",
        value_delimiter = ',',
        default_value = "max,1000,10000"
    )]
    pub rates: Vec<Pace>,
    /// Warm-up steps to discard [default: 20000, paced at most 2 s; none for a RUN]
    #[arg(long, value_name = "STEPS")]
    pub warm_up: Option<u64>,
    /// Number of steps measured at rate max
    #[arg(long, value_name = "STEPS", default_value = "200000", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: u64,
    /// Duration of the measurement at each other rate
    #[arg(long, value_name = "TIME", default_value = "5s", value_parser = seconds)]
    pub duration: f64,
    /// Settings of both sides
    #[command(flatten)]
    pub sides: SideArguments,
    /// Write all histograms to this file
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Settings of both sides of a measurement: a subset of the flags of `hil run`.
#[derive(Clone, Copy, Debug, Args)]
#[command(next_help_heading = "Real time")]
pub struct SideArguments {
    /// Pin the plant's loop to this core
    #[arg(long, value_name = "CORE", conflicts_with = "run")]
    pub plant_core: Option<u32>,
    /// Pin the controller's loop to this core
    #[arg(long, value_name = "CORE", conflicts_with = "run")]
    pub controller_core: Option<u32>,
    /// SCHED_FIFO priority of both loops, 1 to 98; 0 for ordinary scheduling
    #[arg(
        long,
        value_name = "PRIORITY",
        default_value = "0",
        value_parser = clap::value_parser!(u32).range(0..=98),
        conflicts_with = "run"
    )]
    pub priority: u32,
    /// Waiting strategy of both sides
    #[arg(
        long,
        value_enum,
        value_name = "HOW",
        default_value = "hybrid",
        conflicts_with = "run"
    )]
    pub wait: WaitKind,
}

impl SideArguments {
    /// Converts the settings to those of a scenario's `[realtime]`.
    #[must_use]
    pub(crate) fn realtime(&self) -> Realtime {
        Realtime {
            plant_core: self.plant_core,
            controller_core: self.controller_core,
            priority: self.priority,
            wait: self.wait.into(),
            ..Realtime::default()
        }
    }
}

/// Pace of the steps of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// Each step follows the answer to the previous one.
    Max,
    /// Steps follow the monotonic clock at this rate.
    Rate(Rate),
}

impl Pace {
    /// Returns the rate, or `None` for [`Pace::Max`].
    #[must_use]
    pub(crate) const fn rate(self) -> Option<Rate> {
        match self {
            Self::Max => None,
            Self::Rate(rate) => Some(rate),
        }
    }
}

impl FromStr for Pace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        let rate = text.parse().ok().and_then(Rate::new);
        let (least, most) = (Rate::MIN_HZ, Rate::MAX_HZ);
        rate.map(Self::Rate)
            .ok_or_else(|| format!("expected max, or a rate from {least} to {most} Hz"))
    }
}

fn signals(text: &str) -> Result<usize, String> {
    let count = text.parse().ok();
    count
        .filter(|count| (1..=MAX_SIGNALS).contains(count))
        .ok_or_else(|| format!("expected 1 to {MAX_SIGNALS} signals"))
}

/// Arguments of the peer process of `hil latency`.
#[derive(Debug, Args)]
pub struct LatencyPeerArguments {
    /// Folder of the measurement's session.
    pub session: PathBuf,
    /// Task of the process.
    #[command(subcommand)]
    pub work: PeerWork,
}

/// Task of the peer process.
#[derive(Clone, Copy, Debug, Subcommand)]
pub enum PeerWork {
    /// Runs the null law.
    Controller {
        /// Number of signals in a sample.
        signals: usize,
    },
    /// Echoes bare payloads.
    Answer {
        /// Number of signals in a frame of the payload's size.
        signals: usize,
        /// Number of round trips.
        trips: u64,
    },
}

impl PeerWork {
    /// Returns the command-line arguments that select this task.
    #[must_use]
    pub(crate) fn arguments(self) -> Vec<String> {
        match self {
            Self::Controller { signals } => vec!["controller".into(), signals.to_string()],
            Self::Answer { signals, trips } => {
                vec!["answer".into(), signals.to_string(), trips.to_string()]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pace_is_max_or_a_rate() {
        assert_eq!("max".parse(), Ok(Pace::Max));
        let rate = Rate::new(1000.0).expect("legal");
        assert_eq!("1000".parse(), Ok(Pace::Rate(rate)));
        for text in ["", "fast", "0", "-1", "nan", "1e9"] {
            assert!(text.parse::<Pace>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_sample_has_1_to_512_signals() {
        assert_eq!((signals("1"), signals("512")), (Ok(1), Ok(512)));
        for text in ["0", "513", "-1", "x"] {
            assert!(signals(text).is_err(), "{text}");
        }
    }
}
