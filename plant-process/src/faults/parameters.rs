//! The plant's parameters under faults.
//!
//! Recomputed at each step by the layer while a fault acts on a parameter: from the healthy values, fault by fault, so
//! that an ended fault leaves no trace. No fault moves a parameter out of the range in which the plant is valid: the
//! parameter stops at the bound, and NaN changes nothing. The fault's effect is measured after this limitation.

use serde::{Deserialize, Serialize};
use shared_types::describe::{Invalid, Operation};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use super::effect::{Action, Effect};
use super::kind::Reading;

/// Healthy and effective parameters.
pub(super) struct Parameters {
    fields: Vec<Field>,
    healthy: Vec<f64>,
    present: Vec<f64>,
    before: Vec<f64>,
    /// Indices of the faultable parameters.
    faultable: Vec<usize>,
    /// Effects that act on parameters, in the order in which they began.
    stack: Vec<usize>,
    /// `true` after an effect ended: the parameters must be recomputed even if no effect is left.
    stale: bool,
}

/// Saved state of the parameters.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedParameters {
    present: Vec<f64>,
    stack: Vec<usize>,
}

impl SavedParameters {
    /// Returns all effective parameters.
    pub(super) fn row(&self) -> &[f64] {
        &self.present
    }
}

impl Parameters {
    pub(super) fn new(fields: &[Field], healthy: &[f64]) -> Self {
        let faultable = |index: &usize| fields[*index].faultable;
        Self {
            fields: fields.to_vec(),
            healthy: healthy.to_vec(),
            present: healthy.to_vec(),
            before: healthy.to_vec(),
            faultable: (0..fields.len()).filter(faultable).collect(),
            stack: Vec::new(),
            stale: false,
        }
    }

    /// Returns the state.
    pub(super) fn save(&self) -> SavedParameters {
        SavedParameters {
            present: self.present.clone(),
            stack: self.stack.clone(),
        }
    }

    /// Checks if a state belongs to these parameters.
    pub(super) fn check(&self, saved: &SavedParameters) -> Result<(), Invalid> {
        if saved.present.len() == self.present.len() {
            Ok(())
        } else {
            Err(Invalid(
                "the parameters in the state are not those of this plant".into(),
            ))
        }
    }

    /// Restores a saved state.
    pub(super) fn restore(&mut self, saved: SavedParameters) -> Result<(), Invalid> {
        self.check(&saved)?;
        // Not replaced: it has room for every armed effect.
        self.stack.clone_from(&saved.stack);
        self.present = saved.present;
        Ok(())
    }

    /// Returns all effective parameters.
    pub(super) fn row(&self) -> &[f64] {
        &self.present
    }

    /// Returns the effective faultable parameters.
    pub(super) fn faultable(&self) -> impl Iterator<Item = f64> {
        self.faultable.iter().map(|&index| self.present[index])
    }

    /// Returns the effects that act on parameters.
    pub(super) const fn stack(&mut self) -> &mut Vec<usize> {
        &mut self.stack
    }

    /// Sets the healthy value of a parameter.
    pub(super) fn rebase(&mut self, index: usize, value: f64) {
        if self.healthy[index].to_bits() != value.to_bits() {
            self.healthy[index] = value;
            self.stale = true;
        }
    }

    /// Marks that an effect ended.
    pub(super) const fn heal(&mut self) {
        self.stale = true;
    }

    /// Advances the parameters to a step; returns `true` if one changed.
    pub(super) fn advance(&mut self, effects: &mut [Effect], step: Step, rate: Rate) -> bool {
        if self.stack.is_empty() && !self.stale {
            return false;
        }
        self.stale = false;
        self.before.copy_from_slice(&self.present);
        self.present.copy_from_slice(&self.healthy);
        for &effect in &self.stack {
            apply(
                &mut effects[effect],
                &self.fields,
                &mut self.present,
                step,
                rate,
            );
        }
        self.present != self.before
    }
}

/// Applies an effect. If the effect moves several parameters, its size is that of the first parameter.
fn apply(effect: &mut Effect, fields: &[Field], row: &mut [f64], step: Step, rate: Rate) {
    let at = effect.moment(step, rate);
    let (mut acted, mut change) = (false, 0.0);
    match &mut effect.action {
        Action::Move(moves) => {
            for (place, &mut (index, operation, by)) in moves.iter_mut().enumerate() {
                let value = row[index];
                row[index] = kept(&fields[index], value, moved(operation, value, by, at.gain));
                acted |= row[index] != value;
                if place == 0 {
                    change = (row[index] - value).abs();
                }
            }
        }
        Action::Parameter(index, fault) => {
            let value = row[*index];
            let target = fault.number(&at, Reading { value, valid: true }).value;
            row[*index] = kept(&fields[*index], value, target);
            acted = row[*index] != value;
            change = (row[*index] - value).abs();
        }
        _ => {}
    }
    effect.note(acted, change);
}

/// Returns a value after an operation by `by` at a profile of `gain`.
fn moved(operation: Operation, value: f64, by: f64, gain: f64) -> f64 {
    match operation {
        Operation::Add => value + by * gain,
        Operation::Scale => value * (1.0 + (by - 1.0) * gain),
        Operation::Set if gain == 1.0 => by, // exactly, which the sum below need not be
        Operation::Set => value + (by - value) * gain,
    }
}

/// Returns a new value of a parameter, limited to its range.
fn kept(field: &Field, value: f64, target: f64) -> f64 {
    if target.is_nan() {
        value
    } else if target < field.min {
        field.min
    } else if target > field.max {
        field.max
    } else {
        target
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_follow_their_equations_within_the_range() {
        let field = Field {
            min: -10.0,
            max: 10.0,
            ..Field::signal("x_n", "N", "x")
        };
        for (operation, by, gain, expected) in [
            (Operation::Add, 3.0, 0.5, 5.5),
            (Operation::Scale, 0.5, 1.0, 2.0),
            (Operation::Scale, 0.5, 0.5, 3.0),
            (Operation::Set, -1.0, 1.0, -1.0),
            (Operation::Set, 0.1, 1.0, 0.1),
            (Operation::Set, 0.0, 0.25, 3.0),
            (Operation::Add, 100.0, 1.0, 10.0),
            (Operation::Add, -100.0, 1.0, -10.0),
            (Operation::Scale, f64::INFINITY, 1.0, 10.0),
            (Operation::Set, f64::INFINITY, 0.0, 4.0),
        ] {
            let actual = kept(&field, 4.0, moved(operation, 4.0, by, gain));
            assert_eq!(actual, expected, "{operation:?} {by} {gain}");
        }
    }
}
