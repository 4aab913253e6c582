//! The command line of `hil report`.

use std::path::PathBuf;

use clap::Args;
use hil_console::files::runs::run_path;

use super::baseline::BaselineChoice;
use super::width::Width;

/// Text behind the options in the help of `hil report`.
pub const EXAMPLES: &str = "\
One HTML file that needs no network: plots that zoom and share a cursor, shaded faults, requirements
with their margins, latency, and the origin of the run. Several runs are overlaid. [[plots]] of a
scenario chooses the first plots of its report; every other signal can be added on the page.

The folder of a campaign gives a page of all its cases: probabilities, margins over the varied
values, and a map of pass and fail. Dragging over a plot selects cases in all plots.

With --figures each plot of the scenario is written as an SVG and a PDF of its own, for a document:
with titles of axes, units and a legend, in the width of a column, the same bytes every time.
captions.tex has their captions in order.

Exit codes: 0 written; 2 no such run, signal or baseline, the file exists or cannot be created, or
a run is damaged: then the page shows its readable part; 3 the file cannot be written completely.

Examples:
  hil report runs/demo
  hil report runs/pid runs/nrsc runs/ftsc -o laws.html
  hil report runs/demo --signal 'truth.*_pa' --force
  hil report runs/demo --where 'abs(tracking_error_rad) > 1e-3'
  hil report runs/new --baseline severe-leakage-ftsc
  hil report runs/common-mode -o campaign.html
  hil report runs/old --scenario scenarios/severe-leakage.toml
  hil report runs/demo --figures paper/figures --width 85mm";

/// Arguments of `hil report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArguments {
    /// Folders of runs or their run.mcap, or latest; or the folder of one campaign
    #[arg(value_name = "RUN", value_parser = run_path(), required = true)]
    pub runs: Vec<PathBuf>,
    /// File to write, or - for standard output
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    pub output: PathBuf,
    /// Write each plot of the scenario as SVG and PDF to this folder, instead of a page
    #[arg(long, value_name = "DIR", conflicts_with_all = ["output", "baseline"])]
    pub figures: Option<PathBuf>,
    /// Width of the figures, in mm, cm, in or pt
    #[arg(long, value_name = "WIDTH", value_parser = Width::parse, default_value = "85mm", requires = "figures")]
    pub width: Width,
    /// Open loops of the plots of kind bode and nichols that name no metric, as hil margins -o writes them
    #[arg(long, value_name = "FILE.csv")]
    pub margins: Option<PathBuf>,
    /// Additional signal to plot, or a pattern with * and ?; may be given several times
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// List the intervals in which this formula holds, and mark them in every plot; may be given several times
    #[arg(long = "where", value_name = "FORMULA", conflicts_with = "figures")]
    pub formulas: Vec<String>,
    /// Baseline behind the curves
    #[command(flatten)]
    pub behind: BaselineChoice,
    /// Take derived signals, metrics, requirements and plots from this scenario [default: each run's own]
    #[arg(long, value_name = "SCENARIO.toml")]
    pub scenario: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}
