//! Command line: clap's types, their values, help and errors. Neither executes commands nor completes them
//! (`commands::completion` does).
//!
//! One file per group of commands; parts shared by several packages are in `hil_facts::arguments`.

pub(crate) mod config;
pub(crate) mod describe;
pub(crate) mod new;
pub(crate) mod recover;
pub(crate) mod runs;
pub(crate) mod swap;
pub(crate) mod target;

use std::any::TypeId;
use std::ffi::OsString;

use clap::builder::styling::Style;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;
use hil_benchmark::arguments::{LatencyArguments, LatencyPeerArguments};
use hil_campaign::arguments::CampaignCommand;
use hil_campaign::arguments::search::SearchCommand;
use hil_doctor::arguments::DoctorArguments;
use hil_facts::arguments::clock::{ClockArguments, StepArguments};
use hil_facts::arguments::inject::{self, InjectArguments};
use hil_facts::arguments::mark::{self, MarkArguments};
use hil_facts::arguments::set::{self, SetArguments};
use hil_operating_point::arguments::{self as operating_point, LineariseArguments, TrimArguments};
use hil_verification::arguments::margins::MarginsArguments;
use hil_verification::arguments::recordings::{CompareArguments, JudgeArguments, ScenarioCommand};
use hil_verification::arguments::replay::ReplayArguments;
use hil_verification::arguments::run::{RerunArguments, RunArguments};
use hil_views::arguments::export::ExportArguments;
use hil_views::arguments::layout::LayoutArguments;
use hil_views::arguments::monitor::MonitorArguments;
use hil_views::arguments::panel::PanelArguments;
use hil_views::arguments::report::ReportArguments;
use hil_views::arguments::values::{GetArguments, WatchArguments};
use shared_types::table::nearest;

use config::{ConfigArguments, SessionsArguments};
use describe::DescribeArguments;
use new::NewArguments;
use recover::RecoverArguments;
use runs::RunsArguments;
use swap::ControllerArguments;
use target::TargetCommand;

/// Hardware-in-the-loop runs of a plant and a controller in deterministic lockstep
///
/// Exit codes: 0 pass; 1 a requirement failed, a run diverged, runs differ or the machine is unfit
/// for timing claims; 2 wrong usage or configuration, nothing was started; 3 a process died, a wait
/// ran out, a disk is full; 130 interrupted.
#[derive(Debug, Parser)]
#[command(name = "hil", version)]
pub struct CommandLine {
    /// Command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a scenario: start both processes, record, judge, summarise
    #[command(after_help = hil_verification::arguments::run::EXAMPLES)]
    Run(RunArguments),
    /// Inject a fault into a running session, or list and clear faults
    #[command(override_usage = inject::USAGE, after_help = inject::EXAMPLES)]
    Inject(Box<InjectArguments>),
    /// Hold a running session before its next step
    #[command(after_help = "Example:\n  hil pause --session demo")]
    Pause(ClockArguments),
    /// Resume a held session
    #[command(after_help = "Example:\n  hil resume")]
    Resume(ClockArguments),
    /// Execute some steps of a session, then hold it
    #[command(after_help = "Examples:\n  hil step\n  hil step 1000")]
    Step(StepArguments),
    /// Print the newest values of a session's signals
    #[command(after_help = hil_views::arguments::values::GET_EXAMPLES)]
    Get(GetArguments),
    /// Print values of a session's signals repeatedly
    #[command(after_help = hil_views::arguments::values::WATCH_EXAMPLES)]
    Watch(WatchArguments),
    /// Change values of a running session, all at one step
    #[command(after_help = set::HELP)]
    Set(SetArguments),
    /// Add a note at the current step of a session
    #[command(after_help = mark::HELP)]
    Mark(MarkArguments),
    /// Watch a running session: plots, faults, latency, requirements
    #[command(after_help = hil_views::arguments::monitor::EXAMPLES)]
    Monitor(MonitorArguments),
    /// Show a running session or a recorded run in a browser
    #[command(after_help = hil_views::arguments::panel::EXAMPLES)]
    Panel(PanelArguments),
    /// Change the controller of a running session
    Controller(ControllerArguments),
    /// Measure gain, phase, delay and disc margins of the running loop
    #[command(after_help = hil_verification::arguments::margins::EXAMPLES)]
    Margins(MarginsArguments),
    /// Run many cases of a scenario: check, plan, run, submit, show
    #[command(after_help = hil_campaign::arguments::EXAMPLES)]
    Campaign(CampaignCommand),
    /// Find the smallest fault that breaks a requirement
    #[command(after_help = hil_campaign::arguments::search::EXAMPLES)]
    Search(SearchCommand),
    /// Repeat a recorded run with its late commands; compare digests
    #[command(
        after_help = "Exit codes: 0 the same digest; 1 another.\n\nExample:\n  hil rerun runs/demo"
    )]
    Rerun(RerunArguments),
    /// Feed recorded samples to a controller and compare its answers
    #[command(after_help = hil_verification::arguments::replay::HELP)]
    Replay(ReplayArguments),
    /// Compare two recorded runs, or one with a baseline
    #[command(after_help = "\
