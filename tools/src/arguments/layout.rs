//! The command line of `hil layout`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::runs::run_path;

pub(super) const EXAMPLES: &str = "\
What is plotted follows from the signals that were recorded, so it works for any plant. A layout for
PlotJuggler in the folder of the run opens the recording, too, over simulated time.

Exit codes: 0 written; 2 no such run, it is damaged, or the file is there already or cannot be made
there; 3 it cannot be written to its end.

Examples:
  hil layout runs/demo plotjuggler -o runs/demo/plotjuggler.xml
  hil layout runs/demo foxglove -o runs/demo/foxglove.json";

/// Arguments of `hil layout`.
#[derive(Debug, Args)]
pub struct LayoutArguments {
    /// A run's folder or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// The program that is to show it
    #[arg(value_name = "VIEWER")]
    pub viewer: Viewer,
    /// The file to write; - is standard output, which is the default
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write over a file that is there
    #[arg(long)]
    pub force: bool,
}

/// Programs that show recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Viewer {
    /// Foxglove, and Lichtblick, which has the same form.
    Foxglove,
    /// PlotJuggler 3.
    #[value(name = "plotjuggler")]
    PlotJuggler,
}
