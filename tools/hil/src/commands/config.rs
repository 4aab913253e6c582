//! `hil config`: checks a scenario, shows it complete, prints its schema.

use std::sync::Arc;

use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::programs::binaries::named::Named;
use hil_facts::programs::binaries::{Binaries, Choices};
use hil_facts::programs::instruments as figures;
use hil_facts::programs::scenario::{Finder, show};
use hil_recording::excerpt::Choice;
use hil_recording::size;

use crate::arguments::config::{ConfigAction, ConfigArguments, ScenarioArguments, ShowArguments};

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
        ConfigAction::Show(arguments) if arguments.instruments => {
            let (plan, binaries, _) = checked(&arguments.scenario)?;
            output::write(&instruments(&plan, &binaries, arguments)?)?;
        }
        ConfigAction::Show(arguments) => {
            let (plan, binaries, interruption) = checked(&arguments.scenario)?;
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

/// Formats the figures of a plan's instruments as text or JSON.
fn instruments(
    plan: &Plan,
    binaries: &Binaries,
    arguments: &ShowArguments,
) -> Result<String, Failure> {
    let half_hz = plan.run.rate.hz() / 2.0;
    if let Some(hz) = (arguments.at_hz.iter()).find(|hz| !(**hz > 0.0 && **hz <= half_hz)) {
        return Err(Failure::usage(format!(
            "--at-hz {hz}: frequencies lie between 0 and half of run.rate_hz, {half_hz} Hz"
        )));
    }
    let (plants, laws, _) = binaries.described();
    let plant = (plan.plant_among(plants))
        .ok_or_else(|| Failure::usage(format!("no plant `{}`", plan.plant.model)))?;
    let law = (plan.law_among(laws))
        .ok_or_else(|| Failure::usage(format!("no law `{}`", plan.controller.law)))?;
    let sides = figures::Sides {
        plant: &plant,
        law: &law,
    };
    Ok(match arguments.scenario.json {
        true => format!("{:#}\n", figures::json(plan, sides, &arguments.at_hz)),
        false => figures::text(plan, sides, &arguments.at_hz),
    })
}

fn checked(arguments: &ScenarioArguments) -> Result<(Plan, Arc<Binaries>, Interruption), Failure> {
    let interruption = Interruption::listen()?;
    let (changes, json) = (&arguments.changes, arguments.json);
    let mut finder = Finder::new(&arguments.binaries, None, &interruption);
    let (plan, binaries, _) = finder.read(&arguments.scenario, changes, json)?;
    Ok((plan, binaries, interruption))
}