Exit codes: 0 the same, or within the tolerance; 1 different; 2 not comparable, or no such baseline.

Examples:
  hil compare runs/a runs/b
  hil compare runs/a runs/b --signal truth.surface_angle_rad --tolerance 1e-9
  hil compare runs/a runs/b --tolerance truth.surface_angle_rad=1e-9
  hil compare runs/demo --baseline severe-leakage-ftsc
  hil compare runs/demo --baseline severe-leakage-ftsc --update --dry-run")]
    Compare(CompareArguments),
    /// Judge a recorded run by its own requirements or by others
    #[command(after_help = hil_verification::arguments::recordings::JUDGE_EXAMPLES)]
    Judge(JudgeArguments),
    /// Write an HTML report of recorded runs
    #[command(after_help = hil_views::arguments::report::EXAMPLES)]
    Report(ReportArguments),
    /// Write signals of a recorded run to a CSV or Parquet file
    #[command(after_help = hil_views::arguments::export::EXAMPLES)]
    Export(ExportArguments),
    /// Write a layout for Foxglove or PlotJuggler
    #[command(after_help = hil_views::arguments::layout::EXAMPLES)]
    Layout(LayoutArguments),
    /// Recover a recording that was cut off
    #[command(after_help = recover::EXAMPLES)]
    Recover(RecoverArguments),
    /// List recorded runs, or remove runs by a rule
    #[command(after_help = runs::EXAMPLES)]
    Runs(RunsArguments),
    /// Create scenarios from runs
    Scenario(ScenarioCommand),
    /// Create a plant, controller or scenario project
    #[command(after_help = new::EXAMPLES)]
    New(NewArguments),
    /// Show the signals and parameters of a program or an FMU
    #[command(after_help = describe::EXAMPLES)]
    Describe(DescribeArguments),
    /// Check a scenario, print all its values, or print the schema
    Config(ConfigArguments),
    /// Linearise a plant, a law or their loop at a point of a scenario
    #[command(after_help = operating_point::LINEARISE_EXAMPLES)]
    Linearise(LineariseArguments),
    /// Solve for an equilibrium of a scenario, and begin there
    #[command(after_help = operating_point::TRIM_EXAMPLES)]
    Trim(TrimArguments),
    /// List running sessions, or clean up after dead ones
    #[command(after_help = "Examples:\n  hil sessions\n  hil sessions --clean")]
    Sessions(SessionsArguments),
    /// Check, clean or serve the machines that controllers run on
    #[command(after_help = target::EXAMPLES)]
    Target(TargetCommand),
    /// Check whether this machine is fit for timing claims
    #[command(after_help = hil_doctor::arguments::EXAMPLES)]
    Doctor(DoctorArguments),
    /// Measure the latency of the loop, or show that of a run
    #[command(after_help = hil_benchmark::arguments::EXAMPLES)]
    Latency(LatencyArguments),
    /// The other process of `hil latency`
    #[command(hide = true)]
    LatencyPeer(LatencyPeerArguments),
    /// Print completions for a shell
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// The shell.
        shell: Shell,
    },
}

const COMPLETIONS_HELP: &str = "\
The script asks hil at each request, so it knows the running sessions, the runs below runs,
the keys of the scenario on the line, and signals, kinds of faults and targets of the session or
scenario.

