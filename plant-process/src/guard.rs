//! The validity guard: ends a run at the step at which the plant leaves the range of validity of its equations, and
//! names the signal.
//!
//! Called by the engine with every row that enters or leaves the plant. The guard never corrects a value.

use std::fmt;

use hil_config::plan::Limit;
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::number::{exact, exact_in};
use shared_types::quality::SignalSet;
use shared_types::table::Field;

/// Ranges of the signals of a row, in the order of the row.
#[derive(Debug)]
pub struct Guard {
    fields: Vec<Field>,
    /// Smallest and largest value of each signal, finite.
    ranges: Vec<[f64; 2]>,
}

/// Guards of the rows that the engine handles.
pub(crate) struct Guards {
    pub measured: Guard,
    pub command: Guard,
    pub truth: Guard,
}

impl Guards {
    /// Creates the guards of a plant. `limits`, if there are any, replace those of its truth, or of its readings behind a
    /// port.
    pub(crate) fn new(plant: &PlantDescription, limits: &[Limit]) -> Result<Self, Invalid> {
        let (of_measured, of_truth) = match plant.port {
            Some(_) => (limits, &[][..]),
            None => (&[][..], limits),
        };
        Ok(Self {
            measured: Guard::new(&plant.measured, of_measured)?,
            command: Guard::new(&plant.commands, &[])?,
            truth: Guard::new(&plant.truth, of_truth)?,
        })
    }
}

/// Signal that is outside its range, or is not a finite number.
#[derive(Clone, Debug, PartialEq)]
pub struct OutOfRange {
    /// The signal.
    pub signal: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
    /// Lower limit.
    pub min: f64,
    /// Upper limit.
    pub max: f64,
}

impl std::error::Error for OutOfRange {}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            signal,
            value,
            unit,
            min,
            max,
        } = self;
        if value.is_finite() {
            let (value, min, max) = (exact_in(*value, unit), exact(*min), exact_in(*max, unit));
            write!(f, "{signal} = {value} is outside {min} to {max}")
        } else {
            write!(f, "{signal} = {value} is not a finite number")
        }
    }
}

impl Guard {
    /// Combines the signals' own ranges with the scenario's limits, which override them.
    ///
    /// # Errors
    /// If a limit names no signal of the row.
    pub fn new(signals: &[Field], limits: &[Limit]) -> Result<Self, Invalid> {
        let mut fields = signals.to_vec();
        for limit in limits {
            let field = (fields.iter_mut()).find(|field| field.name == limit.signal);
            let field =
                field.ok_or_else(|| Invalid(format!("no signal `{}` to limit", limit.signal)))?;
            (field.min, field.max) = (limit.min, limit.max);
        }
        let finite = |bound: f64| bound.clamp(f64::MIN, f64::MAX);
        Ok(Self {
            ranges: (fields.iter())
                .map(|field| [finite(field.min), finite(field.max)])
                .collect(),
            fields,
        })
    }

    /// Checks a row: finite and inside the limits.
    ///
    /// # Errors
    /// The first signal that violates the limits.
    #[inline]
    pub fn check(&self, row: &[f64]) -> Result<(), OutOfRange> {
        self.check_valid(row, &SignalSet::EMPTY)
    }

    /// Checks the signals of a row that are not marked as invalid.
    ///
    /// # Errors
    /// The first signal that violates them.
    #[inline]
    pub(crate) fn check_valid(&self, row: &[f64], invalid: &SignalSet) -> Result<(), OutOfRange> {
        // All of them, without a branch: called at every step, and hardly ever violated.
        let fits =
            |all, ([min, max], value): (&[f64; 2], &f64)| all & (min <= value) & (value <= max);
        if self.ranges.iter().zip(row).fold(true, fits) {
            return Ok(());
        }
        self.first_bad(row, invalid)
    }

    #[cold]
    fn first_bad(&self, row: &[f64], invalid: &SignalSet) -> Result<(), OutOfRange> {
        let is_bad = |(index, (field, value)): &(usize, (&Field, &f64))| {
            !(invalid.contains(*index) || value.is_finite() && field.admits(**value))
        };
        let bad = (self.fields.iter().zip(row).enumerate()).find(is_bad);
        match bad {
            None => Ok(()),
            Some((_, (field, &value))) => Err(OutOfRange {
                signal: field.name.clone(),
                value,
                unit: field.unit.clone(),
                min: field.min,
                max: field.max,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard(limits: &[Limit]) -> Result<Guard, Invalid> {
        let free = Field::signal("angle_rad", "rad", "x");
        let bounded = Field {
            min: 0.0,
            max: 2.0,
            ..Field::signal("pressure_pa", "Pa", "x")
        };
        Guard::new(&[free, bounded], limits)
    }

    #[test]
    fn the_signal_that_left_its_range_is_named() {
        let guard = guard(&[]).expect("legal");
        assert_eq!(guard.check(&[5.0, 2.0]), Ok(()));
        let text = guard.check(&[5.0, -1.0]).unwrap_err().to_string();
        assert_eq!(text, "pressure_pa = -1 Pa is outside 0 to 2 Pa");
    }

    #[test]
    fn only_finite_numbers_pass() {
        let guard = guard(&[]).expect("legal");
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let text = guard.check(&[value, 1.0]).unwrap_err().to_string();
            assert_eq!(text, format!("angle_rad = {value} is not a finite number"));
        }
    }

    #[test]
    fn a_scenario_overrides_the_limits() {
        let limit = Limit {
            signal: "pressure_pa".into(),
            min: -5.0,
            max: 5.0,
        };
        assert_eq!(guard(&[limit]).expect("legal").check(&[0.0, -1.0]), Ok(()));
        let unknown = Limit {
            signal: "presure_pa".into(),
            min: 0.0,
            max: 1.0,
        };
        assert!(guard(&[unknown]).is_err());
    }
}
