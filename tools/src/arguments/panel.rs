//! The command line of `hil panel`, and that of a run with one.

use clap::Args;

use super::SessionChoice;
use super::monitor::window;
use crate::terminal::duration::seconds;

pub(super) const EXAMPLES: &str = "\
A page in a browser: plots that follow, readings, margins, faults; sliders for what can be tuned; pause,
step, mark, inject. [panel] of a scenario chooses readings, sliders and buttons. Only this machine reaches it, at a port of the system's choice, and only who has the printed address with its
secret. Over ssh: ssh -L 8000:127.0.0.1:PORT HOST, and the address with 8000 in place of the port.

The run has the same digest with it and without it, unless a page changes the run. Up to 8 pages may be
open. It ends some seconds after the session, when no page is open any more, or by Ctrl-C.

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
    /// Draw a signal, or several with * and ?; may be given several times [default: as hil monitor]
    #[arg(long, value_name = "PATTERN")]
    pub signal: Vec<String>,
    /// Width of the time axis in simulated time, to begin with [default: that of the scenario, or 5s]
    #[arg(long, value_name = "TIME", value_parser = window)]
    pub window: Option<f64>,
    /// Prepare a fault for a button, with the words of `hil inject`
    #[arg(long, value_name = "FAULT", allow_hyphen_values = true)]
    pub inject: Vec<String>,
    /// Wait so long for a session to start
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub wait: Option<f64>,
    /// Print the address only; open no browser
    #[arg(long)]
    pub no_open: bool,
    /// The process whose session is shown, until it ends
    #[arg(long, value_name = "PID", hide = true, conflicts_with_all = ["session", "wait"])]
    pub run_of: Option<u32>,
}

/// The panel of a run.
#[derive(Clone, Debug, Default, Args)]
pub struct RunPanelArguments {
    /// Show the run in a browser while it goes on; see hil panel
    #[arg(long)]
    pub panel: bool,
    /// With --panel: print the address only; open no browser
    #[arg(long, requires = "panel")]
    pub no_open: bool,
}
