//! The command line of `hil layout`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use hil_console::files::runs::run_path;

/// Text behind the options in the help of `hil layout`.
pub const EXAMPLES: &str = "\
The plots follow from the recorded signals, so a layout works for any plant. A layout for
PlotJuggler in the folder of the run also opens the recording, over simulated time.

Exit codes: 0 written; 2 no such run, a damaged run, or the file exists or cannot be created;
3 the file cannot be written completely.

Examples:
  hil layout runs/demo plotjuggler -o runs/demo/plotjuggler.xml
  hil layout runs/demo foxglove -o runs/demo/foxglove.json";

/// Arguments of `hil layout`.
#[derive(Debug, Args)]
pub struct LayoutArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// Program that shows the recording
    #[arg(value_name = "VIEWER")]
    pub viewer: Viewer,
    /// File to write, or - for standard output [default: -]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
}

/// Programs that display recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Viewer {
    /// Foxglove, and Lichtblick, which reads the same layouts.
    Foxglove,
    /// PlotJuggler 3.
    #[value(name = "plotjuggler")]
    PlotJuggler,
}
