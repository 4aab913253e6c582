//! Scenario checked against the descriptions of a run's programs, as stored by a session or a recording.

use std::path::Path;

use hil_config::plan::Plan;
use hil_config::scenario::{Advice, Scenario};
use hil_console::terminal::exit::Failure;
use shared_types::describe::Description;

/// Returns the plan of a scenario, checked against the descriptions of plant and controller.
///
/// # Errors
/// All problems of the scenario.
pub fn checked(
    text: &str,
    origin: &Path,
    plant: &Description,
    controller: &Description,
) -> Result<Plan, Failure> {
    let advice = Advice {
        plant: "these are the plants of the run's own plant program".into(),
        law: "these are the laws of the run's own controller program".into(),
    };
    checked_with(advice, text, origin, plant, controller)
}

/// Does the same as [`checked`], with other advice on unknown plants and laws.
///
/// # Errors
/// All problems of the scenario.
pub fn checked_with(
    advice: Advice,
    text: &str,
    origin: &Path,
    plant: &Description,
    controller: &Description,
) -> Result<Plan, Failure> {
    Scenario::parse(text, origin)
        .map(|scenario| scenario.advise(advice))
        .and_then(|scenario| scenario.check(&plant.plants, &controller.laws, &plant.faults))
        .map_err(Failure::from)
}
