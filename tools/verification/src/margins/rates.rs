//! Parts of a loop that act at some steps only, so that it has two rates and no single response.

use std::path::Path;

use hil_config::bus;
use hil_config::plan::{FaultAction, FaultEffect, FaultEvent, Plan, Profile, Stimulus, Trigger};
use hil_config::port::PortTables;
use shared_types::describe::PlantDescription;
use shared_types::table::Field;

use super::probe::Course;

/// Returns the reason to refuse a loop of two rates.
pub(super) fn of(plan: &Plan, plants: &[PlantDescription], course: Course) -> Option<String> {
    law(plan)
        .or_else(|| instrument(plan))
        .or_else(|| frame(plan, plants))
        .or_else(|| fault(plan, course))
}

fn law(plan: &Plan) -> Option<String> {
    let divisor = plan.controller.rate_divisor;
    (divisor != 1).then(|| {
        format!(
            "the law runs at every {} sample only, so the loop has two rates and no single response; measure it at the rate of the law: {}",
            ordinal(u64::from(divisor)),
            slower(plan, f64::from(divisor))
        )
    })
}

fn instrument(plan: &Plan) -> Option<String> {
    let sensors = plan.sensors.iter().map(|one| ("sensor", one));
    let actuators = plan.actuators.iter().map(|one| ("actuator", one));
    let (kind, one) =
        { sensors.chain(actuators) }.find(|(_, one)| one.divisor(plan.run.rate) > 1.0)?;
    let divisor = one.divisor(plan.run.rate);
    Some(format!(
        "the {kind} of {} has a rate_hz and acts at every {} step only, so the loop has two rates and no single response; measure it at that rate: {}",
        one.signal,
        ordinal(divisor as u64),
        slower(plan, divisor)
    ))
}

fn frame(plan: &Plan, plants: &[PlantDescription]) -> Option<String> {
    let one = plan.bus.as_ref()?;
    let reference: Vec<Field> = plan.stimuli.iter().flat_map(Stimulus::fields).collect();
    let plant = plan.plant_among(plants)?;
    let tables = PortTables {
        measured: &plant.measured,
        reference: &reference,
        commands: &plant.commands,
    };
    let port = bus::read(one, Path::new("bus.toml"), &tables).ok()?;
    let frames = bus::frames(&port, one, plan.run.rate).ok()?;
    let frame = frames.iter().find(|frame| frame.period_steps > 1)?;
    Some(format!(
        "frame {} of the bus is sent at every {} step only, so the loop has two rates and no single response; measure it at that rate: {}",
        frame.frame.name,
        ordinal(frame.period_steps),
        slower(plan, frame.period_steps as f64)
    ))
}

fn fault(plan: &Plan, course: Course) -> Option<String> {
    plan.faults.iter().find_map(|event| {
        let mut effects = { event.effects.iter() }.filter(|one| acts(event, one, course));
        let reason = effects.find_map(|effect| match (&effect.profile, &effect.action) {
            (Profile::Intermittent { .. }, _) => Some(format!(
                "comes and goes on {}, so the loop varies in time",
                effect.target
            )),
            (Profile::Sine { .. }, _) => Some(format!(
                "has a periodic profile on {}, so the loop varies in time",
                effect.target
            )),
            (_, FaultAction::Kind { parameters, .. }) => {
                let above = |key: &str, least: f64| {
                    let value = parameters.get(key);
                    value.filter(|value| *value > least)
                };
                let sampled = above("every_steps", 1.0).map(|every| {
                    format!(
                        "samples {} at every {} step only, so the loop has two rates",
                        effect.target,
                        ordinal(every as u64)
                    )
                });
                let repeated = above("period_steps", 0.0).map(|period| {
                    format!(
                        "makes the {} miss steps again every {period} steps, so the loop varies in time",
                        effect.target
                    )
                });
                sampled.or(repeated)
            }
            _ => None,
        })?;
        Some(format!(
            "fault {} ({}) {reason} and no single response; choose another --fault, or --fault 0 for none",
            event.id, event.kind
        ))
    })
}

/// Returns `true` if an effect may act during a measurement.
fn acts(event: &FaultEvent, effect: &FaultEffect, course: Course) -> bool {
    let begin = match &event.trigger {
        Trigger::Step { step, .. } => Some(step.0 + effect.skew_steps),
        _ => None,
    };
    let after = begin.zip(event.end.after_steps);
    let ends = [
        event.end.step.map(|step| step.0),
        after.map(|(begin, steps)| begin + steps),
    ];
    let is_later = begin.is_some_and(|begin| begin >= course.end_step());
    let is_over = ends.iter().flatten().any(|end| *end <= course.first_step);
    !is_later && !is_over
}

/// Returns the options that run the loop at a part of its rate.
fn slower(plan: &Plan, divisor: f64) -> String {
    let rate_hz = plan.run.rate.hz() / divisor;
    let substeps = divisor * f64::from(plan.plant.substeps);
    format!("--set run.rate_hz={rate_hz} --set plant.substeps={substeps}")
}

fn ordinal(number: u64) -> String {
    let suffix = match (number % 10, number % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    format!("{number}{suffix}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinal_numbers_are_english() {
        let all = [1, 2, 3, 4, 11, 12, 13, 21, 22, 101, 112].map(ordinal);
        let expected = [
            "1st", "2nd", "3rd", "4th", "11th", "12th", "13th", "21st", "22nd", "101st", "112th",
        ];
        assert_eq!(all, expected);
    }
}
