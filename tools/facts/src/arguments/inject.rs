//! The command line of `hil inject`.
//!
//! Each kind of fault has keys of its own, and the kinds depend on the running plant. Therefore an unknown flag is
//! treated as a key of the kind: [`arrange`] reorders the words so that they can be parsed without knowing the kinds.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{ArgGroup, Args, Parser, Subcommand};
use hil_console::terminal::duration::seconds;

use shared_types::table::nearest;

use crate::arguments::SessionChoice;

/// Usage lines of `hil inject`, which clap cannot derive from free keys.
pub const USAGE: &str = "\
hil inject KIND [TARGET[,TARGET]...] [VALUE]... [--KEY VALUE[,VALUE]...]... [OPTIONS]
       hil inject --list [--kind KIND] [--target TARGET]
       hil inject --active
       hil inject --clear ID|all";

/// Text after the options in the help of `hil inject`.
pub const EXAMPLES: &str = "\
Keys:
  A kind's own keys are given as --KEY VALUE; their last words may be omitted: --coefficient is
  coefficient_m3ps_per_sqrt_pa. Values without a key are taken in the order that --list shows. With
  several targets, VALUE,VALUE gives one to each and a single VALUE applies to all; all effects take
  hold at the same step. Times are written 2s, 500ms, 100us or as seconds.

Examples:
  hil inject --list
  hil inject --list --kind leakage
  hil inject leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5 --at 7
  hil inject bias measured.surface_angle_rad 0.01 --ramp 2s
  hil inject saturation command.actuator1_valve_current_a -0.001 0.001 --duration 500ms
  hil inject dropout measured.surface_angle_rad --when 'abs(truth.surface_angle_rad) > 0.1'
  hil inject message-loss link.sample --probability 0.1 --duration 1s
  hil inject message-loss link.command --pattern 1,0,0
  hil inject late controller 200 --occurrences 3
  hil inject scale parameter.actuator1.bulk_modulus_pa 0.5 --exponential 10
  hil inject --active
  hil inject --clear 3";

/// Command line of `hil inject` alone.
#[derive(Debug, Parser)]
#[command(name = "hil")]
pub struct InjectLine {
    /// Command.
    #[command(subcommand)]
    pub command: InjectCommand,
}

/// Its only command.
#[derive(Debug, Subcommand)]
pub enum InjectCommand {
    /// Inject a fault into a running session, or list and clear faults
    #[command(override_usage = USAGE, after_help = EXAMPLES)]
    Inject(Box<InjectArguments>),
}

