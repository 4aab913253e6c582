//! The command line of `hil export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use hil_console::files::runs::run_path;
use hil_console::terminal::duration::seconds;

/// Text behind the options in the help of `hil export`.
pub const EXAMPLES: &str = "\
Values are those of the picked steps: --every skips steps and filters nothing. A recording that
was cut off is exported as far as it goes, with a note.

Exit codes: 0 exported; 2 no such run, signal or window, or the file exists or cannot be created;
3 the file cannot be written completely.

Examples:
  hil export runs/demo --list
  hil export runs/demo -o demo.parquet
  hil export runs/demo -o demo.csv --signal 'truth.*' --signal tracking_error_rad --from 7s
  hil export runs/demo --signal truth.surface_angle_rad --every 100 | head
  hil export runs/* --evidence evidence --needs requirements.csv";

/// Arguments of `hil export`.
#[derive(Debug, Args)]
pub struct ExportArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs; several only with --evidence
    #[arg(value_name = "RUN", required = true, value_parser = run_path())]
    pub runs: Vec<PathBuf>,
    /// File to write, or - for standard output [default: -]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Format [default: by the file's extension; csv on standard output]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<ExportFormat>,
    /// Signal name, or a pattern with * and ?; may be given several times [default: all signals]
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// First simulated time, included
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub from: Option<f64>,
    /// Last simulated time, included
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub until: Option<f64>,
    /// Export the first step and every N-th step after it, without filtering
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Add a column with the validity mark after each signal that was sent
    #[arg(long)]
    pub validity: bool,
    /// Write what the runs show about their requirements to this folder: evidence.csv, junit.xml and needs.json
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["output", "format", "signal", "from", "until", "every", "validity", "list"])]
    pub evidence: Option<PathBuf>,
    /// Requirements that the runs are to verify: needs.json of sphinx-needs, or CSV with the columns id and title
    #[arg(long, value_name = "FILE", requires = "evidence")]
    pub needs: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    /// List the signals that can be exported, or those that --signal selects, with units; write no file
    #[arg(long, conflicts_with_all = ["output", "format", "force"])]
    pub list: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// Formats of an exported table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Comma-separated values, a line per step.
    Csv,
    /// Apache Parquet, with units and provenance in its metadata.
    Parquet,
}

impl ExportFormat {
    /// Returns the name, which is also the file extension.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }
}
