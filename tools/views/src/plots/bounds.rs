//! Comparisons in requirements that a plot can show: a signal against a level or another signal.

use hil_config::expression::Expression;
use hil_config::plan::{Derived, DerivedSource, Plan};

use super::signal::recorded_name;

/// Comparison in a requirement.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Name of the requirement.
    pub requirement: String,
    /// First signal.
    pub side: BoundedSignal,
    /// Relation between the two sides: `<`, `<=`, `>`, `>=`, `==` or `!=`.
    relation: &'static str,
    /// Level or second signal.
    pub other: Other,
    /// Sign of the comparison's margin within the margin of the requirement, `true` for the opposite sign; `None` if
    /// both signs occur.
    is_turned: Option<bool>,
    /// First and last time in s at which the comparison may apply.
    pub window_s: [f64; 2],
}

/// Compared signal.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundedSignal {
    /// Recorded, derived or computed signal.
    pub signal: String,
    /// `true` if the magnitude is compared.
    pub magnitude: bool,
}

/// Right side of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum Other {
    /// Number.
    Level(f64),
    /// Another signal.
    Signal(BoundedSignal),
}

/// Returns the comparisons in a run's requirements, and the signals that must be computed to show them.
#[must_use]
pub fn bounds(plan: &Plan, end_s: f64) -> (Vec<Bound>, Vec<Derived>) {
    let (mut bounds, mut extra) = (Vec::new(), Vec::<Derived>::new());
    for requirement in &plan.requirements {
        let mut side = |side: &Expression| match side.plain_signal() {
            Some((signal, magnitude)) => BoundedSignal {
                signal: recorded_name(signal),
                magnitude,
            },
            None => {
                let text = side.to_string().trim().to_owned();
                if extra.iter().all(|one| one.name != text) {
                    extra.push(Derived {
                        name: text.clone(),
                        unit: requirement.unit.clone(),
                        source: DerivedSource::Expression(side.clone()),
                    });
                }
                BoundedSignal {
                    signal: text,
                    magnitude: false,
                }
            }
        };
        for compared in requirement.formula.comparisons(end_s) {
            let (left, right) = (compared.left, compared.right);
            let relation = compared.relation;
            let (side, relation, other) = match (left.constant(), right.constant()) {
                (Some(level), _) => (side(right), mirrored(relation), Other::Level(level)),
                (None, Some(level)) => (side(left), relation, Other::Level(level)),
                (None, None) => (side(left), relation, Other::Signal(side(right))),
            };
            bounds.push(Bound {
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

/// Returns the relation with its sides exchanged.
fn mirrored(relation: &'static str) -> &'static str {
    match relation {
        "<" => ">",
        "<=" => ">=",
        ">" => "<",
        ">=" => "<=",
        same => same,
    }
}

impl BoundedSignal {
    /// Returns the value that is compared: the value itself or its magnitude.
    fn compared(&self, value: f64) -> f64 {
        if self.magnitude { value.abs() } else { value }
    }
}

impl Bound {
    /// Returns the values of both sides if their margin equals that of the whole requirement, which means that this
    /// comparison decides it. `values` returns the values that a signal may have had at that time.
    pub(crate) fn decisive(
        &self,
        margin: f64,
        values: impl Fn(&str) -> Vec<f64>,
    ) -> Option<[f64; 2]> {
        let levels = match &self.other {
            Other::Level(level) => vec![*level],
            Other::Signal(other) => values(&other.signal),
        };
        let own = values(&self.side.signal).into_iter();
        let mut pairs = own.flat_map(|value| levels.iter().map(move |level| [value, *level]));
        let [value, level] = pairs.find(|pair| self.decides(*pair, margin))?;
        // The limit of a negative value's magnitude lies below zero.
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
