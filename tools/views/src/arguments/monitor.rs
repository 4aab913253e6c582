//! The command line of `hil monitor`.

use std::net::{Ipv4Addr, SocketAddr};

use clap::Args;
use hil_console::terminal::duration::seconds;
use hil_facts::arguments::SessionChoice;

/// Text behind the options in the help of `hil monitor`.
pub const EXAMPLES: &str = "\
Watches only: the run has the same digest with and without the monitor, unless a key pauses, steps
or injects a fault. Up to 3 monitors may watch a session. Without a terminal, or with --once or
--json, it prints the state of the run once.

Keys: q quit, p pause, r resume, s one step, S 100 steps, tab next plots, + - window, 1 to 9 prepared
faults, c end all faults, ? help.

Exit codes: 0 quit, or the session ended; 2 no such session, signal or fault; 3 the terminal or shared
memory failed; 130 interrupted.

Examples:
  hil monitor
  hil monitor --session demo --signal 'truth.*force*' --signal tracking_error_rad --window 2s
  hil monitor --inject 'leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5'
  hil monitor --wait 10s
  hil monitor --json | jq .step";

/// Arguments of `hil monitor`.
#[derive(Debug, Args)]
pub struct MonitorArguments {
    /// Session
    #[command(flatten)]
    pub choice: SessionChoice,
    /// Signal to draw, or a pattern with * and ?; may be given several times [default: references with the
    /// signals that follow them, derived signals, commands, then the rest of the truth]
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// Width of the time axis in simulated time
    #[arg(long, value_name = "TIME", value_parser = window, default_value = "5s")]
    pub window: f64,
    /// Prepare a fault for the next of the keys 1 to 9, written as for `hil inject`
    #[arg(long, value_name = "FAULT", allow_hyphen_values = true)]
    pub inject: Vec<String>,
    /// Longest wait for a session to start
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub wait: Option<f64>,
    /// Print the state of the run once, even on a terminal
    #[arg(long)]
    pub once: bool,
    /// Serve the signals to Foxglove over a WebSocket; without a terminal do only that. Other machines can
    /// connect only at a given ADDRESS
    #[arg(
        long,
        value_name = "ADDRESS",
        value_parser = address,
        num_args = 0..=1,
        default_missing_value = "127.0.0.1:8765",
        conflicts_with_all = ["once", "json"]
    )]
    pub foxglove: Option<SocketAddr>,
    /// With --foxglove: serve at most HZ records per second, picked and not averaged; inf serves all
    #[arg(long, value_name = "HZ", value_parser = rate, default_value = "200")]
    pub rate: f64,
}

/// Parses a socket address, or a port, which is opened on the loopback interface only.
fn address(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse() {
        return Ok(SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    }
    text.parse()
        .map_err(|_| "expected a port or an address such as 127.0.0.1:8765".into())
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if rate > 0.0 => Ok(rate),
        _ => Err("expected a number of records per second above 0".into()),
    }
}

/// Parses the width of a time axis.
pub(crate) fn window(text: &str) -> Result<f64, String> {
    let window_s = seconds(text)?;
    if (1e-6..=86_400.0).contains(&window_s) {
        Ok(window_s)
    } else {
        Err(format!(
            "`{text}` is not a valid time-axis width; use 1us to 24h"
        ))
    }
}
