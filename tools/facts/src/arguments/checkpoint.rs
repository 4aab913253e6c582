//! Flags of `hil run` that make checkpoints and continue from one.

use std::path::PathBuf;

use clap::Args;
use hil_console::files::runs::run_path;
use hil_console::terminal::duration::seconds;

/// Selection of the checkpoints that a run makes.
#[derive(Clone, Debug, Default, Args)]
pub struct CheckpointArguments {
    /// Save the state of plant and controller before the first step at or after this simulated time, to
    /// continue from it later; may be given several times
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub checkpoint_at: Vec<f64>,
}

/// Selection of the checkpoint from which a run continues.
#[derive(Clone, Debug, Default, Args)]
pub struct FromArguments {
    /// Continue from a checkpoint with its scenario; --set changes values from there on
    #[arg(long, value_name = "CHECKPOINT", value_parser = run_path(), conflicts_with_all = ["scenarios", "audit"])]
    pub from: Option<PathBuf>,
}
