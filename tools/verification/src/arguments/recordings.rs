//! The command lines of the verbs that read recordings: `hil compare`, `hil judge` and `hil scenario`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hil_console::files::runs::run_path;

use crate::arguments::tolerance::Tolerance;

/// Arguments of `hil compare`.
#[derive(Debug, Args)]
pub struct CompareArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "A", value_parser = run_path())]
    pub a: PathBuf,
    /// Run to compare with A
    #[arg(value_name = "B", value_parser = run_path(), required_unless_present = "baseline")]
    pub b: Option<PathBuf>,
    /// Compare with this named run instead, within its own tolerances
    #[arg(long, value_name = "NAME", conflicts_with_all = ["b", "tolerance", "signal"])]
    pub baseline: Option<String>,
    /// File of named runs
    #[arg(long, value_name = "FILE", default_value = "baselines.toml")]
    pub baselines: PathBuf,
    /// Show the changes of the named run and write them; tolerances and comments stay
    #[arg(long, requires = "baseline", conflicts_with = "b")]
    pub update: bool,
    /// Show the changes that --update would write, and write nothing; exit code 1 if there are any
    #[arg(long, requires = "update")]
    pub dry_run: bool,
    /// Largest difference that counts as the same, in the signal's own unit, for all signals or for one; may
    /// be given several times
    #[arg(long, value_name = "[SIGNAL=]X", allow_hyphen_values = true)]
    pub tolerance: Vec<Tolerance>,
    /// Compare only this signal; may be given several times
    #[arg(long, value_name = "GROUP.NAME")]
    pub signal: Vec<String>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Examples in the help of `hil judge`.
pub const JUDGE_EXAMPLES: &str = "\
Exit codes: 0 every requirement holds; 1 one fails, or the run did not end by itself; 2 the run or
the scenario cannot be used.

Examples:
  hil judge runs/demo
  hil judge runs/demo --requirements scenarios/severe-leakage.toml
  hil judge runs/demo/run.mcap --json";

/// Arguments of `hil judge`.
#[derive(Debug, Args)]
pub struct JudgeArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
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

/// Actions of `hil scenario`.
#[derive(Debug, Subcommand)]
pub enum ScenarioAction {
    /// Write the scenario that repeats a run, including faults injected from the command line
    #[command(
        after_help = "Example:\n  hil scenario from runs/demo -o scenarios/found.toml\n  hil run scenarios/found.toml"
    )]
    From(ScenarioFromArguments),
}

/// Arguments of `hil scenario from`.
#[derive(Debug, Args)]
pub struct ScenarioFromArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// File to write [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}
