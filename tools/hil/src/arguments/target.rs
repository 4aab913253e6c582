//! The command line of `hil target`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hil_facts::arguments::target::TargetArguments;
use hil_target::name::Target;

pub(super) const EXAMPLES: &str = "\
Examples:
  hil target check me@board
  hil target clean me@board
  hil target key board.key
  hil target serve --listen 192.0.2.7:7000 --key-file board.key --allow ./controller-process
  hil run scenarios/severe-leakage.toml --target me@board
  hil run scenarios/severe-leakage.toml --target serve://192.0.2.7:7000 --key-file board.key";

/// Arguments of `hil target`.
#[derive(Debug, Args)]
pub struct TargetCommand {
    /// Action on a target.
    #[command(subcommand)]
    pub action: TargetAction,
}

/// Actions of `hil target`.
#[derive(Debug, Subcommand)]
pub enum TargetAction {
    /// Check whether a target can be reached and what it is fit for
    #[command(
        after_help = "Exit codes: 0 the target can be used; 2 the target cannot be used as named; 3 the target does not answer, or has no room in /dev/shm or in its cache folder.\n\nExample:\n  hil target check me@board"
    )]
    Check(TargetContact),
    /// Remove the programs that are cached on a target
    #[command(after_help = "Example:\n  hil target clean me@board")]
    Clean(TargetContact),
    /// Create the key of a listening agent, in a file that only you can read
    #[command(after_help = "Example:\n  hil target key board.key")]
    Key {
        /// File to create; it must not exist
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Listen on a target without ssh for a desk that has the key
    #[command(after_help = "\
Runs the listed programs and no others, one session at a time, until interrupted.
On a board without hil, `hil-target serve` with the same flags does the same.

Example:
  hil target serve --listen 192.0.2.7:7000 --key-file board.key --allow ./controller-process")]
    Serve(ServeArguments),
}

/// Target to contact.
#[derive(Debug, Args)]
pub struct TargetContact {
    /// [user@]host or a name of your ssh configuration, or serve://HOST:PORT
    #[arg(value_name = "TARGET")]
    pub target: Target,
    /// The hil-target program for that machine [default: a static build of this workspace, else the
    /// one beside hil]
    #[arg(long, value_name = "PATH")]
    pub target_agent: Option<PathBuf>,
    /// File with the key of a listening agent
    #[arg(long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

impl TargetContact {
    /// Returns the equivalent arguments of `hil run`.
    pub(crate) fn arguments(&self) -> TargetArguments {
        TargetArguments {
            target: Some(self.target.clone()),
            target_agent: self.target_agent.clone(),
            key_file: self.key_file.clone(),
        }
    }
}

/// Arguments of `hil target serve`.
#[derive(Debug, Args)]
pub struct ServeArguments {
    /// Address to listen on, as 192.0.2.7:7000
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub listen: std::net::SocketAddr,
    /// File with the key
    #[arg(long, value_name = "FILE")]
    pub key_file: PathBuf,
    /// Program that may be run; may be given several times
    #[arg(long, value_name = "PROGRAM", required = true)]
    pub allow: Vec<PathBuf>,
}
