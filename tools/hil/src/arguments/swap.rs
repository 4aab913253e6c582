//! The command line of `hil controller swap`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hil_facts::arguments::SessionChoice;

/// Examples of `hil controller swap`.
pub(crate) const EXAMPLES: &str = "\
Examples:
  hil controller swap --bin ./target/release/my-controller
  hil controller swap --set controller.law=pid
  hil controller swap --bin ./my-controller --session demo --json";

/// Arguments of `hil controller`.
#[derive(Debug, Args)]
pub struct ControllerArguments {
    /// Action
    #[command(subcommand)]
    pub action: ControllerAction,
}

/// Actions on a controller.
#[derive(Debug, Subcommand)]
pub enum ControllerAction {
    /// Hand over to another controller while the run continues
    ///
    /// The new controller is checked and started beside the active one, which continues until the new one is
    /// ready; then the plant takes commands from the new one alone. The new law begins afresh at that step.
    /// If anything is wrong with the new controller, the run continues with the active one.
    #[command(
        after_help = EXAMPLES,
        override_usage = "hil controller swap [OPTIONS] <--bin <PATH>|--set <KEY=VALUE>>"
    )]
    Swap(SwapArguments),
}

/// Arguments of `hil controller swap`.
#[derive(Debug, Args)]
pub struct SwapArguments {
    /// Binary of the new controller; may be omitted with --set: then the binary that the run was started with
    /// is used. Keys of the scenario that none of its laws has are left out, and the answer lists them
    #[arg(long, value_name = "PATH", required_unless_present = "set")]
    pub bin: Option<PathBuf>,
    /// Change a value of the scenario that begins with `controller.`; may be given several times
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Time that the new controller may take to describe itself, to check its job and to take over, each; at least that
    /// of the run [default: that of the run]
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = limit_s,
        allow_negative_numbers = true
    )]
    pub wait_limit: Option<f64>,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}

/// Reads a limit: a number above 0, or `inf`.
fn limit_s(text: &str) -> Result<f64, String> {
    let limit_s = text.parse().ok().filter(|limit_s| *limit_s > 0.0);
    limit_s.ok_or_else(|| "expected a number above 0, or inf".into())
}
