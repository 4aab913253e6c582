//! The command lines of what works on recordings: `hil compare`, `hil judge` and `hil scenario`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::runs::run_path;
use crate::arguments::tolerance::Tolerance;

/// Arguments of `hil compare`.
#[derive(Debug, Args)]
pub struct CompareArguments {
    /// A run's folder or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "A", value_parser = run_path())]
    pub a: PathBuf,
    /// Another
    #[arg(value_name = "B", value_parser = run_path(), required_unless_present = "baseline")]
    pub b: Option<PathBuf>,
    /// Compare with this named run instead, with the tolerances that it has
    #[arg(long, value_name = "NAME", conflicts_with_all = ["b", "tolerance", "signal"])]
    pub baseline: Option<String>,
    /// The file of named runs
    #[arg(long, value_name = "FILE", default_value = "baselines.toml")]
    pub baselines: PathBuf,
    /// Show what changes in the named run and write it; tolerances and comments stay
    #[arg(long, requires = "baseline", conflicts_with = "b")]
    pub update: bool,
    /// Show what --update would write, and write nothing; exit code 1 if something would change
    #[arg(long, requires = "update")]
    pub dry_run: bool,
    /// Signals that differ by no more than this, in their own unit, count as the same: all of them,
    /// or one; may be given several times
    #[arg(long, value_name = "[SIGNAL=]X", allow_hyphen_values = true)]
    pub tolerance: Vec<Tolerance>,
    /// Look at this signal only; may be given several times
    #[arg(long, value_name = "GROUP.NAME")]
    pub signal: Vec<String>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// The examples of `hil judge`.
pub(crate) const JUDGE_EXAMPLES: &str = "\
Exit codes: 0 every requirement holds; 1 one does not, or the run did not end by itself; 2 the run or
the scenario cannot be used.

Examples:
  hil judge runs/demo
  hil judge runs/demo --requirements scenarios/severe-leakage.toml
  hil judge runs/demo/run.mcap --json";

/// Arguments of `hil judge`.
#[derive(Debug, Args)]
pub struct JudgeArguments {
    /// A run's folder or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// Take derived signals, metrics and requirements from this scenario [default: the run's own]
    #[arg(long, value_name = "SCENARIO.toml")]
    pub requirements: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil scenario`.
#[derive(Debug, Args)]
pub struct ScenarioCommand {
    /// Action.
    #[command(subcommand)]
    pub action: ScenarioAction,
}

/// The parts of `hil scenario`.
#[derive(Debug, Subcommand)]
pub enum ScenarioAction {
    /// Write the scenario that repeats a run, the faults of its command lines included
    #[command(
        after_help = "Example:\n  hil scenario from runs/demo -o scenarios/found.toml\n  hil run scenarios/found.toml"
    )]
    From(ScenarioFromArguments),
}

/// Arguments of `hil scenario from`.
#[derive(Debug, Args)]
pub struct ScenarioFromArguments {
    /// A run's folder or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// The file to write [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}
