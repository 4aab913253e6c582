//! The command line of `hil new`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

pub(super) const EXAMPLES: &str = "\
A plant or a controller is a crate with a test and a scenario that runs it; a scenario is a file whose
requirements are its test. Nothing is written over.

Examples:
  hil new plant cart && cd cart
  cargo test && cargo build --release && hil run cart.toml

  hil new controller ../my-law
  hil new scenario gust
  hil new plant motor --framework ~/hil";

/// Arguments of `hil new`.
#[derive(Debug, Args)]
pub struct NewArguments {
    /// What it is
    #[arg(value_enum, value_name = "WHAT")]
    pub what: What,
    /// The folder to make; its last part is the name: a-z, 0-9 and -, a letter first
    #[arg(value_name = "NAME")]
    pub path: PathBuf,
    /// The framework's clone [default: where this hil was built]
    #[arg(long, value_name = "DIR")]
    pub framework: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// What can be begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// A model as a program of its own.
    Plant,
    /// A law as a program of its own.
    Controller,
    /// A scenario for what is there.
    Scenario,
}

impl What {
    /// Its name as it is typed.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Controller => "controller",
            Self::Scenario => "scenario",
        }
    }
}
