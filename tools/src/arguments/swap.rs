//! The command line of `hil controller swap`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::SessionChoice;

/// Examples of `hil controller swap`.
pub(crate) const EXAMPLES: &str = "\
Examples:
  hil controller swap --bin ./target/release/my-controller
  hil controller swap --set controller.law=pid
  hil controller swap --bin ./my-controller --session demo --json";

/// Actions on the controller of a running session.
#[derive(Debug, Args)]
pub struct ControllerArguments {
    /// Action
    #[command(subcommand)]
    pub action: ControllerAction,
}

/// Actions on a controller.
#[derive(Debug, Subcommand)]
pub enum ControllerAction {
    /// Let another controller take over while the run goes on
    ///
    /// The new one is checked and started beside the active one, which goes on until the new one is
    /// ready; then the plant takes commands from the new one alone. Its law begins afresh at that step.
    /// If anything is wrong with it, the run goes on with the one that it has.
    #[command(
        after_help = EXAMPLES,
        override_usage = "hil controller swap [OPTIONS] <--bin <PATH>|--set <KEY=VALUE>>"
    )]
    Swap(SwapArguments),
}

/// Arguments of `hil controller swap`.
#[derive(Debug, Args)]
pub struct SwapArguments {
    /// The new controller's binary; may be left out with --set: then it is the one the run was started
    /// with. Keys of the scenario that none of its laws has are left out, and the answer lists them
    #[arg(long, value_name = "PATH", required_unless_present = "set")]
    pub bin: Option<PathBuf>,
    /// Change a value of the scenario that begins with `controller.`; may be given several times
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}
