//! The command line of `hil panel`.

use clap::Args;
use hil_console::terminal::duration::seconds;
use hil_facts::arguments::SessionChoice;

use crate::arguments::monitor::window;

/// Text behind the options in the help of `hil panel`.
pub const EXAMPLES: &str = "\
A page in a browser: live plots, readings, margins, faults; sliders for values that can be tuned;
pause, step, mark, inject. [panel] of a scenario chooses readings, sliders and buttons. Only this
machine can open the page, at a port of the system's choice, and only with the printed address and
its secret. Over ssh: ssh -L 8000:127.0.0.1:PORT HOST, and the address with port 8000.

The run has the same digest with and without the panel, unless a page changes the run. Up to 8 pages
may be open. The panel ends some seconds after the session, once no page is open, or by Ctrl-C.

Exit codes: 0 the session ended; 2 no such session, signal or fault; 3 shared memory or the network
failed; 130 interrupted.

Examples:
  hil panel
  hil panel --session demo --no-open
  hil panel --signal 'truth.*force*' --signal tracking_error_rad --window 2s
  hil panel --inject 'leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5'
  hil run scenarios/spring-mass.toml --pace 1 --panel";

/// Arguments of `hil panel`.
#[derive(Debug, Args)]
pub struct PanelArguments {
    /// Session
    #[command(flatten)]
    pub choice: SessionChoice,
    /// Signal to draw, or a pattern with * and ?; may be given several times [default: as hil monitor]
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// Initial width of the time axis in simulated time [default: that of the scenario, or 5s]
    #[arg(long, value_name = "TIME", value_parser = window)]
    pub window: Option<f64>,
    /// Prepare a fault for a button, written as for `hil inject`
    #[arg(long, value_name = "FAULT", allow_hyphen_values = true)]
    pub inject: Vec<String>,
    /// Longest wait for a session to start
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub wait: Option<f64>,
    /// Print the address only; open no browser
    #[arg(long)]
    pub no_open: bool,
    /// The process whose session is shown, until it ends
    #[arg(long, value_name = "PID", hide = true, conflicts_with_all = ["session", "wait"])]
    pub run_of: Option<u32>,
}
