//! Values that change during a run: the course of one value from old to new, and the messages by which the plant passes
//! the law's values to the controller.
//!
//! The plant decides when a change begins. A message with the courses of all law parameters changed so far precedes the
//! first sample to which it applies, and each sample carries the number of such messages so far
//! ([`Header::tuning`](crate::frame::Header::tuning)). The runner answers a sample only with the courses of that
//! number, whichever of the two arrives first; if a newer message replaces an unread one, only the samples between them
//! are lost.

use serde::{Deserialize, Serialize};

use crate::table::number;
use crate::time::Step;

/// Course of a value.
///
/// `from + (to - from) (k - begin) / steps` at step k of the ramp, `from` before the ramp and `to` after it. With zero
/// steps, or if `from` or `to` is infinite, the value is `to` from the first step on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Course {
    /// Value before.
    #[serde(with = "number")]
    pub from: f64,
    /// Value at the end.
    #[serde(with = "number")]
    pub to: f64,
    /// First step of the change.
    pub begin: Step,
    /// Number of steps from the beginning to the end.
    pub steps: u64,
}

impl Course {
    /// Returns the value at a step.
    #[must_use]
    pub fn at(&self, step: Step) -> f64 {
        let Some(since) = step.0.checked_sub(self.begin.0) else {
            return self.from;
        };
        if since >= self.steps || !self.is_ramp() {
            return self.to;
        }
        let share = since as f64 / self.steps as f64;
        // Avoids the difference, which may exceed the largest number.
        self.from * (1.0 - share) + self.to * share
    }

    /// Returns the slope to the right of a step, in units per step.
    #[must_use]
    pub fn slope_at(&self, step: Step) -> f64 {
        let goes = self.is_ramp() && step >= self.begin && !self.is_over(step);
        match goes {
            true => self.to / self.steps as f64 - self.from / self.steps as f64,
            false => 0.0,
        }
    }

    /// Returns `true` if the value takes time to change.
    #[must_use]
    pub const fn is_ramp(&self) -> bool {
        self.steps > 0 && self.from.is_finite() && self.to.is_finite()
    }

    /// Returns `true` if the value is constant from a step on.
    #[must_use]
    pub const fn is_over(&self, step: Step) -> bool {
        step.0 >= self.end().0
    }

    /// Returns the first step at which the value has reached its target.
    #[must_use]
    pub const fn end(&self) -> Step {
        match self.is_ramp() {
            true => Step(self.begin.0.saturating_add(self.steps)),
            false => self.begin,
        }
    }
}

/// All law parameters that have been changed so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tuned {
    /// Number of the message in the run, from 1.
    pub number: u64,
    /// Course of each parameter, by the parameter's index among the tunable ones in the hello.
    pub courses: Vec<(u32, Course)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(from: f64, to: f64, steps: u64) -> Course {
        Course {
            from,
            to,
            begin: Step(10),
            steps,
        }
    }

    #[test]
    fn a_ramp_is_straight_between_its_ends() {
        let ramp = course(2.0, 4.0, 4);
        let values = [9, 10, 11, 12, 13, 14, 99].map(|step| ramp.at(Step(step)));
        assert_eq!(values, [2.0, 2.0, 2.5, 3.0, 3.5, 4.0, 4.0]);
        let slopes = [9, 10, 13, 14].map(|step| ramp.slope_at(Step(step)));
        assert_eq!(slopes, [0.0, 0.5, 0.5, 0.0]);
        let over = [9, 10, 13, 14].map(|step| ramp.is_over(Step(step)));
        assert_eq!(over, [false, false, false, true]);
    }

    #[test]
    fn without_steps_the_value_changes_at_once() {
        let step = course(2.0, 4.0, 0);
        assert_eq!([9, 10].map(|k| step.at(Step(k))), [2.0, 4.0]);
        assert!(step.is_over(Step(10)) && step.slope_at(Step(10)) == 0.0);
    }

    #[test]
    fn no_ramp_leads_to_or_from_infinity_or_out_of_range() {
        for (from, to) in [(f64::INFINITY, 1.0), (1.0, f64::INFINITY)] {
            let jump = course(from, to, 4);
            assert_eq!([9, 10, 12].map(|k| jump.at(Step(k))), [from, to, to]);
            assert!(jump.is_over(Step(10)));
        }
        let widest = course(-f64::MAX, f64::MAX, 2);
        assert_eq!(widest.at(Step(11)), 0.0);
        assert_eq!(widest.slope_at(Step(11)), f64::MAX);
    }
}
