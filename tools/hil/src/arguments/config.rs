//! The command lines of `hil config` and `hil sessions`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hil_facts::arguments::BinaryArguments;
use hil_facts::arguments::run::Changes;

/// Arguments of `hil config`.
#[derive(Debug, Args)]
pub struct ConfigArguments {
    /// Action.
    #[command(subcommand)]
    pub action: ConfigAction,
}

/// Actions of `hil config`.
#[derive(Debug, Subcommand)]
pub enum ConfigAction {
    /// Check a scenario and list all its errors
    #[command(after_help = "Example:\n  hil config check scenarios/severe-leakage.toml")]
    Check(ScenarioArguments),
    /// Print a complete scenario with every value in effect, ready to run
    #[command(
        after_help = "Examples:\n  hil config show scenarios/severe-leakage.toml --set controller.law=pid\n  hil config show my.toml --instruments --at-hz 1,10"
    )]
    Show(ShowArguments),
    /// Print the JSON schema of scenarios, or of studies, for editors
    #[command(
        after_help = "Examples:\n  hil config schema > scenario.schema.json\n  hil config schema --study > study.schema.json"
    )]
    Schema {
        /// Print the schema of studies, for hil campaign.
        #[arg(long)]
        study: bool,
        /// Choice of the described binaries.
        #[command(flatten)]
        binaries: BinaryArguments,
    },
}

/// Arguments of `hil config show`.
#[derive(Debug, Args)]
pub struct ShowArguments {
    /// The scenario
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Print instead the noise, delay and phase loss of its sensors and actuators
    #[arg(long)]
    pub instruments: bool,
    /// Frequencies in Hz of the phase loss
    #[arg(
        long,
        value_name = "HZ",
        value_delimiter = ',',
        default_value = "1,10,100",
        requires = "instruments"
    )]
    pub at_hz: Vec<f64>,
}

/// Scenario to check or show.
#[derive(Debug, Args)]
pub struct ScenarioArguments {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml")]
    pub scenario: PathBuf,
    /// Changes of the scenario
    #[command(flatten)]
    pub changes: Changes,
    /// Binaries that the scenario is checked against
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Print problems as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil sessions`.
#[derive(Debug, Args)]
pub struct SessionsArguments {
    /// Remove what dead sessions left, as every command does anyway; running and stopped sessions stay
    #[arg(long)]
    pub clean: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
