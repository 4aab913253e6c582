//! Parameters of the law that change during a run: the plant's messages about them, and their application.
//!
//! A sample carries the number of the messages that precede it. The runner answers the sample with the courses of that
//! number and evaluates them at the sample's own step, so the values do not depend on when a message arrived, and a law
//! that missed steps gets the values of its sample's step.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};
use shared_types::describe::{Invalid, LawDescription, Settings};
use shared_types::hello::TunableParameter;
use shared_types::time::Step;
use shared_types::tuning::{Course, Tuned};

use crate::controller::{Law, Transition, TunedRows};

/// Maximum number of messages waiting for their sample; the plant sends at most one per step.
const MOST: usize = 64;

/// Current and future parameters of the law.
#[derive(Debug)]
pub(super) struct Tuning {
    /// Index of each tunable parameter in the row.
    places: Vec<usize>,
    /// Every parameter, with its value at the start and its current value.
    started: Vec<f64>,
    parameters: Vec<f64>,
    model: Vec<f64>,
    period_s: f64,
    /// Courses in force.
    state: Tuned,
    /// Messages of later samples, by ascending number.
    waiting: VecDeque<Tuned>,
    /// `true` if the law's parameters may differ from the courses at its next sample.
    is_due: bool,
}

/// Result of a search for the courses of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// The courses are now in force.
    Here,
    /// The message has not arrived.
    Missing,
    /// The message was lost because newer ones replaced it; a newer sample follows.
    Lost,
}

/// State of the parameters for a checkpoint.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct SavedTuning {
    number: u64,
    /// Index, from, to, begin and steps of each course.
    courses: Vec<(u32, f64, f64, u64, u64)>,
    parameters: Vec<f64>,
    is_due: bool,
}

impl Tuning {
    /// Starts with the values of a job.
    pub(super) fn new(
        law: &LawDescription,
        parameters: &Settings,
        model: &Settings,
        period_s: f64,
    ) -> Self {
        let row = |fields: &[shared_types::table::Field], settings: &Settings| {
            // The law was started from them, so none is missing.
            let value = |field: &shared_types::table::Field| settings.get(&field.name);
            let values = fields.iter().map(|field| value(field).unwrap_or(f64::NAN));
            values.collect::<Vec<f64>>()
        };
        let is_tunable = |place: &usize| law.parameters[*place].tunable;
        let started = row(&law.parameters, parameters);
        Self {
            places: (0..law.parameters.len()).filter(is_tunable).collect(),
            parameters: started.clone(),
            started,
            model: row(&law.model, model),
            period_s,
            state: Tuned::default(),
            waiting: VecDeque::new(),
            is_due: false,
        }
    }

    /// Returns the number of the courses in force.
    #[inline]
    pub(super) const fn number(&self) -> u64 {
        self.state.number
    }

    /// Stores a message of the plant. A message about a parameter that the law does not offer is ignored.
    pub(super) fn hear(&mut self, tuned: Tuned) {
        let is_known = |(place, _): &(u32, Course)| (*place as usize) < self.places.len();
        let newest = self
            .waiting
            .back()
            .map_or(self.state.number, |last| last.number);
        if tuned.number > newest && tuned.courses.iter().all(is_known) {
            if self.waiting.len() == MOST {
                self.waiting.pop_front();
            }
            self.waiting.push_back(tuned);
        }
    }

    /// Puts the courses of a number in force, if they have arrived.
    pub(super) fn find(&mut self, number: u64) -> Found {
        while let Some(first) = self.waiting.front() {
            if first.number > number {
                return Found::Lost;
            }
            let is_it = first.number == number;
            if let Some(state) = self.waiting.pop_front()
                && is_it
            {
                self.state = state;
                self.is_due = true;
                return Found::Here;
            }
        }
        Found::Missing
    }

    /// Updates the law's parameters to those of a step, if they differ.
    #[inline]
    pub(super) fn apply(&mut self, step: Step, law: &mut dyn Law) {
        if self.is_due {
            self.give(step, law);
        }
    }

    fn give(&mut self, step: Step, law: &mut dyn Law) {
        let (mut has_changed, mut jumps) = (false, false);
        self.is_due = false;
        for (number, &place) in (0_u32..).zip(&self.places) {
            let course = self.state.courses.iter().find(|(own, _)| *own == number);
            let (value, is_on_ramp) = match course {
                Some((_, course)) => (
                    course.at(step),
                    // A law that missed a part of it jumps: its values are from before the beginning.
                    course.is_ramp() && step.0 <= course.end().0,
                ),
                None => (self.started[place], false),
            };
            self.is_due |= course.is_some_and(|(_, course)| !course.is_over(step));
            let before = &mut self.parameters[place];
            if before.to_bits() != value.to_bits() {
                *before = value;
                has_changed = true;
                jumps |= !is_on_ramp;
            }
        }
        if has_changed {
            let transition = if jumps {
                Transition::Step
            } else {
                Transition::Ramp
            };
            law.retune(&self.rows(), transition);
        }
    }

    fn rows(&self) -> TunedRows<'_> {
        TunedRows {
            parameters: &self.parameters,
            model: &self.model,
            period_s: self.period_s,
        }
    }

    /// Returns the state for a checkpoint.
    pub(super) fn save(&self) -> SavedTuning {
        let course = |(place, course): &(u32, Course)| {
            let Course {
                from,
                to,
                begin,
                steps,
            } = *course;
            (*place, from, to, begin.0, steps)
        };
        SavedTuning {
            number: self.state.number,
            courses: self.state.courses.iter().map(course).collect(),
            parameters: self.parameters.clone(),
            is_due: self.is_due,
        }
    }

    /// Restores a saved state and passes the parameters to the law, whose own state must be restored afterwards.
    ///
    /// # Errors
    /// If the bytes are not a state of this law.
    pub(super) fn restore(
        &mut self,
        saved: &SavedTuning,
        law: &mut dyn Law,
    ) -> Result<(), Invalid> {
        if saved.parameters.len() != self.parameters.len() {
            return Err(Invalid(
                "the parameters in the state are not those of this law".into(),
            ));
        }
        let course = |&(place, from, to, begin, steps): &(u32, f64, f64, u64, u64)| {
            let begin = Step(begin);
            (
                place,
                Course {
                    from,
                    to,
                    begin,
                    steps,
                },
            )
        };
        self.state = Tuned {
            number: saved.number,
            courses: saved.courses.iter().map(course).collect(),
        };
        self.is_due = saved.is_due;
        self.parameters.clone_from(&saved.parameters);
        if saved.number > 0 {
            law.retune(&self.rows(), Transition::Ramp);
        }
        Ok(())
    }
}

/// Lists the tunable parameters of a law, with their values in a job.
pub(super) fn offered(
    law: &LawDescription,
    parameters: &Settings,
    unreadable: &[String],
) -> Vec<TunableParameter> {
    let offered = law.tunable().filter_map(|field| {
        Some(TunableParameter {
            field: field.clone(),
            // The program takes its default for one that the scenario leaves out; without one, the value is not set.
            value: (parameters.get(&field.name))
                .or_else(|| field.is_optional.then(|| field.default.unwrap_or(f64::NAN)))?,
            is_unreadable: unreadable.contains(&field.name),
        })
    });
    offered.collect()
}
