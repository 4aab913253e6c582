//! `hil config`: check a scenario, show it complete, print its schema.

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;

use crate::binaries::named::Named;
use crate::binaries::{Binaries, Choices};
use crate::cli::BinaryArguments;
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
            let (plan, binaries, _) = checked(scenario)?;
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
            let (plan, binaries, interruption) = checked(scenario)?;
            output::write(&interruption.at_once(|| show(&plan, &binaries))??)?;
        }
        ConfigAction::Schema { binaries } => {
            let choices = Choices::of(binaries, &Named::Nothing)?;
            let binaries = choices.find(&Interruption::listen()?)?;
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

fn checked(arguments: &ScenarioArguments) -> Result<(Plan, Binaries, Interruption), Failure> {
    let interruption = Interruption::listen()?;
    let (changes, json) = (&arguments.changes, arguments.json);
    let mut finder = Finder::new(&arguments.binaries, &interruption);
    let (plan, binaries) = finder.read(&arguments.scenario, changes, json)?;
    Ok((plan, binaries, interruption))
}

/// Reads scenarios and finds the programs that each is for.
pub(crate) struct Finder<'a> {
    arguments: &'a BinaryArguments,
    interruption: &'a Interruption,
    /// Those of the scenarios before: they are asked once.
    found: Vec<(Choices, Binaries)>,
}

impl<'a> Finder<'a> {
    pub(crate) const fn new(
        arguments: &'a BinaryArguments,
        interruption: &'a Interruption,
    ) -> Self {
        Self {
            arguments,
            interruption,
            found: Vec::new(),
        }
    }

    /// Reads a scenario, applies the changes and checks it against its programs. With `json` the
    /// problems go to standard output too, for machines.
    ///
    /// # Errors
    /// Everything that is wrong with it, or with its programs.
    pub(crate) fn read(
        &mut self,
        path: &std::path::Path,
        changes: &Changes,
        json: bool,
    ) -> Result<(Plan, Binaries), Failure> {
        changes.check()?;
        let read = || Scenario::read(path).map(|scenario| scenario.set(&changes.as_set()));
        let scenario = self.interruption.at_once(read)?;
        let scenario = scenario.or_else(|problems| refused(&problems, json))?;
        let choices = Choices::of(self.arguments, &Named::by(&scenario))?;
        let known = self.found.iter().find(|(known, _)| *known == choices);
        let binaries = match known {
            Some((_, binaries)) => binaries.clone(),
            None => choices.find(self.interruption)?,
        };
        if known.is_none() {
            self.found.push((choices, binaries.clone()));
        }
        let plan = (self.interruption).at_once(|| finish(scenario, &binaries, json))??;
        Ok((plan, binaries))
    }
}

/// Applies the changes to a scenario and checks it; with `json` the problems go to standard output
/// too, for machines.
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
    let scenario = scenario.or_else(|problems| refused(&problems, json))?;
    finish(scenario.set(&changes.as_set()), binaries, json)
}

/// The plan of a scenario, with the programs that were found for it.
fn finish(scenario: Scenario, binaries: &Binaries, json: bool) -> Result<Plan, Failure> {
    let (plants, laws, kinds) = binaries.described();
    let scenario = scenario.advise(binaries.advice());
    let plan = scenario.check(plants, laws, kinds);
    let plan = plan.or_else(|problems| refused(&problems, json))?;
    Ok(Plan {
        programs: binaries.programs(),
        ..plan
    })
}

fn refused<T>(problems: &Problems, json: bool) -> Result<T, Failure> {
    if json {
        output::write(&format!(
            "{}\n",
            serde_json::json!({ "problems": problems })
        ))?;
    }
    Err(Failure::Usage(problems.to_string()))
}
