//! Scenario checked against the descriptions of a run's programs, as stored by a session or a recording.

use std::path::Path;

use hil_config::plan::Plan;
use hil_config::scenario::{Advice, Scenario};
use hil_console::terminal::exit::Failure;
use hil_recording::reader::folder_of;
use shared_types::describe::Description;

use crate::tables::FORMATS;

/// Returns the plan of a scenario, checked against the descriptions of plant and controller. Its files are relative to
/// the folder of its origin: a file, or the folder of a run.
///
/// # Errors
/// All problems of the scenario.
pub fn checked(
    text: &str,
    origin: &Path,
    plant: &Description,
    controller: &Description,
) -> Result<Plan, Failure> {
    checked_beside(folder_of(origin), of_run(), text, origin, plant, controller)
}

/// Returns the advice on programs that a run has.
#[must_use]
pub fn of_run() -> Advice {
    Advice {
        plant: "these are the plants of the run's own plant program".into(),
        law: "these are the laws of the run's own controller program".into(),
    }
}

/// Like [`checked`], with the folder of the scenario's files and other advice.
///
/// # Errors
/// All problems of the scenario.
pub fn checked_beside(
    folder: &Path,
    advice: Advice,
    text: &str,
    origin: &Path,
    plant: &Description,
    controller: &Description,
) -> Result<Plan, Failure> {
    Scenario::parse(text, origin)
        .map(|scenario| scenario.advise(advice).beside(folder).with_formats(FORMATS))
        .and_then(|scenario| scenario.check(&plant.plants, &controller.laws, &plant.faults))
        .map_err(Failure::from)
}
