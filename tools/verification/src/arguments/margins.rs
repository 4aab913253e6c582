//! The command line of `hil margins`.

use std::path::PathBuf;

use clap::Args;
use hil_facts::arguments::BinaryArguments;

/// Examples in the help of `hil margins`.
pub const EXAMPLES: &str = "\
Exit codes: 0 every margin was measured; 1 one was refused, with its reason; 2 wrong usage or
configuration; 3 a program died or did not answer, or the file could not be written; 130 interrupted.

Examples:
  hil margins scenarios/spring-mass.toml
  hil margins scenarios/spring-mass.toml --at 2 --at 5 --frequencies 0.5..100
  hil margins scenarios/spring-mass.toml --set controller.pid.proportional_n_per_m=600 --json
  hil margins scenarios/spring-mass.toml -o loop.csv
  hil margins examples/own-plant/pendulum.toml";

/// Arguments of `hil margins`.
#[derive(Debug, Args)]
pub struct MarginsArguments {
    /// Scenario file
    #[arg(value_name = "SCENARIO.toml")]
    pub scenario: PathBuf,
    /// Change a value of the scenario; may be given several times, once per value
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Programs of plant and controller
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Simulated time in s at which the probe begins; may be given several times [default: the end of the
    /// scenario]
    #[arg(long, value_name = "S")]
    pub at: Vec<f64>,
    /// Keep only this fault event of the scenario, numbered from 1; 0 removes all [default: keep all]
    #[arg(long, value_name = "N")]
    pub fault: Option<usize>,
    /// Probe only this command; may be given several times [default: each in turn]
    #[arg(long, value_name = "NAME")]
    pub command: Vec<String>,
    /// Amplitude of the probe in the unit of the command [default: 1 % of the largest command]
    #[arg(long, value_name = "A")]
    pub amplitude: Option<f64>,
    /// Frequencies in Hz, and optionally the number of the first ones [default: 0.2 to 0.45 times the
    /// rate, 60]
    #[arg(long, value_name = "LO..HI[/COUNT]")]
    pub frequencies: Option<String>,
    /// Write the frequency response of the open loop to this CSV file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
