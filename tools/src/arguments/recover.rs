//! The command line of `hil recover`.

use std::path::PathBuf;

use clap::Args;

use super::runs::run_path;

/// Examples.
pub(crate) const EXAMPLES: &str = "\
Every whole record up to where the file broke off is kept. The new file takes
the place of the old one when it is whole on the disk, not before. A file that is
whole is left alone. A folder without summary.json gets one. A file that is damaged
before its end is recovered with -o FILE only: what comes after that is given up.
What no check sum vouches for, such as the records of a torn chunk, is told here and
in the new file, and whoever reads that tells it too.

Exit codes: 0 the recording is whole, now or already; 2 nothing can be had of it,
or a session is still writing it; 3 the new file cannot be written.

Examples:
  hil recover runs/demo
  hil recover runs/demo/run.mcap -o /elsewhere/demo.mcap
  hil recover runs/demo --json";

/// Arguments of `hil recover`.
#[derive(Debug, Args)]
pub struct RecoverArguments {
    /// A run's folder or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// Write the whole file here and leave the other as it is
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