/// Arguments of `hil inject`.
#[derive(Debug, Default, Args)]
#[command(group = ArgGroup::new("action").required(true))]
#[command(group = ArgGroup::new("instead").conflicts_with_all(["profile", "trigger"]))]
#[command(group = ArgGroup::new("profile"))]
#[command(group = ArgGroup::new("trigger"))]
pub struct InjectArguments {
    /// Kind of fault; see --list
    #[arg(group = "action")]
    pub kind: Option<String>,
    /// Target, then values of the kind's keys in their order
    #[arg(value_name = "TARGET|VALUE", conflicts_with = "instead")]
    pub words: Vec<String>,
    /// Key of the kind that has the name of an option of hil; all other keys are given as --KEY VALUE
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_value, conflicts_with = "instead")]
    pub parameter: Vec<(String, String)>,

    /// Grow linearly to full size over this time
    #[arg(long, value_name = "TIME", value_parser = seconds, group = "profile", help_heading = "Profile")]
    pub ramp: Option<f64>,
    /// Grow as 1 - exp(-SPEED t), SPEED in 1/s
    #[arg(
        long,
        value_name = "SPEED",
        group = "profile",
        help_heading = "Profile"
    )]
    pub exponential: Option<f64>,
    /// Act for this long, then stop
    #[arg(long, value_name = "TIME", value_parser = seconds, group = "profile", help_heading = "Profile")]
    pub pulse: Option<f64>,
    /// Act in the first part of every period, for the share DUTY
    #[arg(long, value_name = "PERIOD,DUTY", value_parser = intermittent, group = "profile", help_heading = "Profile")]
    pub intermittent: Option<(f64, f64)>,
    /// Vary as a sine of FREQUENCY in Hz and PHASE in rad
    #[arg(long, value_name = "FREQUENCY[,PHASE]", value_parser = sine, group = "profile", help_heading = "Profile")]
    pub sine: Option<(f64, f64)>,
    /// Follow the points of a file with a column of times and one of values
    #[arg(
        long,
        value_name = "FILE.csv",
        group = "profile",
        help_heading = "Profile"
    )]
    pub table: Option<PathBuf>,

    /// Take effect at this simulated time [default without a trigger: at the next step]
    #[arg(long, value_name = "TIME", value_parser = seconds, group = "trigger", help_heading = "Trigger")]
    pub at: Option<f64>,
    /// Take effect at this step
    #[arg(long, value_name = "STEP", group = "trigger", help_heading = "Trigger")]
    pub at_step: Option<u64>,
    /// Take effect when an expression over signals holds
    #[arg(
        long,
        value_name = "EXPRESSION",
        group = "trigger",
        help_heading = "Trigger"
    )]
    pub when: Option<String>,
    /// Time that the condition must hold
    #[arg(long = "for", value_name = "TIME", value_parser = seconds, requires = "when", help_heading = "Trigger")]
    pub hold: Option<f64>,
    /// Take effect after another fault has taken effect
    #[arg(
        long,
        value_name = "ID|NAME",
        group = "trigger",
        help_heading = "Trigger"
    )]
    pub after: Option<String>,
    /// Delay after the other fault
    #[arg(long, value_name = "TIME", value_parser = seconds, requires = "after", help_heading = "Trigger")]
    pub delay: Option<f64>,
    /// Delay of each further target
    #[arg(long, value_name = "TIME[,TIME]...", value_parser = seconds, value_delimiter = ',', conflicts_with = "instead", help_heading = "Trigger")]
    pub skew: Vec<f64>,

    /// End after this long
    #[arg(long, value_name = "TIME", value_parser = seconds, conflicts_with = "instead", help_heading = "End")]
    pub duration: Option<f64>,
    /// End at this simulated time
    #[arg(long, value_name = "TIME", value_parser = seconds, conflicts_with = "instead", help_heading = "End")]
    pub end: Option<f64>,
    /// End when an expression over signals holds
    #[arg(
        long,
        value_name = "EXPRESSION",
        conflicts_with = "instead",
        help_heading = "End"
    )]
    pub until: Option<String>,
    /// Time that the condition must hold
    #[arg(long, value_name = "TIME", value_parser = seconds, requires = "until", help_heading = "End")]
    pub until_for: Option<f64>,
    /// End after the fault has acted COUNT times
    #[arg(
        long,
        value_name = "COUNT",
        conflicts_with = "instead",
        help_heading = "End"
    )]
    pub occurrences: Option<u64>,

    /// Name that later faults can refer to with --after
    #[arg(long, conflicts_with = "instead")]
    pub name: Option<String>,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,

    /// List the possible faults
    #[arg(long, groups = ["action", "instead"], help_heading = "Instead of a fault")]
    pub list: bool,
    /// Show one kind in full
    #[arg(
        id = "list_kind",
        long = "kind",
        value_name = "KIND",
        requires = "list",
        conflicts_with_all = ["kind", "active", "clear"],
        help_heading = "Instead of a fault"
    )]
    pub list_kind: Option<String>,
    /// List the possible faults on one target
    #[arg(
        long,
        value_name = "TARGET",
        requires = "list",
        conflicts_with_all = ["kind", "active", "clear"],
        help_heading = "Instead of a fault"
    )]
    pub target: Option<String>,
    /// Ask this plant program instead of a session
    #[arg(
        long,
        value_name = "PATH",
        requires = "list", conflicts_with_all = ["kind", "session", "active", "clear"],
        help_heading = "Instead of a fault"
    )]
    pub plant_bin: Option<PathBuf>,
    /// Plant of the binary [default: all]
    #[arg(
        long,
        value_name = "NAME",
        requires = "list", conflicts_with_all = ["kind", "session", "active", "clear"],
        help_heading = "Instead of a fault"
    )]
    pub model: Option<String>,
    /// List the faults that are active or waiting
    #[arg(long, groups = ["action", "instead"], help_heading = "Instead of a fault")]
    pub active: bool,
    /// End one fault, or all faults
    #[arg(long, value_name = "ID|all", value_parser = clear, groups = ["action", "instead"], help_heading = "Instead of a fault")]
    pub clear: Option<Clear>,
}

/// Selection of the faults to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clear {
    /// All faults.
    All,
    /// Fault with this number.
    One(u32),
}

fn clear(text: &str) -> Result<Clear, String> {
    match text {
        "all" => Ok(Clear::All),
        _ => (text.parse().map(Clear::One))
            .map_err(|_| "expected the number of a fault, or `all`".into()),
    }
}

fn key_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.is_empty() && !value.is_empty() => {
            Ok((key.replace('-', "_"), value.into()))
        }
        _ => {
            let key = text.trim_end_matches('=');
            let near = nearest_options(key).into_iter().next();
            let near = near.map_or(String::new(), |near| format!("; nearest: `{near}`"));
            Err(format!("`--{key}` needs a value{near}"))
        }
    }
}

