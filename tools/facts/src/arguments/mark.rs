//! The command line of `hil mark`.

use clap::Args;

use crate::arguments::SessionChoice;

/// Explanation and examples of `hil mark`.
pub const HELP: &str = "\
The note is an event of the recording, outside the digest: it does not change the run. The monitor,
the summary, the report's plots and the metadata of an export to Parquet show the note.

Examples:
  hil mark \"the pilot feels it here\"
  hil mark --session demo \"gain doubled\"";

/// Arguments of `hil mark`.
#[derive(Debug, Args)]
pub struct MarkArguments {
    /// The note: one line of at most 400 characters
    #[arg(value_name = "TEXT")]
    pub text: String,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}
