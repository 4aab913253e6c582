//! The command line of `hil panel`.

use std::path::PathBuf;

use clap::Args;
use hil_console::files::runs::run_path;
use hil_console::terminal::duration::seconds;
use hil_facts::arguments::SessionChoice;

use crate::arguments::baseline::BaselineChoice;
use crate::arguments::monitor::window;

/// Text behind the options in the help of `hil panel`.
pub const EXAMPLES: &str = "\
A page in a browser: live plots, readings, margins, faults; sliders for values that can be tuned;
pause, step, mark, inject. [panel] of a scenario chooses readings, sliders and buttons. Only this
machine can open the page, at a port of the system's choice, and only with the printed address and
its secret. Over ssh: ssh -L 8000:127.0.0.1:PORT HOST, and the address with port 8000.

With RUN the page shows a recorded run: zoom in to every step, measure between two cursors, search
for the times at which a formula holds.

The run has the same digest with and without the panel, unless a page changes the run. Up to 8 pages
may be open. The panel ends some seconds after the session, once no page is open, or by Ctrl-C.
That of a recorded run ends some seconds after its last page was closed, or by Ctrl-C.

Exit codes: 0 the session ended, or the recorded run was closed; 2 no such session, run, signal or
fault, or the recording is not complete; 3 shared memory or the network failed; 130 interrupted.

Examples:
  hil panel
  hil panel --session demo --no-open
  hil panel --signal 'truth.*force*' --signal tracking_error_rad --window 2s
  hil panel --inject 'leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5'
  hil run scenarios/spring-mass.toml --pace 1 --panel
  hil panel runs/demo
  hil panel runs/new --over runs/old
  hil panel --baseline severe-leakage-ftsc";

/// Arguments of `hil panel`.
#[derive(Debug, Args)]
pub struct PanelArguments {
    /// Folder of a recorded run or its run.mcap, or latest [default: a running session]
    #[arg(value_name = "RUN", value_parser = run_path(), conflicts_with_all = ["session", "wait", "run_of"])]
    pub run: Option<PathBuf>,
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
    /// Draw the curves of this recorded run behind those of the other
    #[arg(long, value_name = "RUN", value_parser = run_path(), conflicts_with = "baseline")]
    pub over: Option<PathBuf>,
    /// Baseline behind the curves
    #[command(flatten)]
    pub behind: BaselineChoice,
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
