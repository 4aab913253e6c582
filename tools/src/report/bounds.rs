//! What requirements compare, as far as a plot can show it: a signal against a level or another signal.

use hil_config::expression::Expression;
use hil_config::plan;

use super::run::{Run, Signals};

/// One comparison of a requirement of a run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bound {
    pub(super) run: usize,
    pub(super) requirement: String,
    pub(super) side: Side,
    pub(super) other: Other,
    /// First and last time in s at which it may count.
    pub(super) window_s: [f64; 2],
}

/// A signal that is compared.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Side {
    /// A name that the run's signals have.
    pub(super) signal: String,
    /// Whether its magnitude is compared.
    pub(super) magnitude: bool,
}

/// What a signal is compared with.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Other {
    /// A number.
    Level(f64),
    /// Another signal.
    Signal(Side),
}

/// The comparisons of a run's requirements, and the signals that must be computed to show them.
pub(super) fn bounds(number: usize, run: &Run) -> (Vec<Bound>, Vec<plan::Derived>) {
    let (mut bounds, mut extra) = (Vec::new(), Vec::new());
    for requirement in run.plan.iter().flat_map(|plan| &plan.requirements) {
        let mut side = |side: &Expression| match side.plain_signal() {
            Some((signal, magnitude)) => Side {
                signal: signal.to_owned(),
                magnitude,
            },
            None => {
                let text = side.to_string().trim().to_owned();
                extra.push(plan::Derived {
                    name: text.clone(),
                    unit: requirement.unit.clone(),
                    expression: side.clone(),
                });
                Side {
                    signal: text,
                    magnitude: false,
                }
            }
        };
        for compared in requirement.formula.comparisons(run.end_s()) {
            let (left, right) = (compared.left, compared.right);
            let (side, other) = match (left.constant(), right.constant()) {
                (Some(level), _) => (side(right), Other::Level(level)),
                (None, Some(level)) => (side(left), Other::Level(level)),
                (None, None) => (side(left), Other::Signal(side(right))),
            };
            bounds.push(Bound {
                run: number,
                requirement: requirement.name.clone(),
                side,
                other,
                window_s: compared.window_s,
            });
        }
    }
    (bounds, extra)
}

impl Side {
    /// The least and the greatest value of its signal in a bucket; empty if it has none.
    fn ends<'a>(&'a self, signals: &'a Signals, bucket: usize) -> impl Iterator<Item = f64> + 'a {
        let envelope = signals.get(&self.signal).into_iter();
        envelope.flat_map(move |envelope| envelope.ends(bucket))
    }

    /// What of a value is compared.
    fn compared(&self, value: f64) -> f64 {
        if self.magnitude { value.abs() } else { value }
    }
}

impl Bound {
    /// The value of its signal in a bucket that is as far from what it is compared with as the margin of
    /// the whole requirement says, and what that is: this comparison decides. `None` if none is.
    pub(super) fn decisive(
        &self,
        margin: f64,
        signals: &Signals,
        bucket: usize,
    ) -> Option<[f64; 2]> {
        let decides = |value: f64, level: f64| {
            let rounding = 1e-9 * (value.abs() + level.abs());
            ((value - level).abs() - margin.abs()).abs() <= rounding
        };
        let pairs = self.side.ends(signals, bucket).flat_map(|value| {
            let levels: Vec<[f64; 2]> = match &self.other {
                // That of a negative value's magnitude stands below zero.
                Other::Level(level) if self.side.magnitude => {
                    vec![[*level, level.copysign(value)]]
                }
                Other::Level(level) => vec![[*level; 2]],
                Other::Signal(other) => (other.ends(signals, bucket))
                    .map(|level| [other.compared(level), level])
                    .collect(),
            };
            levels.into_iter().map(move |level| (value, level))
        });
        let mut deciding =
            pairs.filter(|(value, [level, _])| decides(self.side.compared(*value), *level));
        deciding.next().map(|(value, [_, shown])| [value, shown])
    }
}
