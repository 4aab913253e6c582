//! The command lines of `hil campaign` and, in [`search`], of `hil search`.

pub mod search;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hil_facts::arguments::BinaryArguments;

/// Examples of the help of `hil campaign`.
pub const EXAMPLES: &str = "\
Examples:
  hil campaign check studies/common-mode.toml
  hil campaign plan studies/common-mode.toml -o runs/common-mode
  hil campaign run runs/common-mode
  hil campaign show runs/common-mode
  hil campaign case runs/common-mode 4711";

/// Arguments of `hil campaign`.
#[derive(Debug, Args)]
pub struct CampaignCommand {
    /// Action on a campaign.
    #[command(subcommand)]
    pub action: CampaignAction,
}

/// The actions on campaigns.
#[derive(Debug, Subcommand)]
pub enum CampaignAction {
    /// Check a study and all its cases; print the number of cases and the time they take
    #[command(after_help = "\
Exit codes: 0 the study can be run; 2 it has an error.

Example:
  hil campaign check studies/common-mode.toml")]
    Check(CheckArguments),
    /// Create the folder of a campaign, with its cases and copies of all files they need
    #[command(
        after_help = "Example:\n  hil campaign plan studies/common-mode.toml -o runs/common-mode"
    )]
    Plan(PlanArguments),
    /// Add draws to a campaign and keep its results
    #[command(after_help = "Example:\n  hil campaign grow runs/common-mode --cases 20000")]
    Grow(GrowArguments),
    /// Run the missing cases on the cores of this machine
    #[command(after_help = "\
After any interruption the same command continues; at most the cases under way are lost.
Exit codes: 0 all cases have a result; 1 two results of a case differ, or a goal of the study is
not met; 3 cases were set aside, or the campaign could not continue.

Example:
  hil campaign run runs/common-mode --jobs 4")]
    Run(RunCampaignArguments),
    /// Run the missing cases on a cluster
    #[command(after_help = "\
Submits job arrays over the shards without a result; arguments after -- go to sbatch. Given again,
the command submits only the missing shards.

Example:
  hil campaign submit runs/common-mode --slurm -- --partition short --time 30")]
    Submit(SubmitArguments),
    /// Run shards until none is free: the worker that `run` and `submit` start
    #[command(after_help = "\
Examples:
  hil campaign work runs/common-mode
  hil campaign work runs/common-mode --shards 0-9,12
  seq 0 99 | parallel runs/common-mode/programs/hil campaign work runs/common-mode --shards {}")]
    Work(WorkArguments),
    /// Show the progress: cases done, missing and under way
    #[command(
        after_help = "Examples:\n  hil campaign status runs/common-mode\n  hil campaign status runs/common-mode --watch"
    )]
    Status(StatusArguments),
    /// Join all results into one Parquet table, with a digest of its rows
    #[command(after_help = "Example:\n  hil campaign collect runs/common-mode")]
    Collect(CollectArguments),
    /// Show the outcome of a campaign: probabilities with bounds, margins, worst cases
    #[command(after_help = "\
Exit codes: 0 every goal of the study is met; 1 a goal is not met; 3 cases are missing.

Example:
  hil campaign show runs/common-mode")]
    Show(ShowArguments),
    /// Run one case again, with a recording
    #[command(after_help = "\
Exit codes: those of hil run; 1 also if the digest differs from that of the campaign.

Example:
  hil campaign case runs/common-mode 4711 --out runs/worst")]
    Case(CaseArguments),
    /// Compare two campaigns case by case: changed verdicts and their significance
    #[command(after_help = "Example:\n  hil campaign compare runs/before runs/after")]
    Compare(CompareCampaignArguments),
    /// Run a scenario at the points that standard input lists, for the Python package
    #[command(hide = true)]
    Points(PointsArguments),
}

/// Arguments of `hil campaign points`.
#[derive(Debug, Args)]
pub struct PointsArguments {
    /// The scenario
    #[arg(value_name = "SCENARIO.toml")]
    pub scenario: PathBuf,
    /// Change a value of the scenario at every point
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Arguments of `hil campaign check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// The study
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// Programs of the cases
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    /// Study to plan
    #[command(flatten)]
    pub check: CheckArguments,
    /// Folder to create; an existing folder must be empty [default: runs/STUDY]
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `hil campaign grow`.
#[derive(Debug, Args)]
pub struct GrowArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// New total number of draws, as `cases` in the study
    #[arg(long, value_name = "N", required = true)]
    pub cases: u64,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign run`.
#[derive(Debug, Args)]
pub struct RunCampaignArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Number of parallel workers [default: one per core; half as many with programs of your own]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub jobs: Option<u32>,
    /// Retry cases that were set aside
    #[arg(long)]
    pub again: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign submit`.
#[derive(Debug, Args)]
pub struct SubmitArguments {
    /// The campaign's folder, on a file system that the nodes share
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Submit to Slurm with sbatch
    #[arg(long, required = true)]
    pub slurm: bool,
    /// Target duration of an array task, in s
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0)]
    pub task_s: f64,
    /// Print the command and submit nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Options of sbatch
    #[arg(last = true, value_name = "SBATCH OPTIONS")]
    pub options: Vec<String>,
}

/// Arguments of `hil campaign work`.
#[derive(Debug, Args)]
pub struct WorkArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Run only these shards, for example 0-9,12 [default: all without a result]
    #[arg(long, value_name = "LIST", conflicts_with = "task")]
    pub shards: Option<String>,
    /// Run only this part of the shards, for example 0/16 for the first of 16
    #[arg(long, value_name = "K/N")]
    pub task: Option<String>,
    /// Also take shards that other workers have claimed
    #[arg(long)]
    pub ignore_claims: bool,
    /// Write a line for each case to standard output
    #[arg(long)]
    pub tell: bool,
    /// End with standard input
    #[arg(long, hide = true)]
    pub leash: bool,
}

/// Arguments of `hil campaign status`.
#[derive(Debug, Args)]
pub struct StatusArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Repeat every second until no case is missing
    #[arg(long)]
    pub watch: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign collect`.
#[derive(Debug, Args)]
pub struct CollectArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Collect the available results even if cases are missing
    #[arg(long)]
    pub partial: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign show`.
#[derive(Debug, Args)]
pub struct ShowArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign case`.
#[derive(Debug, Args)]
pub struct CaseArguments {
    /// The campaign's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Number of the case
    #[arg(value_name = "CASE")]
    pub case: u64,
    /// Folder for the run; an existing folder must be empty [default: runs/SCENARIO-TIME-SESSION]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Run the case in one process
    #[arg(long)]
    pub in_process: bool,
    /// Run nothing; print the case as a scenario
    #[arg(long, conflicts_with_all = ["out", "in_process", "json"])]
    pub show: bool,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil campaign compare`.
#[derive(Debug, Args)]
pub struct CompareCampaignArguments {
    /// Earlier campaign
    #[arg(value_name = "A")]
    pub first: PathBuf,
    /// Campaign to compare with A
    #[arg(value_name = "B")]
    pub second: PathBuf,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
