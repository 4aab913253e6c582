//! `hil config`: checks a scenario, shows it complete, prints its schema.

use std::sync::Arc;

use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::programs::binaries::named::Named;
use hil_facts::programs::binaries::{Binaries, Choices};
use hil_facts::programs::scenario::{Finder, show};
use hil_recording::excerpt::Choice;
use hil_recording::size;

use crate::arguments::config::{ConfigAction, ConfigArguments, ScenarioArguments};

/// Runs the command.
///
/// # Errors
/// If the scenario or a binary is invalid.
pub(crate) fn config(arguments: &ConfigArguments) -> Result<Exit, Failure> {
    match &arguments.action {
        ConfigAction::Check(scenario) => {
            let (plan, binaries, _) = checked(scenario)?;
            let (name, model, law) = (&plan.name, &plan.plant.model, &plan.controller.law);
            let steps = plan.run.steps;
            let seconds = plan.run.rate.seconds(shared_types::time::Step(steps));
            output::write(&if scenario.json {
                "{\"problems\":[]}\n".to_owned()
            } else {
                let layout = binaries.record_layout(&plan)?;
                let largest = size::largest(&layout, steps, &Choice::default());
                let largest = size::shown(largest.map_err(Failure::usage)?);
                format!(
                    "{name}: {model} under {law}, {steps} steps in {seconds} s; the recording takes up to {largest} before compression\n"
                )
            })?;
        }
        ConfigAction::Show(scenario) => {
            let (plan, binaries, interruption) = checked(scenario)?;
            output::write(&interruption.at_once(|| show(&plan, &binaries))??)?;
        }
        ConfigAction::Schema { study: true, .. } => {
            output::write(&format!("{:#}\n", hil_config::schema::study()))?;
        }
        ConfigAction::Schema { binaries, .. } => {
            let choices = Choices::of(binaries, &Named::Nothing, None)?;
            let binaries = choices.find(&Interruption::listen()?)?;
            let (plants, laws, kinds) = binaries.described();
            let schema = hil_config::schema::schema(plants, laws, kinds);
            output::write(&format!("{schema:#}\n"))?;
        }
    }
    Ok(Exit::Pass)
}

fn checked(arguments: &ScenarioArguments) -> Result<(Plan, Arc<Binaries>, Interruption), Failure> {
    let interruption = Interruption::listen()?;
    let (changes, json) = (&arguments.changes, arguments.json);
    let mut finder = Finder::new(&arguments.binaries, None, &interruption);
    let (plan, binaries) = finder.read(&arguments.scenario, changes, json)?;
    Ok((plan, binaries, interruption))
}
