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
    /// `<`, `<=`, `>`, `>=`, `==` or `!=`, as it stands between the side and the other.
    relation: &'static str,
    pub(super) other: Other,
    /// Whether the requirement turns the margin of the comparison round; `None` if it does both.
    is_turned: Option<bool>,
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
    for requirement in run.plan().iter().flat_map(|plan| &plan.requirements) {
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
            let relation = compared.relation;
            let (side, relation, other) = match (left.constant(), right.constant()) {
                (Some(level), _) => (side(right), mirrored(relation), Other::Level(level)),
                (None, Some(level)) => (side(left), relation, Other::Level(level)),
                (None, None) => (side(left), relation, Other::Signal(side(right))),
            };
            bounds.push(Bound {
                run: number,
                requirement: requirement.name.clone(),
                side,
                relation,
                other,
                is_turned: compared.is_turned,
                window_s: compared.window_s,
            });
        }
    }
    (bounds, extra)
}

/// A relation as it reads from right to left.
fn mirrored(relation: &'static str) -> &'static str {
    match relation {
        "<" => ">",
        "<=" => ">=",
        ">" => "<",
        ">=" => "<=",
        same => same,
    }
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
    /// The value of its signal in a bucket and what it is compared with, if their margin is that of the
    /// whole requirement: this comparison decides.
    pub(super) fn decisive(
        &self,
        margin: f64,
        signals: &Signals,
        bucket: usize,
    ) -> Option<[f64; 2]> {
        let pairs = self.side.ends(signals, bucket).flat_map(|value| {
            let levels: Vec<f64> = match &self.other {
                Other::Level(level) => vec![*level],
                Other::Signal(other) => other.ends(signals, bucket).collect(),
            };
            levels.into_iter().map(move |level| [value, level])
        });
        let [value, level] = pairs.into_iter().find(|pair| self.decides(*pair, margin))?;
        // That of a negative value's magnitude stands below zero.
        let is_mirrored =
            self.side.magnitude && value < 0.0 && matches!(self.other, Other::Level(_));
        Some([value, if is_mirrored { -level } else { level }])
    }

    fn decides(&self, [value, level]: [f64; 2], margin: f64) -> bool {
        let value = self.side.compared(value);
        let level = match &self.other {
            Other::Level(_) => level,
            Other::Signal(other) => other.compared(level),
        };
        let own = match self.relation {
            "<" | "<=" => level - value,
            ">" | ">=" => value - level,
            "==" => -(value - level).abs(),
            _ => (value - level).abs(),
        };
        let rounding = 1e-9 * (value.abs() + level.abs());
        let is_it = |own: f64| own.is_finite() && (own - margin).abs() <= rounding;
        match self.is_turned {
            Some(false) => is_it(own),
            Some(true) => is_it(-own),
            None => is_it(own) || is_it(-own),
        }
    }
}
