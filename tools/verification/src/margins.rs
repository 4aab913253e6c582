//! Margins of the running loop: `hil margins`.
//!
//! Every command has a `probe`. For each operating point:
//!
//! 1. A run without tones shows the motion that the loop has by itself.
//! 2. For each command, a run with a multi-sine gives L = -(input / output) of its `probe` at coarse frequencies; further
//!    runs add frequencies beside the crossings of the `locus` until each is enclosed.
//! 3. Each run is repeated with half the amplitude, which shows if the response depends on the amplitude.
//! 4. With several commands, the same runs give the margin of all loops `together`.
//!
//! The motion of step 1 is subtracted. A margin that the response does not support is refused (`refusal`) with a reason.
//! Plants and laws that are built into `hil` run in this thread, other programs in two processes (`rig`).

use hil_config::plan::{Clock, Plan, Trigger};
use hil_config::scenario::Scenario;
use hil_console::files::destination::{Destination, deliver};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::tables::FORMATS;
use shared_types::number::counted;
use shared_types::time::Step;

use crate::arguments::margins::MarginsArguments;
use measurement::{Measured, Measurement};
use probe::{Course, Loops, Motion, Stop};
use report::{Report, Time};
use rig::Rig;
use span::Span;

mod extremes;
mod growth;
mod locus;
mod measurement;
mod movement;
mod point;
mod probe;
mod rates;
mod refusal;
mod report;
mod resolution;
mod rig;
mod span;
mod together;

/// Runs the command.
///
/// # Errors
/// If the scenario or an option is invalid, a run failed, or the user interrupted the command.
pub fn margins(arguments: &MarginsArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let read = || Scenario::read(&arguments.scenario);
    let scenario = interruption.at_once(read)??.with_formats(FORMATS);
    let scenario = scenario.set(&arguments.set);
    let rig = Rig::of(&arguments.binaries, &scenario, &interruption)?;
    let plan = plan(arguments, &scenario, &rig)?;
    let commands = commands(&plan, &rig, &arguments.command)?;
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
    if let Some(at_s) = points.iter().find(|at_s| !(0.0..=1e6).contains(*at_s)) {
        return Err(Failure::usage(format!(
            "--at must be from 0 to 1000000 s, not {at_s}"
        )));
    }
    // Refused before the measurement.
    let path = arguments.output.as_deref();
    let destination = path.map(|path| Destination::open(Some(path), true));
    let destination = destination.transpose()?;
    let mut report = Report::default();
    for at_s in points {
        let point = OperatingPoint {
            rig: &rig,
            plan: &plan,
            commands: &commands,
            amplitude: arguments.amplitude,
            span,
            interruption: &interruption,
        };
        point.measure(at_s, &mut report)?;
    }
    // Before the file, whose disk may be full.
    output::result(arguments.json, &report, || report.describe())?;
    if let Some(destination) = destination {
        deliver(&report.csv(), destination, path)?;
    }
    Ok(match report.is_complete() {
        true => Exit::Pass,
        false => Exit::Failed,
    })
}

/// Command of the plant.
struct Command {
    name: String,
    unit: String,
    /// `true` if its margins are requested.
    is_chosen: bool,
}

/// Loops of a plan, to be measured at an operating point.
struct OperatingPoint<'a> {
    rig: &'a Rig,
    plan: &'a Plan,
    commands: &'a [Command],
    amplitude: Option<f64>,
    span: Span,
    interruption: &'a Interruption,
}

