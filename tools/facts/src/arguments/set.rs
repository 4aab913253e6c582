//! The command line of `hil set`.

use clap::Args;
use hil_console::terminal::duration::seconds;

use crate::arguments::SessionChoice;

/// Explanation and examples of `hil set`.
pub const HELP: &str = "\
All keys change at one step, or none does: keys, ranges and combinations are checked as in a
scenario. The change is an event of the recording and part of the digest, as a fault is: hil rerun
repeats the change, and hil scenario from writes it as [[changes]]. On a faulted parameter the base
value changes, and the fault acts on the new value. `hil get --tunable` lists the keys.

Exit codes: 0 changed; 2 no such session, or refused and nothing changed; 3 the plant gave no answer.

Examples:
  hil set controller.pid.proportional_n_per_m=600 plant.parameters.mass_kg=1.2
  hil set reference.position_m=0.02 --ramp 500ms
  hil set plant.parameters.mass_kg=2 --at 3.5
  hil set --clear reference.position_m";

/// Arguments of `hil set`.
#[derive(Debug, Args)]
pub struct SetArguments {
    /// Key as in a scenario, and its new value
    #[arg(value_name = "KEY=VALUE", value_parser = pair, required_unless_present = "clear")]
    pub set: Vec<(String, f64)>,
    /// Reference signal that will follow its stimulus again
    #[arg(long, value_name = "KEY")]
    pub clear: Vec<String>,
    /// Simulated time in s of the change [default: the next step]
    #[arg(long, value_name = "SIM_SECONDS")]
    pub at: Option<f64>,
    /// Duration of a linear change to the new values
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub ramp: Option<f64>,
    /// Session
    #[command(flatten)]
    pub session: SessionChoice,
}

fn pair(text: &str) -> Result<(String, f64), String> {
    let (key, value) = text
        .split_once('=')
        .ok_or("expected KEY=VALUE, such as plant.parameters.mass_kg=1.2")?;
    let number = value.trim().parse();
    let number = number.map_err(|_| format!("`{value}` is not a number"))?;
    Ok((key.trim().to_owned(), number))
}
