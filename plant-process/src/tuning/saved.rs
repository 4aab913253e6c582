//! Form of all changes in a checkpoint: courses, and the pending live changes.
//!
//! Changes of the scenario are not included: a resumed run takes them from its scenario.

use hil_config::plan::Change;
use serde::{Deserialize, Serialize};
use shared_types::live::ChangedValue;
use shared_types::time::Step;
use shared_types::tuning::Course;

use super::{NEVER, Tuning};

/// Course in a checkpoint: from, to, begin, steps.
type SavedCourse = (f64, f64, u64, u64);

/// Pending change: step, ramp, values with their units, cleared signals.
type SavedChange = (u64, u64, Vec<(String, String, f64)>, Vec<String>);

/// State of all changes between two steps.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct SavedTuning {
    plant: Vec<(usize, SavedCourse)>,
    law: Vec<(String, SavedCourse)>,
    references: Vec<(String, SavedCourse)>,
    number: u64,
    /// Pending live changes.
    waiting: Vec<SavedChange>,
    accepted: usize,
}

fn saved(course: &Course) -> SavedCourse {
    let Course {
        from,
        to,
        begin,
        steps,
    } = *course;
    (from, to, begin.0, steps)
}

fn restored((from, to, begin, steps): SavedCourse) -> Course {
    Course {
        from,
        to,
        begin: Step(begin),
        steps,
    }
}

impl Tuning {
    pub(crate) fn save(&self) -> SavedTuning {
        let waiting = (self.waiting.iter().filter(|change| change.live)).map(|change| {
            let set = (change.set.iter())
                .map(|one| (one.key.clone(), one.unit.clone(), one.value))
                .collect();
            let step = change.step.unwrap_or(NEVER).0;
            (step, change.ramp_steps, set, change.clear.clone())
        });
        let courses = self.references.iter();
        SavedTuning {
            plant: (self.plant.iter())
                .map(|(place, course)| (*place, saved(course)))
                .collect(),
            law: (self.law.iter())
                .map(|(key, course)| (key.clone(), saved(course)))
                .collect(),
            references: courses
                .filter_map(|one| Some((one.key.clone(), saved(one.course.as_ref()?))))
                .collect(),
            number: self.number,
            waiting: waiting.collect(),
            accepted: self.accepted,
        }
    }

    /// Restores a state, before a step.
    pub(crate) fn restore(&mut self, state: SavedTuning, first: Step) {
        let places = self.fields.len();
        self.plant = (state.plant.into_iter())
            .filter(|(place, _)| *place < places)
            .map(|(place, course)| (place, restored(course)))
            .collect();
        self.law = (state.law.into_iter())
            .map(|(key, course)| (key, restored(course)))
            .collect();
        for (key, course) in state.references {
            if let Some(signal) = self.references.iter_mut().find(|one| one.key == key) {
                signal.course = Some(restored(course));
            }
        }
        self.number = state.number;
        self.accepted = self.accepted.max(state.accepted);
        for (step, ramp_steps, set, clear) in state.waiting {
            self.last_id += 1;
            let set = set.into_iter();
            self.waiting.push_back(Change {
                id: self.last_id,
                step: Some(Step(step)),
                ramp_steps,
                live: true,
                set: set
                    .map(|(key, unit, value)| ChangedValue { key, unit, value })
                    .collect(),
                clear,
            });
        }
        self.next = first;
        self.sort();
    }
}
