//! The command line as it is typed; what it means is decided by the commands.

use std::path::PathBuf;

use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;

use crate::exit::Failure;

/// Hardware-in-the-loop runs of a plant and a controller in deterministic lockstep
///
/// Exit codes: 0 pass; 1 a requirement failed or a run diverged; 2 wrong usage or configuration,
/// nothing was started; 3 a process died, a wait ran out, a disk is full; 130 interrupted.
#[derive(Debug, Parser)]
#[command(name = "hil", version)]
pub struct CommandLine {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a scenario: start plant and controller, record, judge and summarise
    #[command(after_help = RUN_EXAMPLES)]
    Run(RunArguments),
    /// Check a scenario, show it complete, or print its schema
    Config(ConfigArguments),
    /// List the running sessions, or clean up after dead ones
    #[command(after_help = "Examples:\n  hil sessions\n  hil sessions --clean")]
    Sessions(SessionsArguments),
    /// Print completions for a shell
    #[command(
        after_help = "Example:\n  hil completions bash > ~/.local/share/bash-completion/completions/hil"
    )]
    Completions {
        /// The shell.
        shell: Shell,
    },
}

const RUN_EXAMPLES: &str = "\
Examples:
  hil run scenarios/severe-leakage.toml
  hil run scenarios/severe-leakage.toml --set controller.law=pid --out runs/pid
  hil run scenarios/severe-leakage.toml --set 'faults[0].effects[1].speed_per_s=2'
  hil run scenarios/spring-mass.toml --pace 1
  hil run scenarios/spring-mass.toml --controller-bin target/release/my-controller --json";

/// Arguments of `hil run`.
#[derive(Debug, Args)]
pub struct RunArguments {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml")]
    pub scenario: PathBuf,
    /// What is changed in it
    #[command(flatten)]
    pub changes: Changes,
    /// Which binaries run
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// What connects plant and controller
    #[arg(long, value_enum, default_value_t = LinkKind::Iceoryx2, value_name = "LINK")]
    pub link: LinkKind,
    /// Write the run to this folder, which must not exist or be empty [default: runs/SCENARIO-TIME-SESSION]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the session: a-z, 0-9 and -, at most 24 [default: random]
    #[arg(long, value_name = "NAME")]
    pub session: Option<String>,
    /// Do not write run.mcap; digest and metrics are computed all the same
    #[arg(long)]
    pub no_record: bool,
    /// Compression of run.mcap
    #[arg(long, value_enum, default_value_t = Compression::Lz4, value_name = "HOW")]
    pub compression: Compression,
    /// How long a process that lives may keep the other waiting, in s; inf under a debugger
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 5.0,
        allow_negative_numbers = true
    )]
    pub wait_limit: f64,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

/// Changes to a scenario.
#[derive(Debug, Args)]
pub struct Changes {
    /// Change a value of the scenario; may be given several times
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// What releases a step: the other side's answer, or the monotonic clock
    #[arg(long, value_enum, value_name = "CLOCK")]
    pub clock: Option<ClockKind>,
    /// Simulated seconds per second; implies --clock paced
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    pub pace: Option<f64>,
}

impl Changes {
    /// Refuses what cannot be meant together.
    ///
    /// # Errors
    /// If a pace is asked for with the lockstep clock.
    pub fn check(&self) -> Result<(), Failure> {
        match (self.clock, self.pace) {
            (Some(ClockKind::Lockstep), Some(_)) => Err(Failure::usage(
                "--pace is for --clock paced; lockstep runs as fast as both sides can",
            )),
            (_, Some(factor)) if !(factor.is_finite() && factor > 0.0) => Err(Failure::usage(
                format!("--pace takes a number above 0, not {factor}"),
            )),
            _ => Ok(()),
        }
    }

    /// All of them as `KEY=VALUE`.
    #[must_use]
    pub fn as_set(&self) -> Vec<String> {
        let mut set = self.set.clone();
        let clock = match (self.clock, self.pace) {
            (None, None) => return set,
            (_, Some(_)) | (Some(ClockKind::Paced), None) => "paced",
            (Some(ClockKind::Lockstep), None) => "lockstep",
        };
        set.push(format!("run.clock={clock}"));
        set.extend(self.pace.map(|factor| format!("run.pace={factor:?}")));
        set
    }
}

/// The binaries of a run.
#[derive(Debug, Args)]
pub struct BinaryArguments {
    /// A plant process other than the one beside hil
    #[arg(long, value_name = "PATH")]
    pub plant_bin: Option<PathBuf>,
    /// A controller process other than the one beside hil
    #[arg(long, value_name = "PATH")]
    pub controller_bin: Option<PathBuf>,
}

/// What connects plant and controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LinkKind {
    /// Two processes over shared memory.
    Iceoryx2,
    /// One process, for comparison and for machines without shared memory.
    InProcess,
}

/// What releases a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ClockKind {
    /// The other side's answer: as fast as both can.
    Lockstep,
    /// The monotonic clock.
    Paced,
}

/// Compression of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Compression {
    /// None.
    None,
    /// Fast.
    Lz4,
    /// Small.
    Zstd,
}

/// Arguments of `hil config`.
#[derive(Debug, Args)]
pub struct ConfigArguments {
    /// What to do.
    #[command(subcommand)]
    pub action: ConfigAction,
}

/// The parts of `hil config`.
#[derive(Debug, Subcommand)]
pub enum ConfigAction {
    /// Say everything that is wrong with a scenario, or that nothing is
    #[command(after_help = "Example:\n  hil config check scenarios/severe-leakage.toml")]
    Check(ScenarioArguments),
    /// Print a scenario with every value that is in effect, ready to run
    #[command(
        after_help = "Example:\n  hil config show scenarios/severe-leakage.toml --set controller.law=pid"
    )]
    Show(ScenarioArguments),
    /// Print the JSON schema of scenarios, for editors
    #[command(after_help = "Example:\n  hil config schema > scenario.schema.json")]
    Schema {
        /// Which binaries are described.
        #[command(flatten)]
        binaries: BinaryArguments,
    },
}

/// A scenario to look at.
#[derive(Debug, Args)]
pub struct ScenarioArguments {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml")]
    pub scenario: PathBuf,
    /// What is changed in it
    #[command(flatten)]
    pub changes: Changes,
    /// Which binaries it is checked against
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Print problems as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `hil sessions`.
#[derive(Debug, Args)]
pub struct SessionsArguments {
    /// Remove what dead sessions left; running ones, also stopped ones, stay
    #[arg(long)]
    pub clean: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// The completions for a shell.
#[must_use]
pub fn completions(shell: Shell) -> String {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut CommandLine::command(), "hil", &mut text);
    String::from_utf8_lossy(&text).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        CommandLine::command().debug_assert();
    }

    #[test]
    fn a_pace_implies_the_paced_clock() {
        let changes = |clock, pace| {
            Changes {
                set: vec!["a=1".into()],
                clock,
                pace,
            }
            .as_set()
        };
        assert_eq!(changes(None, None), ["a=1"]);
        assert_eq!(
            changes(None, Some(2.0)),
            ["a=1", "run.clock=paced", "run.pace=2.0"]
        );
        assert_eq!(
            changes(Some(ClockKind::Lockstep), None),
            ["a=1", "run.clock=lockstep"]
        );
    }
}
