//! The command lines of `hil pause`, `hil resume` and `hil step`.

use clap::Args;

use crate::arguments::SessionChoice;

/// Arguments of `hil pause` and `hil resume`.
#[derive(Debug, Args)]
pub struct ClockArguments {
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}

/// Arguments of `hil step`.
#[derive(Debug, Args)]
pub struct StepArguments {
    /// Number of steps
    #[arg(value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: u64,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}
