//! Data of a run around its scenario: what it is made with, what it repeats or goes on from, and what comes of it.

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

/// Environment of a run, whatever its scenario.
#[derive(Clone)]
pub struct Environment {
    pub binaries: Arc<Binaries>,
    pub settings: Settings,
    pub interruption: Interruption,
}

/// Origin of a run, besides its scenario.
pub enum Origin {
    /// Nothing else.
    Scenario,
    /// A recorded run that it repeats.
    Repeated(Repeated),
    /// A checkpoint that it goes on from.
    Checkpoint(Box<Past>, Branch),
}

impl Origin {
    /// Gives the first step that the run exchanges.
    pub const fn first(&self) -> Step {
        match self {
            Self::Checkpoint(past, _) => past.first(),
            Self::Scenario | Self::Repeated(_) => Step(0),
        }
    }
}

/// Facts of a recorded run that a rerun repeats.
pub struct Repeated {
    /// Number of its records that are compared.
    pub records: u64,
    /// Steps at which its controller was not in time.
    pub missed: Vec<Missed>,
}

/// Result of a run.
pub struct RunResult {
    pub exit: Exit,
    /// Digests after the first records, by their number, as far as they were asked for and
    /// exist.
    pub partial_digests: BTreeMap<u64, String>,
    /// Curve of a campaign's case, if one is kept.
    pub curve: Option<Curve>,
    /// Recording, if there is one.
    pub recording: Option<PathBuf>,
    /// Folder of the run.
    pub folder: PathBuf,
    pub summary: Summary,
    /// The summary as a machine reads it.
    pub json: String,
    /// The summary as a person reads it.
    pub table: String,
    /// Failure to write the summary. To be told after the summary: neither a full disk nor a broken
    /// output may hide the other.
    pub written: Result<(), Failure>,
}

impl RunResult {
    /// Returns the check of the first checkpoint that the run made.
    pub fn first_check(&self) -> Option<&Check> {
        self.summary.checkpoints.first()?.check.as_ref()
    }
}

impl Environment {
    /// Joins settings and programs.
    ///
    /// # Errors
    /// If the programs do not go with the settings.
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
