//! Margins of the running loop: `hil margins`.
//!
//! For each operating point and command:
//!
//! 1. A run without tones shows the motion that the loop has by itself, at the same frequencies.
//! 2. A run with a multi-sine at the [probe] gives L = -(input / output) at coarse frequencies; further runs add
//!    frequencies beside the crossings of the [locus] until each is enclosed.
//! 3. A run with half the amplitude shows if the response depends on the amplitude.
//!
//! The motion of step 1 is subtracted. A margin that the response does not support is refused with a reason. Runs are
//! executed in this thread, so plant and law must be built into `hil`.

use hil_config::plan::Plan;
use hil_config::scenario::Scenario;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::Named;
use hil_facts::tables::FORMATS;
use hil_run::alone;
use shared_types::describe::Description;

use crate::arguments::margins::MarginsArguments;
use measurement::Measurement;
use report::Report;
use span::Span;

mod locus;
mod measurement;
mod probe;
mod report;
mod span;

/// Runs the command.
///
/// # Errors
/// If the scenario or an option is invalid, a run failed, or the user interrupted the command.
pub fn margins(arguments: &MarginsArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let described = alone::built_in();
    let plan = plan(arguments, &described, &interruption)?;
    let commands = commands(&plan, &described, &arguments.command)?;
    let span = Span::new(arguments.frequencies.as_deref(), plan.run.rate.hz())?;
    if arguments
        .amplitude
        .is_some_and(|a| !(a.is_finite() && a > 0.0))
    {
        return Err(Failure::usage("--amplitude must be greater than 0"));
    }
    let end_s = plan.run.steps as f64 / plan.run.rate.hz();
    let points = match arguments.at.is_empty() {
        true => vec![end_s],
        false => arguments.at.clone(),
    };
    if points.iter().any(|at_s| !(0.0..=1e6).contains(at_s)) {
        return Err(Failure::usage("--at must be from 0 to 1000000 s"));
    }
    let mut report = Report::default();
    for at_s in points {
        for (name, unit) in &commands {
            tell!("probing command.{name} at {at_s} s");
            let measurement = Measurement {
                plan: &plan,
                described: &described,
                command: name,
                at_s,
                amplitude: arguments.amplitude,
                span,
                interruption: &interruption,
            };
            let result = match plan.controller.rate_divisor {
                1 => measurement.run()?,
                n => Err(format!(
                    "the law runs at every {n}th sample only, so the response depends on the time within its period"
                )),
            };
            report.add(name, unit, at_s, result);
        }
    }
    if let Some(path) = &arguments.output {
        std::fs::write(path, report.csv()).map_err(|error| {
            Failure::infrastructure(format!("cannot write {}: {error}", path.display()))
        })?;
    }
    output::result(arguments.json, &report, || report.describe())?;
    Ok(match report.is_complete() {
        true => Exit::Pass,
        false => Exit::Failed,
    })
}

/// Reads the scenario and keeps the requested faults.
fn plan(
    arguments: &MarginsArguments,
    [plant, controller]: &[Description; 2],
    interruption: &Interruption,
) -> Result<Plan, Failure> {
    let read = || Scenario::read(&arguments.scenario);
    let scenario = interruption.at_once(read)??.with_formats(FORMATS);
    let scenario = scenario.set(&arguments.set);
    let choices = Choices::of(&BinaryArguments::default(), &Named::by(&scenario), None)?;
    if choices.names_one() {
        return Err(Failure::usage(
            "hil margins runs plants and laws that are built into hil, but the scenario or the environment names a program",
        ));
    }
    let plan = scenario.check(&plant.plants, &controller.laws, &plant.faults)?;
    let mut plan = plan.without_judgement();
    alone::refuse_clock(&plan)?;
    if let Some(number) = arguments.fault {
        let count = plan.faults.len();
        if number > count {
            return Err(Failure::usage(format!(
                "--fault {number}: the scenario has {count} faults"
            )));
        }
        let all = std::mem::take(&mut plan.faults).into_iter().enumerate();
        let kept = all.filter(|(index, _)| index + 1 == number);
        plan.faults = kept.map(|(_, event)| event).collect();
    }
    Ok(plan)
}

/// Returns name and unit of the commands to be probed.
fn commands(
    plan: &Plan,
    [plant, _]: &[Description; 2],
    names: &[String],
) -> Result<Vec<(String, String)>, Failure> {
    let plant = plan.plant_among(&plant.plants);
    let all = plant.map_or_else(Vec::new, |plant| plant.commands);
    if let Some(name) = names
        .iter()
        .find(|name| all.iter().all(|one| one.name != **name))
    {
        let there: Vec<&str> = all.iter().map(|one| one.name.as_str()).collect();
        return Err(Failure::usage(format!(
            "the plant has no command `{name}`; it has {}",
            there.join(", ")
        )));
    }
    let all = all.into_iter().map(|one| (one.name, one.unit));
    let chosen = all.filter(|(name, _)| names.is_empty() || names.contains(name));
    Ok(chosen.collect())
}

#[cfg(test)]
mod tests;