impl OperatingPoint<'_> {
    /// Measures the loops from a time on.
    fn measure(&self, at_s: f64, report: &mut Report) -> Result<(), Failure> {
        let names: Vec<String> = self.commands.iter().map(|one| one.name.clone()).collect();
        let loops = Loops {
            rig: self.rig,
            plan: self.plan,
            commands: &names,
            course: Course {
                first_step: self.plan.run.rate.step_at_or_after(at_s).0,
                period_steps: self.span.period_steps(),
            },
            interruption: self.interruption,
        };
        let own = self.own(&loops)?;
        let rate = self.plan.run.rate;
        let measured_s = [loops.course.measured_step(), loops.course.end_step()]
            .map(|step| rate.seconds(Step(step)));
        let time = Time { at_s, measured_s };
        let mut measured: Vec<Option<Measured>> = Vec::new();
        for (place, command) in self.commands.iter().enumerate() {
            if !command.is_chosen {
                measured.push(None);
                continue;
            }
            tell!("probing command.{} at {at_s} s", command.name);
            let result = match &own {
                Err(reason) => Err(reason.clone()),
                Ok(own) => {
                    let measurement = Measurement {
                        loops: &loops,
                        own,
                        command: place,
                        amplitude: self.amplitude,
                        span: self.span,
                    };
                    refusable(measurement.run())?
                }
            };
            let as_result = result.as_ref().map_err(Clone::clone);
            report.add(&command.name, &command.unit, time, as_result);
            measured.push(result.ok());
        }
        if self.commands.len() < 2 || self.commands.iter().any(|command| !command.is_chosen) {
            return Ok(());
        }
        let all: Option<Vec<&Measured>> = measured.iter().map(Option::as_ref).collect();
        let result = match (own, all) {
            (Ok(own), Some(all)) => {
                tell!("probing all commands at {at_s} s");
                refusable(together::measure(&loops, &own, &all, self.span))?
            }
            _ => Err("the margins of a command were refused".into()),
        };
        report.add_together(time, result);
        Ok(())
    }

    /// Runs the loops without tones, or returns the reason why they have no margins.
    fn own(&self, loops: &Loops<'_>) -> Result<Result<Motion, String>, Failure> {
        let (plants, ..) = self.rig.described();
        let course = loops.course;
        if let Some(reason) = rates::of(self.plan, plants, course) {
            return Ok(Err(reason));
        }
        let own = match refusable(loops.run(None))? {
            Ok(own) => own,
            Err(reason) => return Ok(Err(reason)),
        };
        if let Some(reason) = movement::of(self.plan, &own.events, course) {
            return Ok(Err(reason));
        }
        let period_s = self.plan.run.rate.seconds(Step(course.period_steps));
        Ok(match own.steady_growth() {
            Some(growth) => Err(refusal::growing(growth, period_s, "without the probe")),
            None => Ok(own),
        })
    }
}

/// Separates a refusal from a failure.
fn refusable<T>(result: Result<T, Stop>) -> Result<Result<T, String>, Failure> {
    match result {
        Ok(value) => Ok(Ok(value)),
        Err(Stop::Refused(reason)) => Ok(Err(reason)),
        Err(Stop::Failed(failure)) => Err(failure),
    }
}

/// Checks the scenario and keeps the requested faults.
fn plan(arguments: &MarginsArguments, scenario: &Scenario, rig: &Rig) -> Result<Plan, Failure> {
    let (plants, laws, kinds) = rig.described();
    let plan = scenario.check(plants, laws, kinds)?;
    let mut plan = plan.without_judgement();
    if plan.run.clock != Clock::Lockstep {
        return Err(Failure::usage(format!(
            "run.clock = \"{}\": margins are measured in lockstep; add --set run.clock=lockstep",
            plan.run.clock.name()
        )));
    }
    if let Some(number) = arguments.fault {
        let count = plan.faults.len();
        if number > count {
            return Err(Failure::usage(format!(
                "--fault {number}: the scenario has {}",
                counted(count as u64, "fault")
            )));
        }
        let after = number
            .checked_sub(1)
            .map(|index| &plan.faults[index].trigger);
        if let Some(Trigger::After { event, .. }) = after {
            let earlier = plan.faults.iter().find(|one| one.id == *event);
            let name = earlier.and_then(|one| one.name.clone());
            let name = name.unwrap_or_else(|| event.to_string());
            return Err(Failure::usage(format!(
                "--fault {number}: fault {number} begins after fault `{name}`, without which it never does; give it at_s instead of after, or keep all faults and choose --at"
            )));
        }
        let all = std::mem::take(&mut plan.faults).into_iter().enumerate();
        let kept = all.filter(|(index, _)| index + 1 == number);
        plan.faults = kept.map(|(_, event)| event).collect();
    }
    Ok(plan)
}

/// Lists the commands of the plant; without names, all are chosen.
fn commands(plan: &Plan, rig: &Rig, names: &[String]) -> Result<Vec<Command>, Failure> {
    let (plants, ..) = rig.described();
    let plant = plan.plant_among(plants);
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
    let all = all.into_iter().map(|one| Command {
        is_chosen: names.is_empty() || names.contains(&one.name),
        name: one.name,
        unit: one.unit,
    });
    Ok(all.collect())
}

#[cfg(test)]
mod tests;
