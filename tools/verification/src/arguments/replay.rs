//! The command line of `hil replay`.

use std::path::PathBuf;

use clap::Args;
use hil_console::files::runs::run_path;
use hil_facts::arguments::run::LinkKind;
use hil_facts::arguments::target::TargetArguments;

use crate::arguments::tolerance::Tolerance;

/// Text behind the options in the help of `hil replay`.
pub const HELP: &str = "\
Exit codes: 0 the same, or within the tolerances; 1 different; 2 this run cannot be replayed with
this controller; 3 the controller died or did not answer; 130 interrupted.

Examples:
  hil replay runs/demo
  hil replay runs/demo --controller-bin target/release/my-controller
  hil replay runs/demo --target me@board
  hil replay runs/demo --controller-bin my-controller --tolerance internal.lyapunov_v3=1e-9 --json";

/// Arguments of `hil replay`.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// The controller program [default: HIL_CONTROLLER_BIN, else that of the recording, else the one
    /// beside hil]
    #[arg(long, value_name = "PATH")]
    pub controller_bin: Option<PathBuf>,
    /// Machine of the controller
    #[command(flatten)]
    pub target: TargetArguments,
    /// Largest difference of commands and internals that counts as the same, in the signal's own unit, for
    /// all of them or for one; may be given several times
    #[arg(long, value_name = "[SIGNAL=]X", allow_hyphen_values = true)]
    pub tolerance: Vec<Tolerance>,
    /// Link between the recording and the controller
    #[arg(long, value_enum, default_value_t = LinkKind::Iceoryx2, value_name = "LINK")]
    pub link: LinkKind,
    /// Name of the session: a-z, 0-9 and -, at most 24 [default: random]
    #[arg(long, value_name = "NAME")]
    pub session: Option<String>,
    /// Longest wait for an answer of a live controller, in s; inf under a debugger
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 5.0,
        allow_negative_numbers = true
    )]
    pub wait_limit: f64,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
