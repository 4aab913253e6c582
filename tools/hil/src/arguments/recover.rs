//! The command line of `hil recover`.

use std::path::PathBuf;

use clap::Args;
use hil_console::files::runs::run_path;

/// Examples.
pub(crate) const EXAMPLES: &str = "\
Every whole record up to the point where the file was cut off is kept. The new file
replaces the old one only when the new file is whole on the disk. A file that is whole
is left alone. A folder without summary.json gets one. A file that is damaged before
its end is recovered with -o FILE only: the records after the damage are given up.
Records that no checksum covers, such as those of a torn chunk, are reported here and
in the new file, and by every command that reads the new file.

Exit codes: 0 the recording is whole, now or already; 2 nothing can be recovered,
or a session is still writing the file; 3 the new file cannot be written.

Examples:
  hil recover runs/demo
  hil recover runs/demo/run.mcap -o /elsewhere/demo.mcap
  hil recover runs/demo --json";

/// Arguments of `hil recover`.
#[derive(Debug, Args)]
pub struct RecoverArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// Write the recovered file here and leave the original unchanged
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
