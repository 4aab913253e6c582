//! The command line of `hil export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::runs::run_path;
use crate::terminal::duration::seconds;

pub(super) const EXAMPLES: &str = "\
Values are those of the picked steps: --every leaves steps out and filters nothing. A recording that
was cut off is exported as far as it goes, with a note.

Exit codes: 0 exported; 2 no such run, signal or window, or the file is there already or cannot be made
there; 3 it cannot be written to its end.

Examples:
  hil export runs/demo --list
  hil export runs/demo -o demo.parquet
  hil export runs/demo -o demo.csv --signal 'truth.*' --signal tracking_error_rad --from 7s
  hil export runs/demo --signal truth.surface_angle_rad --every 100 | head";

/// Arguments of `hil export`.
#[derive(Debug, Args)]
pub struct ExportArguments {
    /// A run's folder or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// The file to write; - is standard output, which is the default
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Format [default: the ending of the file's name, on standard output csv]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<ExportFormat>,
    /// A signal, or several with * and ?; may be given several times [default: all signals]
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// The first simulated time, which belongs to it
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub from: Option<f64>,
    /// The last simulated time, which belongs to it
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub until: Option<f64>,
    /// Pick the first step and then each N-th; no filter
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// After each signal that was sent, whether it was marked as valid
    #[arg(long)]
    pub validity: bool,
    /// Write over a file that is there
    #[arg(long)]
    pub force: bool,
    /// List what can be exported, or what of it --signal chooses, with units, and write no file
    #[arg(long, conflicts_with_all = ["output", "format", "force"])]
    pub list: bool,
    /// Print what was done as JSON
    #[arg(long)]
    pub json: bool,
}

/// Forms of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Text with a line for each step.
    Csv,
    /// Apache Parquet, with units and origin in its metadata.
    Parquet,
}

impl ExportFormat {
    /// Returns the name, which is also the ending of files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }
}
