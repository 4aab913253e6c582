//! `hil config`: check a scenario, show it complete, print its schema.

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;

use crate::binaries::Binaries;
use crate::cli::config::{ConfigAction, ConfigArguments, ScenarioArguments};
use crate::cli::run::Changes;
use crate::exit::{Exit, Failure};
use crate::interruption::Interruption;
use crate::output;
use crate::recording::{Choice, size};

/// Runs the command.
///
/// # Errors
/// What is wrong with the scenario or the binaries.
pub fn config(arguments: &ConfigArguments) -> Result<Exit, Failure> {
    match &arguments.action {
        ConfigAction::Check(scenario) => {
            let (plan, binaries) = checked(scenario)?;
            let seconds = plan
                .run
                .rate
                .seconds(shared_types::time::Step(plan.run.steps));
            let (name, model, law) = (&plan.name, &plan.plant.model, &plan.controller.law);
            let steps = plan.run.steps;
            output::write(&if scenario.json {
                "{\"problems\":[]}
"
                .to_owned()
            } else {
                let (plants, laws, _) = binaries.described();
                let largest = size::largest(&plan, plants, laws, &Choice::default());
                let largest = size::shown(largest.map_err(Failure::usage)?);
                format!(
                    "{name}: {model} under {law}, {steps} steps in {seconds} s; the recording takes up to {largest} before compression
"
                )
            })?;
        }
        ConfigAction::Show(scenario) => {
            let (plan, binaries) = checked(scenario)?;
            output::write(&show(&plan, &binaries)?)?;
        }
        ConfigAction::Schema { binaries } => {
            let binaries = Binaries::find(binaries, &Interruption::listen()?)?;
            let (plants, laws, kinds) = binaries.described();
            let schema = hil_config::schema::schema(plants, laws, kinds);
            output::write(&format!("{schema:#}\n"))?;
        }
    }
    Ok(Exit::Pass)
}

/// A plan as complete, runnable TOML.
///
/// # Errors
/// If the plan does not belong to the binaries.
pub fn show(plan: &Plan, binaries: &Binaries) -> Result<String, Failure> {
    let (plants, laws, kinds) = binaries.described();
    hil_config::show::show(plan, plants, laws, kinds).map_err(Failure::usage)
}

fn checked(arguments: &ScenarioArguments) -> Result<(Plan, Binaries), Failure> {
    let binaries = Binaries::find(&arguments.binaries, &Interruption::listen()?)?;
    let plan = read(
        &arguments.scenario,
        &arguments.changes,
        &binaries,
        arguments.json,
    )?;
    Ok((plan, binaries))
}

/// Reads a scenario, applies the changes and checks it against the binaries. With `json` the
/// problems go to standard output too, for machines.
///
/// # Errors
/// Everything that is wrong with it.
pub fn read(
    path: &std::path::Path,
    changes: &Changes,
    binaries: &Binaries,
    json: bool,
) -> Result<Plan, Failure> {
    check(Scenario::read(path), changes, binaries, json)
}

/// Applies the changes to a scenario that was read, or not, and checks it; as [`read`] does.
///
/// # Errors
/// Everything that is wrong with it.
pub fn check(
    scenario: Result<Scenario, Problems>,
    changes: &Changes,
    binaries: &Binaries,
    json: bool,
) -> Result<Plan, Failure> {
    changes.check()?;
    let (plants, laws, kinds) = binaries.described();
    let checked =
        scenario.and_then(|scenario| scenario.set(&changes.as_set()).check(plants, laws, kinds));
    match checked {
        Ok(plan) => Ok(plan),
        Err(problems) => {
            if json {
                output::write(&format!(
                    "{}\n",
                    serde_json::json!({ "problems": problems })
                ))?;
            }
            Err(Failure::Usage(problems.to_string()))
        }
    }
}
