//! Moves of parameters by the plant's own faults, which must stay within their ranges.

use shared_types::describe::{Operation, Settings};
use shared_types::number::exact as number;
use shared_types::table::Field;

use super::EventContext;
use super::span::Reported;
use crate::plan::{FaultAction, FaultEnd, FaultEvent, Move, Profile, Trigger};
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Returns the result of moving `value` under profile `gain`, and the formula.
fn moved(operation: Operation, value: f64, by: f64, gain: f64) -> (f64, String) {
    let (v, a, g) = (number(value), number(by), number(gain));
    let full = gain == 1.0;
    match operation {
        Operation::Add if full => (value + by, format!("{v} + {a}")),
        Operation::Add => (value + by * gain, format!("{v} + {a} * {g}")),
        Operation::Scale if full => (value * by, format!("{v} * {a}")),
        Operation::Scale => (
            value * (1.0 + (by - 1.0) * gain),
            format!("{v} * (1 + ({a} - 1) * {g})"),
        ),
        Operation::Set if full => (by, String::new()),
        Operation::Set => (
            value + (by - value) * gain,
            format!("{v} + ({a} - {v}) * {g}"),
        ),
    }
}

/// Returns the extreme gains of a profile. At a gain of 0 the parameter is healthy.
fn furthest(profile: &Profile) -> Vec<f64> {
    match profile {
        Profile::Sine { .. } => vec![1.0, -1.0],
        Profile::Table { values, .. } => {
            let rising = || values.iter().copied();
            let high = rising().reduce(|a, b| if b > a { b } else { a });
            let low = rising().reduce(|a, b| if b < a { b } else { a });
            high.into_iter().chain(low).collect()
        }
        Profile::Step
        | Profile::Ramp { .. }
        | Profile::Exponential { .. }
        | Profile::Pulse { .. }
        | Profile::Intermittent { .. } => vec![1.0],
    }
}

/// Refuses a move that by itself leaves the parameter's range. `key` is the key of its size.
pub(super) fn stays_in_range(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    parameter: &Field,
    healthy: &Settings,
    one: &Move,
    profile: &Profile,
) -> Result<(), Reported> {
    let healthy = healthy.get(&parameter.name).ok_or(Reported)?;
    for gain in furthest(profile) {
        let (value, sum) = moved(one.operation, healthy, one.by, gain);
        if parameter.admits(value) {
            continue;
        }
        let sum = match sum.as_str() {
            "" => number(value),
            sum => format!("{sum} = {}", number(value)),
        };
        let name = &parameter.name;
        let message = format!("`{name}` would become {sum}, out of range");
        let path = match key {
            "" => section.path.clone(),
            key => section.path_of(key),
        };
        reader
            .report(
                ProblemKind::OutOfRange,
                path,
                section.place_of(key),
                message,
            )
            .expected(Quantity::from(parameter).expected());
        return Err(Reported);
    }
    Ok(())
}

/// Move that reaches its full size and stays.
struct Lasting<'a> {
    /// Order in which moves act: step, event, effect, index in the effect.
    order: (u64, u32, usize, usize),
    section: &'a Section<'a>,
    one: &'a Move,
}

/// Refuses moves that together leave a parameter's range: those at a known step that reach their full size and never
/// end.
pub(super) fn stay_in_range_together<'a>(
    reader: &mut Reader,
    context: &EventContext<'_>,
    events: &'a [(FaultEvent, Vec<Section<'a>>)],
) {
    let (Some(plant), Some(healthy)) = (context.plant, context.healthy) else {
        return;
    };
    let mut lasting: Vec<Lasting<'_>> = events.iter().flat_map(lasting_of).collect();
    lasting.sort_by_key(|lasting| lasting.order);
    for parameter in plant.parameters.iter().filter(|field| field.faultable) {
        let Some(mut value) = healthy.get(&parameter.name) else {
            continue;
        };
        let on_it = lasting.iter().filter(|l| l.one.parameter == parameter.name);
        for Lasting { section, one, .. } in on_it {
            let (next, sum) = moved(one.operation, value, one.by, 1.0);
            value = next;
            if !parameter.admits(value) {
                let name = &parameter.name;
                let message = format!(
                    "`{name}` would become {sum} = {} with the effects before it, out of range",
                    number(value)
                );
                let path = section.path.clone();
                reader
                    .report(ProblemKind::OutOfRange, path, section.place, message)
                    .expected(Quantity::from(parameter).expected());
                break;
            }
        }
    }
}

fn lasting_of<'a>(
    (event, sections): &'a (FaultEvent, Vec<Section<'a>>),
) -> impl Iterator<Item = Lasting<'a>> {
    let step = match &event.trigger {
        Trigger::Step { step, .. } if event.end == FaultEnd::default() => Some(step.0),
        _ => None,
    };
    let effects = event.effects.iter().zip(sections).enumerate();
    effects.flat_map(move |(index, (effect, section))| {
        let moves = match (&effect.action, &effect.profile) {
            (
                FaultAction::Move { moves, .. },
                Profile::Step | Profile::Ramp { .. } | Profile::Exponential { .. },
            ) => &moves[..],
            _ => &[],
        };
        let begin = step.map(|step| step + effect.skew_steps);
        moves.iter().enumerate().filter_map(move |(place, one)| {
            let order = (begin?, event.id, index, place);
            Some(Lasting {
                order,
                section,
                one,
            })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_move_follows_its_equation() {
        for (operation, value, by, gain, expected) in [
            (Operation::Add, 2.0, 3.0, 1.0, 5.0),
            (Operation::Add, 2.0, 3.0, -0.5, 0.5),
            (Operation::Scale, 2.0, 3.0, 1.0, 6.0),
            (Operation::Scale, 2.0, 3.0, 0.5, 4.0),
            (Operation::Set, 2.0, 3.0, 1.0, 3.0),
            (Operation::Set, 2.0, 4.0, 0.25, 2.5),
        ] {
            assert_eq!(
                moved(operation, value, by, gain).0,
                expected,
                "{operation:?}"
            );
        }
    }
}
