//! The command line of `hil report`.

use std::path::PathBuf;

use clap::Args;

use super::runs::run_path;

pub(super) const EXAMPLES: &str = "\
One HTML file that needs no network: plots that zoom and share a cursor, faults shaded, requirements with
their margins, latency, and where it all comes from. Several runs are laid over each other. A scenario says
with [[plots]] what its report begins with; every other signal can be added on the page.

The folder of a campaign gives a page of all its cases: probabilities, margins over the varied values, and a
map of pass and fail. Dragging over a plot selects cases in all plots.

Exit codes: 0 written; 2 no such run or signal, the file is there already or cannot be made there, or a
run is damaged: then the page shows what can be had of it; 3 it cannot be written to its end.

Examples:
  hil report runs/demo
  hil report runs/pid runs/nrsc runs/ftsc -o laws.html
  hil report runs/demo --signal 'truth.*_pa' --force
  hil report runs/common-mode -o campaign.html
  hil report runs/old --scenario scenarios/severe-leakage.toml";

/// Arguments of `hil report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArguments {
    /// Folders of runs or their run.mcap, or latest; or the folder of one campaign
    #[arg(value_name = "RUN", value_parser = run_path(), required = true)]
    pub runs: Vec<PathBuf>,
    /// The file to write; - is standard output
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    pub output: PathBuf,
    /// Plot a signal, or several with * and ?, besides those chosen; may be given several times
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// Take derived signals, metrics, requirements and plots from this scenario [default: each run's own]
    #[arg(long, value_name = "SCENARIO.toml")]
    pub scenario: Option<PathBuf>,
    /// Write over a file that is there
    #[arg(long)]
    pub force: bool,
    /// Print what was written as JSON
    #[arg(long)]
    pub json: bool,
}