The line for the startup file of a shell:
  ~/.bashrc                   source <(hil completions bash)
  ~/.zshrc, after compinit    source <(hil completions zsh)
  ~/.config/fish/config.fish  hil completions fish | source";

/// Subcommands as grouped by `hil --help`; clap supports a single heading only.
const GROUPS: [(&str, &[&str]); 4] = [
    (
        "Run",
        &[
            "run",
            "new",
            "describe",
            "campaign",
            "search",
            "margins",
            "trim",
            "linearise",
            "config",
            "rerun",
        ],
    ),
    (
        "While a session runs",
        &[
            "monitor",
            "panel",
            "get",
            "watch",
            "inject",
            "set",
            "mark",
            "pause",
            "resume",
            "step",
            "controller",
        ],
    ),
    (
        "Recorded runs",
        &[
            "runs", "report", "judge", "compare", "replay", "export", "layout", "recover",
            "scenario",
        ],
    ),
    (
        "Machine and sessions",
        &[
            "doctor",
            "latency",
            "target",
            "sessions",
            "completions",
            "help",
        ],
    ),
];

impl CommandLine {
    /// Parses the command line of this process; exits with a message if the command line is invalid.
    pub(crate) fn of_process() -> Self {
        let typed = inject::arrange(std::env::args_os());
        let matches = command().try_get_matches_from(&typed);
        matches
            .and_then(|matches| Self::from_arg_matches(&matches))
            .unwrap_or_else(|error| in_words(error, &typed).exit())
    }
}

/// Returns the clap command with its subcommands in groups.
pub(crate) fn command() -> clap::Command {
    let mut command = CommandLine::command();
    command.build();
    let heading = Style::new().bold().underline();
    let mut groups = String::new();
    for (title, names) in GROUPS {
        groups += &format!("{heading}{title}:{heading:#}\n");
        for subcommand in names
            .iter()
            .filter_map(|name| command.find_subcommand(name))
        {
            let name = Style::new().bold();
            let about = subcommand.get_about().cloned().unwrap_or_default();
            let command = subcommand.get_name();
            groups += &format!("  {name}{command:<11}{name:#}  {about}\n");
        }
        groups.push('\n');
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}{heading}Options:{heading:#}\n{{options}}"
    );
    with_negative_numbers(CommandLine::command().help_template(template))
}

/// Lets every option that takes a number take a negative one, so that the number is refused by its range and not as an
/// unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let is_number = |argument: &clap::Arg| {
        let kind = argument.get_value_parser().type_id();
        let numbers = [
            TypeId::of::<f64>(),
            TypeId::of::<u16>(),
            TypeId::of::<u32>(),
            TypeId::of::<u64>(),
            TypeId::of::<usize>(),
        ];
        argument.get_long().is_some() && numbers.into_iter().any(|number| kind == number)
    };
    command
        .mut_args(|argument| match is_number(&argument) {
            true => argument.allow_negative_numbers(true),
            false => argument,
        })
        .mut_subcommands(with_negative_numbers)
}

/// Returns the subcommand that was typed, so that errors show its usage.
fn meant(typed: &[OsString]) -> clap::Command {
    let mut command = command();
    command.build();
    for word in &typed[1..] {
        let Some(next) = command.find_subcommand(word) else {
            break;
        };
        command = next.clone();
    }
    command
}

