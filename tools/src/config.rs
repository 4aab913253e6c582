//! `hil config`: check a scenario, show it complete, print its schema.

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;

use crate::binaries::Binaries;
use crate::cli::{Changes, ConfigAction, ConfigArguments, ScenarioArguments};
use crate::exit::{Exit, Failure};

/// Runs the command.
///
/// # Errors
/// What is wrong with the scenario or the binaries.
pub fn config(arguments: &ConfigArguments) -> Result<Exit, Failure> {
    match &arguments.action {
        ConfigAction::Check(scenario) => {
            let (plan, _) = checked(scenario)?;
            let seconds = plan
                .run
                .rate
                .seconds(shared_types::time::Step(plan.run.steps));
            println!(
                "{}: {} under {}, {} steps in {seconds} s",
                plan.name, plan.plant.model, plan.controller.law, plan.run.steps
            );
        }
        ConfigAction::Show(scenario) => {
            let (plan, binaries) = checked(scenario)?;
            print!("{}", show(&plan, &binaries)?);
        }
        ConfigAction::Schema { binaries } => {
            let binaries = Binaries::find(binaries)?;
            let plants = &binaries.plant.description.plants;
            let laws = &binaries.controller.description.laws;
            let schema = hil_config::schema::schema(plants, laws);
            println!("{schema:#}");
        }
    }
    Ok(Exit::Pass)
}

/// A plan as complete, runnable TOML.
///
/// # Errors
/// If the plan does not belong to the binaries.
pub fn show(plan: &Plan, binaries: &Binaries) -> Result<String, Failure> {
    let plants = &binaries.plant.description.plants;
    let laws = &binaries.controller.description.laws;
    hil_config::show::show(plan, plants, laws).map_err(Failure::usage)
}

fn checked(arguments: &ScenarioArguments) -> Result<(Plan, Binaries), Failure> {
    let binaries = Binaries::find(&arguments.binaries)?;
    let plan = read(&arguments.scenario, &arguments.changes, &binaries).map_err(|problems| {
        if arguments.json {
            println!("{}", serde_json::json!({ "problems": problems }));
        }
        Failure::Usage(problems.to_string())
    })?;
    Ok((plan, binaries))
}

/// Reads a scenario, applies the changes and checks it against the binaries.
///
/// # Errors
/// Everything that is wrong with it.
pub fn read(
    path: &std::path::Path,
    changes: &Changes,
    binaries: &Binaries,
) -> Result<Plan, Problems> {
    let scenario = Scenario::read(path)?.set(&changes.as_set());
    let plants = &binaries.plant.description.plants;
    let laws = &binaries.controller.description.laws;
    scenario.check(plants, laws)
}
