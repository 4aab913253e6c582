//! The command lines of `hil linearise` and `hil trim`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use hil_facts::arguments::BinaryArguments;
use hil_facts::arguments::run::Changes;

/// Help of `hil linearise`.
pub const LINEARISE_EXAMPLES: &str = "\
The scenario runs up to the time; the programs then difference their own maps of one period on the
named numbers of their states (hil describe shows them). Of the plant, inputs are its commands and
outputs its measured signals; of the law, the samples and the commands; the loop has the references
and a disturbance of each command as inputs.

Exit codes: 0 written; 1 there is no linear model at this point, or a side does not name the numbers
of its state; 2 wrong usage or configuration.

Examples:
  hil linearise scenarios/spring-mass.toml --of plant -o plant.json
  hil linearise scenarios/spring-mass.toml --of loop --at 0.5 -o loop.json";

/// Part of the scenario that is linearised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Plant: from its commands to its measured signals.
    Plant,
    /// Law: from the signals of its sample to its commands.
    Law,
    /// Plant and law together, closed.
    Loop,
}

/// Arguments of `hil linearise`.
#[derive(Debug, Args)]
pub struct LineariseArguments {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml")]
    pub scenario: PathBuf,
    /// Part of the scenario
    #[arg(long, value_enum, value_name = "PART")]
    pub of: Part,
    /// Simulated time of the point, in s
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub at: f64,
    /// Write the model to this file, as JSON; - for standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    /// Changes of the scenario
    #[command(flatten)]
    pub changes: Changes,
    /// Binaries of the scenario
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Print the model as JSON
    #[arg(long)]
    pub json: bool,
}

/// Help of `hil trim`.
pub const TRIM_EXAMPLES: &str = "\
The scenario runs to its end; at the time of the point the state of the plant is solved for a period
that changes nothing, then that of the law for the commands that this needs. Held are commands,
numbers of the state and measured signals of the plant (hil describe shows them); free are commands.
The others keep the values of the point. The result is the run's checkpoint, for hil run --from.

Exit codes: 0 found; 1 there is no equilibrium, or the plant does not name the numbers of its state;
2 wrong usage or configuration.

Examples:
  hil trim scenarios/spring-mass.toml --hold force_n=5
  hil trim scenarios/spring-mass.toml --hold position_m=0.02 --free force_n --out runs/at-2cm";

/// Arguments of `hil trim`.
#[derive(Debug, Args)]
pub struct TrimArguments {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml", required_unless_present_any = ["hold", "free"])]
    pub scenario: Option<PathBuf>,
    /// Hold a number of the plant at a value; may be given several times
    #[arg(long, value_name = "SIGNAL=VALUE", num_args = 1..)]
    pub hold: Vec<String>,
    /// Let a command of the plant move; may be given several times
    #[arg(long, value_name = "SIGNAL", num_args = 1..)]
    pub free: Vec<String>,
    /// Simulated time of the point, in s [default: that of step 1]
    #[arg(long, value_name = "S")]
    pub at: Option<f64>,
    /// Folder of the run with the checkpoint [default: a new one below runs]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Changes of the scenario
    #[command(flatten)]
    pub changes: Changes,
    /// Binaries of the scenario
    #[command(flatten)]
    pub binaries: BinaryArguments,
    /// Print the equilibrium as JSON
    #[arg(long)]
    pub json: bool,
}

/// Scenario and lists of a trim, whatever their order on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResolvedLists<'a> {
    /// Scenario file.
    pub scenario: Option<&'a Path>,
    /// Held numbers with their values.
    pub hold: &'a [String],
    /// Free commands.
    pub free: &'a [String],
}

impl TrimArguments {
    /// Separates the scenario from a list in front of it, which takes all words that follow its flag.
    #[must_use]
    pub fn resolved<'a>(&'a self) -> ResolvedLists<'a> {
        let (hold, free) = (&self.hold[..], &self.free[..]);
        if let Some(scenario) = &self.scenario {
            let scenario = Some(scenario.as_path());
            return ResolvedLists {
                scenario,
                hold,
                free,
            };
        }
        let is_file = |word: &str| {
            let path = Path::new(word);
            path.extension().is_some_and(|ending| ending == "toml") || path.is_file()
        };
        let split = |list: &'a [String]| {
            let (last, rest) = list.split_last()?;
            is_file(last).then_some((Path::new(last), rest))
        };
        match (split(hold), split(free)) {
            (Some((scenario, hold)), _) => ResolvedLists {
                scenario: Some(scenario),
                hold,
                free,
            },
            (None, Some((scenario, free))) => ResolvedLists {
                scenario: Some(scenario),
                hold,
                free,
            },
            (None, None) => ResolvedLists {
                scenario: None,
                hold,
                free,
            },
        }
    }
}
