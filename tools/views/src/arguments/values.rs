//! The command lines of `hil get` and `hil watch`.

use clap::Args;
use hil_console::terminal::duration::seconds;
use hil_facts::arguments::SessionChoice;

/// Text behind the options in the help of `hil get`.
pub const GET_EXAMPLES: &str = "\
Exit codes: 0 printed; 2 no such session or signal, or no step executed yet; 3 the plant gave no
answer.

Examples:
  hil get
  hil get 'truth.*force*' tracking_error_rad
  hil get --tunable 'controller.*'
  hil get --json truth.position_m | jq '.signals[0].value'";

/// Text behind the options in the help of `hil watch`.
pub const WATCH_EXAMPLES: &str = "\
Watches only: the run has the same digest with and without it. A line is printed when there is a
newer step; a held run has none.

Exit codes: 0 the session ended, or all lines were printed; 2 no such session or signal; 130
interrupted.

Examples:
  hil watch truth.position_m command.force_n
  hil watch --every 2s --json 'truth.*' > values.jsonl
  hil watch --count 10 tracking_error_rad";

/// Arguments of `hil get`.
#[derive(Debug, Args)]
pub struct GetArguments {
    /// Signal name, or a pattern with * and ? [default: all]
    #[arg(value_name = "SIGNAL")]
    pub signals: Vec<String>,
    /// List the keys that `hil set` can change, with their values, instead of signals
    #[arg(long)]
    pub tunable: bool,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}

/// Arguments of `hil watch`.
#[derive(Debug, Args)]
pub struct WatchArguments {
    /// Signal name, or a pattern with * and ?
    #[arg(value_name = "SIGNAL", required = true)]
    pub signals: Vec<String>,
    /// Shortest time between two lines
    #[arg(long, value_name = "TIME", value_parser = every, default_value = "500ms")]
    pub every: f64,
    /// End after N lines
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}

fn every(text: &str) -> Result<f64, String> {
    let every_s = seconds(text)?;
    if every_s <= 86_400.0 {
        Ok(every_s)
    } else {
        Err(format!("`{text}` is longer than a day"))
    }
}
