//! Comparison of the replayed with the recorded values, answer by answer.
//!
//! The [host](super::host) passes each answer as it arrives. Signals are matched by name and unit, so a rebuilt
//! controller may expose more or fewer signals. The samples around the first difference are retained for the person who
//! looks for its cause. Memory is allocated only at the first step with a difference.

use std::collections::BTreeSet;

use shared_types::frame::VALIDITY_WORDS;
use shared_types::layout::{Signal, SignalTable};
use shared_types::time::{Rate, Step};

use super::original::AnswerPlace;
use super::tape::Row;
use crate::arguments::tolerance::Tolerances;
use crate::compare::{Deviation, SignalDifference};

/// Number of samples shown before and after the first difference.
const BEFORE: u64 = 5;
const AFTER: u64 = 2;
/// Number of samples that are retained.
const RETAINED: usize = (BEFORE + 1 + AFTER) as usize;

/// Comparison in progress.
#[derive(Debug)]
pub(super) struct Comparison {
    rate: Rate,
    signals: Vec<Compared>,
    pub only_recorded: Vec<String>,
    pub only_replayed: Vec<String>,
    pub answers: u64,
    /// Samples without a recorded answer: never seen by the controller, or superseded by the next sample.
    pub unanswered: u64,
    first: Option<Mismatch>,
    retained: [RetainedSample; RETAINED],
}

/// Signal that both sides have.
#[derive(Debug)]
struct Compared {
    name: String,
    unit: String,
    /// Index among the recorded answers, and the number of the validity bit if it is compared.
    recorded: usize,
    recorded_bit: Option<usize>,
    /// Index in the replayed frame, and number of its validity bit there.
    replayed: usize,
    deviation: Deviation,
    /// Number of steps at which exactly one of the values is valid.
    validity_steps: u64,
}

/// First difference beyond the tolerances.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mismatch {
    pub(super) step: u64,
    pub(super) time_s: f64,
    pub(super) signal: String,
    pub(super) unit: String,
    pub(super) recorded: f64,
    pub(super) replayed: f64,
    /// Validity of the signal in the recording and in the replay, if the validity differs.
    pub(super) validity: Option<[bool; 2]>,
    /// Names of other signals that differ at this step.
    pub(super) also: Vec<String>,
    /// Index of the signal in the list of compared signals.
    index: usize,
}

/// Sample with both answers.
#[derive(Clone, Debug, Default)]
struct RetainedSample {
    step: Option<u64>,
    is_answered: bool,
    sample: Vec<f64>,
    recorded: Vec<f64>,
    replayed: Vec<f64>,
}

/// Sample near the first difference.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NearbySample {
    pub(super) step: u64,
    pub(super) time_s: f64,
    /// Measured signals, then reference signals.
    pub(super) sample: Vec<f64>,
    /// Recorded value of the differing signal; `None` if the answer was not recorded.
    pub(super) recorded: Option<f64>,
    pub(super) replayed: f64,
}

fn full_name(signal: &Signal) -> String {
    format!("{}.{}", signal.kind.prefix(), signal.field.name)
}

fn is_invalid(bits: &[u64; VALIDITY_WORDS], bit: usize) -> bool {
    bits[bit / 64] >> (bit % 64) & 1 != 0
}

impl Comparison {
    /// Creates the comparison of recorded answers with frames of this table.
    ///
    /// # Errors
    /// If a tolerance applies to a signal that is not compared.
    pub(super) fn new(
        recorded: &[AnswerPlace],
        replayed: &SignalTable,
        tolerances: &Tolerances,
        samples: usize,
        rate: Rate,
    ) -> Result<Self, String> {
        let mut signals = Vec::new();
        let mut only_recorded = Vec::new();
        let mut matched = BTreeSet::new();
        for (place, answer) in recorded.iter().enumerate() {
            let is_it = |signal: &Signal| {
                full_name(signal) == answer.name && signal.field.unit == answer.unit
            };
            let Some(now) = replayed.0.iter().position(is_it) else {
                only_recorded.push(answer.name.clone());
                continue;
            };
            matched.insert(now);
            signals.push(Compared {
                name: answer.name.clone(),
                unit: answer.unit.clone(),
                recorded: place,
                recorded_bit: answer.bit,
                replayed: now,
                deviation: Deviation::new(tolerances.of(&answer.name)),
                validity_steps: 0,
            });
        }
        tolerances.check(signals.iter().map(|signal| signal.name.as_str()))?;
        let others = replayed.0.iter().enumerate();
        let others = others.filter(|(place, _)| !matched.contains(place));
        let retained = RetainedSample {
            sample: vec![0.0; samples],
            recorded: vec![0.0; recorded.len()],
            replayed: vec![0.0; replayed.len()],
            ..RetainedSample::default()
        };
        Ok(Self {
            rate,
            only_recorded,
            only_replayed: others.map(|(_, signal)| full_name(signal)).collect(),
            signals,
            answers: 0,
            unanswered: 0,
            first: None,
            retained: std::array::from_fn(|_| retained.clone()),
        })
    }

