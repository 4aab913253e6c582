//! What requirements compare, as far as a plot can show it: a signal against a level or another signal.

use hil_config::expression::Expression;
use hil_config::plan::{self, Plan};

use super::run::Run;
use crate::requirements::Requirement;

/// One comparison of a requirement of a run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bound {
    pub(super) run: usize,
    pub(super) requirement: String,
    /// The signal, by a name that the run's signals have.
    pub(super) signal: String,
    /// Whether its magnitude is compared.
    pub(super) magnitude: bool,
    pub(super) other: Other,
    /// First and last time in s at which it may count.
    pub(super) window_s: [f64; 2],
    /// The value of the signal at the time that the margin comes from, or its magnitude; only where the
    /// requirement is this comparison alone.
    pub(super) decisive: Option<f64>,
}

/// What a signal is compared with.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Other {
    /// A number.
    Level(f64),
    /// Another signal.
    Signal(String),
}

/// The comparisons of a run's requirements, and the signals that must be computed to show them.
pub(super) fn bounds(number: usize, run: &Run) -> (Vec<Bound>, Vec<plan::Derived>) {
    let Some(plan) = &run.plan else {
        return (Vec::new(), Vec::new());
    };
    bounds_of(number, plan, &run.requirements, run.end_s())
}

fn bounds_of(
    number: usize,
    plan: &Plan,
    judged: &[Requirement],
    end_s: f64,
) -> (Vec<Bound>, Vec<plan::Derived>) {
    let (mut bounds, mut extra) = (Vec::new(), Vec::new());
    for requirement in &plan.requirements {
        let comparisons = requirement.formula.comparisons(end_s);
        let of_it = judged.iter().find(|one| one.name == requirement.name);
        let margin = of_it
            .filter(|_| comparisons.len() == 1)
            .and_then(|one| one.robustness);
        let mut name = |side: &Expression| match side.plain_signal() {
            Some((signal, magnitude)) => (signal.to_owned(), magnitude),
            None => {
                let text = side.to_string().trim().to_owned();
                extra.push(plan::Derived {
                    name: text.clone(),
                    unit: requirement.unit.clone(),
                    expression: side.clone(),
                });
                (text, false)
            }
        };
        for compared in comparisons {
            let levels = (compared.left.constant(), compared.right.constant());
            // A level first is the same comparison the other way round.
            let (side, other, is_below) = match levels {
                (Some(level), _) => (
                    compared.right,
                    Ok(level),
                    compared.relation.starts_with('>'),
                ),
                (None, Some(level)) => {
                    (compared.left, Ok(level), compared.relation.starts_with('<'))
                }
                (None, None) => (compared.left, Err(compared.right), false),
            };
            let (signal, magnitude) = name(side);
            let other = match other {
                Ok(level) => Other::Level(level),
                Err(right) => Other::Signal(name(right).0),
            };
            let is_order = compared.is_direct && compared.relation.starts_with(['<', '>']);
            let decisive = match (&other, margin) {
                (Other::Level(level), Some(margin)) if is_order => Some(match is_below {
                    true => level - margin,
                    false => level + margin,
                }),
                _ => None,
            };
            bounds.push(Bound {
                run: number,
                requirement: requirement.name.clone(),
                signal,
                magnitude,
                other,
                window_s: compared.window_s,
                decisive,
            });
        }
    }
    (bounds, extra)
}