/// Rewrites the error: states the expected number in words, and adds the commands closest to an unknown one.
fn in_words(mut error: clap::Error, typed: &[OsString]) -> clap::Error {
    if let Some(ContextValue::String(unknown)) = error.get(ContextKind::InvalidSubcommand) {
        let command = meant(typed);
        let names = command.get_subcommands().filter(|one| !one.is_hide_set());
        let near = nearest(unknown, names.map(clap::Command::get_name));
        let near: Vec<String> = near.into_iter().map(Into::into).collect();
        if !near.is_empty() {
            error.insert(
                ContextKind::SuggestedSubcommand,
                ContextValue::Strings(near),
            );
        }
        return error;
    }
    let cause = std::error::Error::source(&error).map(ToString::to_string);
    let (value, argument) = (
        error.get(ContextKind::InvalidValue),
        error.get(ContextKind::InvalidArg),
    );
    let (Some(cause), Some(value), Some(argument)) = (cause, value, argument) else {
        return error;
    };
    let from_one = cause.split_once(" is not in 1..");
    let expected = match &*cause {
        "invalid float literal" | "cannot parse float from empty string" => "a number such as 0.5",
        "invalid digit found in string" | "cannot parse integer from empty string" => {
            "a whole number such as 3"
        }
        "number too large to fit in target type" => "a smaller number",
        _ => match from_one {
            Some((_, end)) => match end.strip_prefix('=') {
                Some(most) => &format!("a whole number from 1 to {most}"),
                None => "a whole number from 1",
            },
            None => return error,
        },
    };
    let message = format!("invalid value '{value}' for '{argument}': expected {expected}");
    meant(typed).error(ErrorKind::ValueValidation, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_negative_number_is_the_value_of_its_option_in_every_command() {
        for typed in [
            "trim s.toml --at -1",
            "linearise s.toml --of plant --at -0.5",
            "margins s.toml --at -1 --amplitude -2",
            "set a=1 --at -1",
        ] {
            let words = ["hil"].into_iter().chain(typed.split(' '));
            let matches = command().try_get_matches_from(words);
            assert!(matches.is_ok(), "{typed}: {matches:?}");
        }
    }

    #[test]
    fn an_invalid_number_is_explained_in_words() {
        for (typed, expected) in [
            (
                "hil run a.toml --pace x",
                "'--pace <FACTOR>': expected a number such as 0.5",
            ),
            ("hil step x", "'[N]': expected a whole number such as 3"),
            (
                "hil run a.toml --record-every 0",
                "expected a whole number from 1\n",
            ),
            (
                "hil run a.toml --repeat 0",
                "expected a whole number from 1 to 10000",
            ),
        ] {
            let words: Vec<OsString> = typed.split(' ').map(Into::into).collect();
            let error = CommandLine::try_parse_from(&words).expect_err("refused");
            let message = in_words(error, &words).to_string();
            assert!(message.contains(expected), "{typed}: {message}");
            let usage = format!("Usage: {} ", words[..2].join(" ".as_ref()).display());
            assert!(message.contains(&usage), "{typed}: {message}");
        }
        let words = ["hil", "run"].map(OsString::from);
        let other = CommandLine::try_parse_from(&words).expect_err("refused");
        let message = other.to_string();
        assert_eq!(in_words(other, &words).to_string(), message);
    }

    #[test]
    fn an_unknown_command_suggests_the_nearest_ones() {
        for (typed, near) in [
            ("hil rnu a.toml", "'run'"),
            ("hil campain", "'campaign'"),
            ("hil campaign shwo x", "'show'"),
            ("hil config chekc x", "'check'"),
        ] {
            let words: Vec<OsString> = typed.split(' ').map(Into::into).collect();
            let error = CommandLine::try_parse_from(&words).expect_err("refused");
            let message = in_words(error, &words).to_string();
            let tip = message.split_once("exist").map_or("", |(_, tip)| tip);
            let first = tip.split_once(": ").map_or("", |(_, names)| names);
            assert!(first.starts_with(near), "{typed}: {message}");
        }
    }

    #[test]
    fn the_command_line_is_well_formed() {
        command().debug_assert();
    }

    #[test]
    fn help_lists_every_command_once_with_one_line() {
        let mut commands = CommandLine::command();
        commands.build();
        let commands = commands.get_subcommands().filter(|one| !one.is_hide_set());
        let mut commands: Vec<&str> = commands.map(clap::Command::get_name).collect();
        let mut listed: Vec<&str> = GROUPS
            .iter()
            .flat_map(|(_, names)| *names)
            .copied()
            .collect();
        commands.sort_unstable();
        listed.sort_unstable();
        assert_eq!(listed, commands);
        let help = command().render_long_help().to_string();
        for name in commands {
            let line = help
                .lines()
                .filter(|line| line.starts_with(&format!("  {name} ")));
            let line: Vec<&str> = line.collect();
            assert!(matches!(line[..], [line] if line.len() <= 80), "{line:?}");
        }
    }
}