    /// Compares the answer to a sample.
    pub(super) fn take(&mut self, row: &Row<'_>, frame: &[f64], invalid: &[u64; VALIDITY_WORDS]) {
        let head = row.head;
        let is_near_first = |first: &Mismatch| head.step <= first.step + AFTER;
        if self.first.as_ref().is_none_or(is_near_first) {
            self.retained[(head.step % RETAINED as u64) as usize].set(row, frame);
        }
        if !head.is_answered {
            self.unanswered += 1;
            return;
        }
        self.answers += 1;
        for index in 0..self.signals.len() {
            let signal = &mut self.signals[index];
            let (a, b) = (row.answer[signal.recorded], frame[signal.replayed]);
            if signal.deviation.take(head.step, a, b) {
                self.note(index, head.step, (a, b), None);
            }
        }
        let all_valid = [0; VALIDITY_WORDS];
        if head.answer_invalid != all_valid || *invalid != all_valid {
            self.compare_validity(row, frame, invalid);
        }
    }

    fn compare_validity(&mut self, row: &Row<'_>, frame: &[f64], invalid: &[u64; VALIDITY_WORDS]) {
        for index in 0..self.signals.len() {
            let signal = &mut self.signals[index];
            let Some(bit) = signal.recorded_bit else {
                continue;
            };
            let was = is_invalid(&row.head.answer_invalid, bit);
            let is = is_invalid(invalid, signal.replayed);
            if was != is {
                signal.validity_steps += 1;
                let values = (row.answer[signal.recorded], frame[signal.replayed]);
                self.note(index, row.head.step, values, Some([!was, !is]));
            }
        }
    }

    fn note(
        &mut self,
        index: usize,
        step: u64,
        (recorded, replayed): (f64, f64),
        validity: Option<[bool; 2]>,
    ) {
        let signal = &self.signals[index];
        match &mut self.first {
            None => {
                self.first = Some(Mismatch {
                    step,
                    time_s: self.rate.seconds(Step(step)),
                    signal: signal.name.clone(),
                    unit: signal.unit.clone(),
                    recorded,
                    replayed,
                    validity,
                    also: Vec::new(),
                    index,
                });
            }
            Some(first) if first.step == step && !first.also.contains(&signal.name) => {
                if first.index != index {
                    first.also.push(signal.name.clone());
                }
            }
            Some(_) => {}
        }
    }

    /// Returns the first difference beyond the tolerances.
    pub(super) const fn first(&self) -> Option<&Mismatch> {
        self.first.as_ref()
    }

    /// Returns `true` if nothing differs, not even within the tolerances.
    pub(super) fn is_same(&self) -> bool {
        let differs = |signal: &Compared| signal.deviation.is_any() || signal.validity_steps > 0;
        !self.signals.iter().any(differs)
    }

    /// Returns the names of the compared signals.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.signals.iter().map(|signal| signal.name.as_str())
    }

    /// Returns each signal that differs, and the number of steps at which exactly one of its values is valid.
    pub(super) fn differences(&self) -> Vec<(SignalDifference, u64)> {
        let differing = self
            .signals
            .iter()
            .filter(|signal| signal.deviation.is_any() || signal.validity_steps > 0);
        differing
            .map(|signal| {
                let Compared { name, unit, .. } = signal;
                let difference = signal.deviation.of(name, unit);
                (difference, signal.validity_steps)
            })
            .collect()
    }

    /// Returns the samples around the first difference.
    pub(super) fn around(&self) -> Vec<NearbySample> {
        let Some(first) = &self.first else {
            return Vec::new();
        };
        let signal = &self.signals[first.index];
        let steps = first.step.saturating_sub(BEFORE)..=first.step + AFTER;
        let mut near: Vec<NearbySample> = (self.retained.iter())
            .filter_map(|retained| {
                let step = retained.step.filter(|step| steps.contains(step))?;
                Some(NearbySample {
                    step,
                    time_s: self.rate.seconds(Step(step)),
                    sample: retained.sample.clone(),
                    recorded: retained
                        .is_answered
                        .then(|| retained.recorded[signal.recorded]),
                    replayed: retained.replayed[signal.replayed],
                })
            })
            .collect();
        near.sort_by_key(|near| near.step);
        near
    }
}

impl RetainedSample {
    fn set(&mut self, row: &Row<'_>, frame: &[f64]) {
        self.step = Some(row.head.step);
        self.is_answered = row.head.is_answered;
        self.sample.copy_from_slice(row.sample);
        self.recorded.copy_from_slice(row.answer);
        self.replayed.copy_from_slice(frame);
    }
}

#[cfg(test)]
mod tests;
