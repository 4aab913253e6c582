//! A scenario checked against what the programs of a run said of themselves, as a session or a recording
//! keeps it.

use std::path::Path;

use hil_config::plan::Plan;
use hil_config::scenario::{Advice, Scenario};
use hil_console::terminal::exit::Failure;
use shared_types::describe::Description;

/// A scenario's plan, by what plant and controller said of themselves.
///
/// # Errors
/// Everything that is wrong with it.
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

/// The same with other advice on unknown plants and laws.
///
/// # Errors
/// Everything that is wrong with it.
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
