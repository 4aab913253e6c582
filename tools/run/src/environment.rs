//! Data of a run outside its scenario: its programs and settings, the run or checkpoint that it repeats or continues,
//! and its result.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_facts::checkpoint::branch::Branch;
use hil_facts::checkpoint::past::Past;
use hil_facts::programs::binaries::Binaries;
use hil_facts::results::curve::Curve;
use hil_facts::results::restoration::Check;
use hil_facts::results::summary::Summary;
use plant_process::repeat::Missed;
use shared_types::time::Step;

use super::settings::{Settings, refuse_in_process};

/// Environment of a run, independent of its scenario.
#[derive(Clone)]
pub struct Environment {
    /// Programs of both sides.
    pub binaries: Arc<Binaries>,
    /// Settings from the command line.
    pub settings: Settings,
    /// Signals that end the run early.
    pub interruption: Interruption,
}

/// Origin of a run in addition to its scenario.
pub enum Origin {
    /// Nothing else.
    Scenario,
    /// Recorded run to repeat.
    Repeated(Repeated),
    /// Checkpoint from which to continue.
    Checkpoint(Box<Past>, Branch),
}

impl Origin {
    /// Returns the first step that the run exchanges.
    pub const fn first(&self) -> Step {
        match self {
            Self::Checkpoint(past, _) => past.first(),
            Self::Scenario | Self::Repeated(_) => Step(0),
        }
    }
}

/// Facts of a recorded run that a rerun repeats.
pub struct Repeated {
    /// Number of records to compare.
    pub records: u64,
    /// Steps at which its controller was late.
    pub missed: Vec<Missed>,
}

/// Result of a run.
pub struct RunResult {
    /// Exit code of the run.
    pub exit: Exit,
    /// Digests after certain numbers of records, as far as requested and available.
    pub partial_digests: BTreeMap<u64, String>,
    /// Curve of a campaign's case, if recorded.
    pub curve: Option<Curve>,
    /// Recording, if there is one.
    pub recording: Option<PathBuf>,
    /// Path of the run's folder.
    pub folder: PathBuf,
    /// Summary of the run.
    pub summary: Summary,
    /// Summary as JSON.
    pub json: String,
    /// Returns the summary as a table.
    pub table: String,
    /// Failure to write the summary. Reported after the summary, because neither a full disk nor a broken output may
    /// hide the other.
    pub written: Result<(), Failure>,
}

impl RunResult {
    /// Returns the check of the run's first checkpoint.
    pub fn first_check(&self) -> Option<&Check> {
        self.summary.checkpoints.first()?.check.as_ref()
    }
}

impl Environment {
    /// Combines settings and programs.
    ///
    /// # Errors
    /// If the programs do not suit the settings.
    pub fn new(
        settings: &Settings,
        binaries: Arc<Binaries>,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        refuse_in_process(settings.link, &[&binaries.plant, &binaries.controller])?;
        Ok(Self {
            binaries,
            settings: settings.clone(),
            interruption: interruption.clone(),
        })
    }
}
