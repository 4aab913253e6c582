//! The command lines of `hil search`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hil_facts::arguments::BinaryArguments;

/// Examples of the help of `hil search`.
pub const EXAMPLES: &str = "\
Examples:
  hil search smallest studies/leakage-margin.toml
  hil search worst studies/leakage-margin.toml --json";

/// Arguments of `hil search`.
#[derive(Debug, Args)]
pub struct SearchCommand {
    /// Point to search for.
    #[command(subcommand)]
    pub action: SearchAction,
}

/// The kinds of search.
#[derive(Debug, Subcommand)]
pub enum SearchAction {
    /// Find the smallest fault, delay or gain that breaks a requirement, or the nearest such point of several values
    #[command(after_help = "\
Searches the ranges of the study's [[vary]], from their nominal values: one value by bisection,
several by an evolution strategy. Writes fails.toml, a scenario that fails, and passes.toml, its
passing neighbour. After any interruption the same command continues.
Exit codes: 0 found; 1 nothing found, or larger sizes pass again; 2 wrong usage or configuration.

Example:
  hil search smallest studies/leakage-margin.toml")]
    Smallest(SearchArguments),
    /// Find the case with the least margin in the ranges of a study
    #[command(after_help = "\
Writes worst.toml, the scenario of that case. After any interruption the same command continues.
Exit codes: 0 the worst case passes; 1 it fails, or no case has a margin; 2 wrong usage or
configuration.

Example:
  hil search worst studies/leakage-margin.toml")]
    Worst(SearchArguments),
}

/// Arguments of a search.
#[derive(Debug, Args)]
pub struct SearchArguments {
    /// The study
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// Programs of the cases
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Folder for the journal and the scenarios [default: runs/STUDY-smallest or runs/STUDY-worst]
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}
