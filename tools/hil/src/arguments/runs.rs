//! The command lines of `hil runs`.

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use clap::{Args, Subcommand, ValueEnum};
use glob::Pattern;
use hil_console::files::runs::RUNS;
use serde::Serialize;

pub(super) const EXAMPLES: &str = "\
A run is a folder with a scenario.toml that hil run wrote. `latest` is the newest run below runs, in
every command that takes a run: hil report latest, hil compare latest runs/demo.

Examples:
  hil runs
  hil runs --scenario 'severe*' --verdict fail --since 2d
  hil runs --sort margin --last 10
  hil runs --json | jq -r '.runs[] | select(.set != []) | .path'
  hil runs rm --keep-last 10 --keep-failed
  hil runs rm --older-than 30d --yes";

pub(super) const RM_EXAMPLES: &str = "\
Shows which runs would be removed; only --yes removes them. Running sessions stay, and so do folders
with files that no command of hil writes.

Exit codes: 0 shown or removed; 2 no rule or no such folder; 3 something could not be removed.

Examples:
  hil runs rm --keep-last 10                     # what would go?
  hil runs rm --keep-last 10 --keep-failed --yes
  hil runs rm --scenario 'spring*' --older-than 7d --yes
  hil runs rm --keep-last 0 --yes                # all";

/// Arguments of `hil runs`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct RunsArguments {
    /// Action.
    #[command(subcommand)]
    pub action: Option<RunsAction>,
    /// Choice of runs
    #[command(flatten)]
    pub choice: RunChoice,
    /// Sort order; the newest run, smallest margin or largest size comes first
    #[arg(long, value_enum, default_value_t = Order::Time, value_name = "BY")]
    pub sort: Order,
    /// Reverse the order
    #[arg(long)]
    pub reverse: bool,
    /// Largest number of runs to list
    #[arg(long, value_name = "N")]
    pub last: Option<usize>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Actions of `hil runs`.
#[derive(Debug, Subcommand)]
pub enum RunsAction {
    /// Remove runs by a rule
    #[command(after_help = RM_EXAMPLES)]
    Rm(RemovalArguments),
}

/// Arguments of `hil runs rm`.
#[derive(Debug, Args)]
pub struct RemovalArguments {
    /// Choice of runs
    #[command(flatten)]
    pub choice: RunChoice,
    /// Only runs that began longer ago than this
    #[arg(long, value_name = "AGE", value_parser = humantime::parse_duration)]
    pub older_than: Option<Duration>,
    /// Keep the N newest of the chosen runs
    #[arg(long, value_name = "N")]
    pub keep_last: Option<usize>,
    /// Keep runs that did not pass
    #[arg(long)]
    pub keep_failed: bool,
    /// Remove the runs instead of only listing them
    #[arg(long)]
    pub yes: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Choice of runs.
#[derive(Debug, Args)]
pub struct RunChoice {
    /// Folder that contains the runs
    #[arg(value_name = "FOLDER", default_value = RUNS)]
    pub folder: PathBuf,
    /// Only runs of this scenario, or of scenarios that match a pattern with * and ?
    #[arg(long, value_name = "NAME", value_parser = Pattern::new)]
    pub scenario: Option<Pattern>,
    /// Only runs with this verdict; may be given several times
    #[arg(long, value_enum, value_name = "VERDICT")]
    pub verdict: Vec<Ending>,
    /// Only runs that began since: an age such as 2d or 3h 20m, or a time such as 2026-11-20 or
    /// 2026-11-20T14:00:00Z
    #[arg(long, value_name = "TIME", value_parser = since)]
    pub since: Option<SystemTime>,
}

impl RunChoice {
    /// Returns `true` if the choice excludes any runs.
    pub(crate) fn is_a_rule(&self) -> bool {
        self.scenario.is_some() || !self.verdict.is_empty() || self.since.is_some()
    }
}

/// Outcome of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Ending {
    /// A requirement failed.
    Fail,
    /// Aborted before its last step.
    Aborted,
    /// Ended without a verdict because hil died.
    Broken,
    /// Still running.
    Running,
    /// All requirements passed.
    Pass,
}

impl Ending {
    /// Returns the name in tables and in JSON.
    #[must_use]
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Fail => "fail",
            Self::Aborted => "aborted",
            Self::Broken => "broken",
            Self::Running => "running",
            Self::Pass => "pass",
        }
    }
}

/// Sort order of runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Order {
    /// Start time.
    Time,
    /// Scenario name.
    Scenario,
    /// Failed runs come first.
    Verdict,
    /// Smallest robustness of a requirement.
    Margin,
    /// Size of the folder in bytes.
    Size,
}

fn since(text: &str) -> Result<SystemTime, String> {
    if let Ok(age) = humantime::parse_duration(text) {
        return SystemTime::now()
            .checked_sub(age)
            .ok_or_else(|| format!("`{text}` is too long ago"));
    }
    let timestamp = match text.len() {
        10 => format!("{text}T00:00:00Z"),
        _ => text.to_owned(),
    };
    humantime::parse_rfc3339_weak(&timestamp).map_err(|_| {
        format!("`{text}` is neither an age such as 2d or 3h nor a UTC time such as 2026-11-20 or 2026-11-20T14:00:00Z")
    })
}
