//! The command line of `hil new`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

pub(super) const EXAMPLES: &str = "\
A plant or a controller is a crate, a program in C with a Makefile, or a class in Python, with a test and a scenario
that runs it; a scenario is a file whose requirements are its test. Nothing is overwritten.

Examples:
  hil new plant cart && cd cart
  cargo test --release && cargo build --release && hil run cart.toml

  hil new controller ../my-law
  hil new plant motor --lang c && cd motor && make test && make && hil run motor.toml
  hil new plant motor --lang python && cd motor && python3 -m unittest && hil run motor.toml
  hil new scenario gust
  hil new plant motor --framework ~/hil";

/// Arguments of `hil new`.
#[derive(Debug, Args)]
pub struct NewArguments {
    /// Kind of project
    #[arg(value_enum, value_name = "WHAT")]
    pub what: What,
    /// Folder to create; its last part is the name: a-z, 0-9 and -, starting with a letter
    #[arg(value_name = "NAME")]
    pub path: PathBuf,
    /// The language of a plant or a controller
    #[arg(long, value_enum, value_name = "LANG", default_value_t = Language::Rust)]
    pub lang: Language,
    /// Folder of the framework's clone [default: where this hil was built]
    #[arg(long, value_name = "DIR")]
    pub framework: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Programming language of a project.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Language {
    /// Cargo package.
    Rust,
    /// C11 with a Makefile.
    C,
    /// Class in a file that an interpreter runs.
    Python,
}

/// Kinds of projects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Model in a program of its own.
    Plant,
    /// Control law in a program of its own.
    Controller,
    /// Scenario for existing programs.
    Scenario,
}

impl What {
    /// Returns the name as typed.
    #[must_use]
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Controller => "controller",
            Self::Scenario => "scenario",
        }
    }
}