/// Returns the options of `hil inject` closest to a name.
pub(crate) fn nearest_options(name: &str) -> Vec<String> {
    let mut command = InjectArguments::augment_args(clap::Command::new("inject"));
    command.build();
    let names = command.get_arguments().filter_map(clap::Arg::get_long);
    let near = nearest(&name.replace('_', "-"), names);
    near.into_iter().map(|name| format!("--{name}")).collect()
}

fn intermittent(text: &str) -> Result<(f64, f64), String> {
    let expected = || "a period and a duty, for example 100ms,0.2".to_owned();
    let (period, duty) = text.split_once(',').ok_or_else(expected)?;
    Ok((
        seconds(period)?,
        duty.trim().parse().map_err(|_| expected())?,
    ))
}

fn sine(text: &str) -> Result<(f64, f64), String> {
    let expected = |_| "a frequency in Hz and a phase in rad, for example 5 or 5,1.57".to_owned();
    let (frequency, phase) = text.split_once(',').unwrap_or((text, "0"));
    Ok((
        frequency.trim().parse().map_err(expected)?,
        phase.trim().parse().map_err(expected)?,
    ))
}

/// Reorders the words after `hil inject` so that they can be parsed without knowing the kinds. First come the options
/// of `hil`, each in one piece with its value, and the kind's own `--KEY VALUE` as `--parameter=KEY=VALUE`; then the
/// other words, where negative numbers are not taken for options.
#[must_use]
pub fn arrange(typed: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut typed = typed.into_iter().peekable();
    let mut options: Vec<OsString> = typed.by_ref().take(1).collect();
    if typed.peek().is_none_or(|command| command != "inject") {
        options.extend(typed);
        return options;
    }
    options.extend(typed.next());
    let mut inject = InjectArguments::augment_args(clap::Command::new("inject"));
    inject.build();
    // For an option of hil: `true` if it takes a value.
    let takes_value = |name: &str| {
        let argument = inject
            .get_arguments()
            .find(|argument| argument.get_long() == Some(name));
        argument.map(|argument| argument.get_action().takes_values())
    };
    let mut words = Vec::new();
    while let Some(token) = typed.next() {
        let text = token.to_str().unwrap_or_default();
        if text == "--" {
            words.extend(typed);
            break;
        }
        let Some(flag) = text.strip_prefix("--") else {
            let to = if text == "-h" {
                &mut options
            } else {
                &mut words
            };
            to.push(token);
            continue;
        };
        let (name, value) = match flag.split_once('=') {
            Some((name, value)) => (name, Some(value)),
            None => (flag, None),
        };
        let is_own = takes_value(name);
        let mut option = OsString::from(match is_own {
            Some(_) => format!("--{name}"),
            None => format!("--parameter={name}"),
        });
        let next_is_value = |next: &OsString| {
            // An option of hil takes the next word as its value; after a key, another option may follow.
            is_own.is_some() || !next.to_str().is_some_and(|next| next.starts_with("--"))
        };
        let value = match value {
            Some(value) => Some(OsString::from(value)),
            None if is_own == Some(false) => None,
            None => typed.next_if(next_is_value),
        };
        if let Some(value) = value {
            option.push("=");
            option.push(value);
        }
        options.push(option);
    }
    options.push("--".into());
    options.extend(words);
    options
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arranged(line: &str) -> String {
        let words = line.split(' ').map(OsString::from);
        let arranged: Vec<String> = (arrange(words).into_iter())
            .map(|word| word.into_string().expect("text"))
            .collect();
        arranged.join(" ")
    }

    #[test]
    fn keys_of_kinds_and_negative_numbers_are_distinguished_from_options() {
        for (typed, expected) in [
            ("hil run a.toml --json", "hil run a.toml --json"),
            ("hil inject --list --json", "hil inject --list --json --"),
            (
                "hil inject leakage --actuator 1,2 --at 7 --speed=10,0.5",
                "hil inject --parameter=actuator=1,2 --at=7 --parameter=speed=10,0.5 -- leakage",
            ),
            (
                "hil inject saturation measured.x -1 -0.5,2 --json",
                "hil inject --json -- saturation measured.x -1 -0.5,2",
            ),
            (
                "hil inject bias x --bias -0.01 --when -truth.x>1",
                "hil inject --parameter=bias=-0.01 --when=-truth.x>1 -- bias x",
            ),
            (
                "hil inject bias x --bias --json",
                "hil inject --parameter=bias --json -- bias x",
            ),
            ("hil inject -h", "hil inject -h --"),
            ("hil inject bias -- --odd", "hil inject -- bias --odd"),
        ] {
            assert_eq!(arranged(typed), expected, "{typed}");
        }
    }
}
