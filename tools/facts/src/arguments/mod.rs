//! Arguments shared by verbs of several packages: options of a run, selection of a session and of programs, words
//! of `hil inject`. Contains no logic.

pub mod checkpoint;
pub mod clock;
pub mod inject;
pub mod mark;
pub mod realtime;
pub mod recording;
pub mod run;
pub mod set;
pub mod target;

use std::path::PathBuf;

use clap::Args;

/// Binaries of a run.
#[derive(Clone, Debug, Default, Args)]
pub struct BinaryArguments {
    /// The plant program [default: HIL_PLANT_BIN, else that of the scenario or the recording, else
    /// the one beside hil]
    #[arg(long, value_name = "PATH")]
    pub plant_bin: Option<PathBuf>,
    /// The controller program [default: HIL_CONTROLLER_BIN, else that of the scenario or the recording,
    /// else the one beside hil]
    #[arg(long, value_name = "PATH")]
    pub controller_bin: Option<PathBuf>,
}

/// Selection of a running session, and the format of the answer.
#[derive(Debug, Default, Args)]
pub struct SessionChoice {
    /// The session, if several are running
    #[arg(long, value_name = "NAME")]
    pub session: Option<String>,
    /// Print the answer as JSON
    #[arg(long)]
    pub json: bool,
}
