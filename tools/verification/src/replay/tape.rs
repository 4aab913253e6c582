//! Samples and answers of a recorded run, read ahead on a separate thread.
//!
//! The [host](super::host) takes samples in batches, of which there is a fixed number. A batch is passed on once it is
//! known for each of its samples whether the controller saw it, because in a real-time run only a later record contains
//! that information. The tape compares nothing.

use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

use hil_config::plan::Clock;
use hil_recording::reader::{ReadError, RunReader};
use shared_types::directive::{Answered, Directive};
use shared_types::frame::VALIDITY_WORDS;
use shared_types::record::{ControllerChange, ControllerFate, Event, FaultBegun, ValueChange};
use shared_types::time::Step;

use super::original::Places;

/// Number of samples in a batch: some hundred kilobytes.
const BATCH: usize = 1024;
/// Number of batches read ahead.
const AHEAD: usize = 4;

/// Sample as received by the controller, with the answer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row<'a> {
    pub(super) head: &'a Head,
    /// Measured signals, then reference signals.
    pub(super) sample: &'a [f64],
    /// Recorded commands and internal signals.
    pub(super) answer: &'a [f64],
}

/// Data of a sample and its answer, except for their values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Head {
    pub(super) step: u64,
    /// Directive to the controller's runner, without its delays.
    pub(super) directive: Directive,
    pub(super) age_steps: u32,
    pub(super) held_steps: u32,
    pub(super) invalid: [u64; VALIDITY_WORDS],
    /// Set if the answer was recorded: in real time an answer may be superseded by the next.
    pub(super) is_answered: bool,
    pub(super) answer_invalid: [u64; VALIDITY_WORDS],
}

/// Consecutive samples.
#[derive(Debug)]
pub(super) struct Batch {
    heads: Vec<Head>,
    values: Vec<f64>,
    /// Value changes, each with the row before which it took effect.
    changes: Vec<(usize, ValueChange)>,
    samples: usize,
    answers: usize,
}

impl Batch {
    fn new(samples: usize, answers: usize) -> Self {
        Self {
            heads: Vec::with_capacity(BATCH),
            values: Vec::with_capacity(BATCH * (samples + answers)),
            changes: Vec::new(),
            samples,
            answers,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.heads.len()
    }

    pub(super) fn row(&self, index: usize) -> Row<'_> {
        let stride = self.samples + self.answers;
        let values = &self.values[index * stride..][..stride];
        let (sample, answer) = values.split_at(self.samples);
        Row {
            head: &self.heads[index],
            sample,
            answer,
        }
    }

    /// Returns the value changes that took effect at a row.
    pub(super) fn changes(&self, index: usize) -> impl Iterator<Item = &ValueChange> {
        let of_row = self.changes.iter().filter(move |(row, _)| *row == index);
        of_row.map(|(_, change)| change)
    }

    fn clear(&mut self) {
        self.changes.clear();
        self.heads.clear();
        self.values.clear();
    }
}

/// Length of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Length {
    /// Number of samples that were or could have been answered.
    pub(super) steps: u64,
    /// Set if the recording is complete.
    pub(super) is_whole: bool,
}

/// Error of reading a recording for a replay.
#[derive(Debug, thiserror::Error)]
pub(super) enum TapeError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The recording lacks required information.
    #[error("{0}")]
    Lacking(String),
}

/// Handle of the reader thread.
pub(super) struct Tape {
    pub(super) batches: Batches,
    pub(super) reader: JoinHandle<Result<Length, TapeError>>,
}

/// Batches of a tape, in order.
pub(super) struct Batches {
    filled: Receiver<Batch>,
    emptied: Sender<Batch>,
}

impl Batches {
    /// Returns a used batch and takes the next; `None` at the end.
    pub(super) fn exchange(&mut self, done: Option<Batch>) -> Option<Batch> {
        if let Some(done) = done {
            let _ = self.emptied.send(done); // fails only after the reader has ended
        }
        self.filled.recv().ok()
    }
}

impl Tape {
    /// Starts reading a run of `steps` steps; the reader is positioned at its first record.
    pub(super) fn start(reader: RunReader, places: Places, steps: u64, clock: Clock) -> Self {
        let (fill, filled) = sync_channel(AHEAD);
        let (emptied, empty) = channel();
        let winder = Winder {
            against_clock: clock == Clock::Realtime,
            steps,
            batch: Batch::new(places.sample.len(), places.answer.len()),
            open_from: 0,
            held_steps: 0,
            next: 0,
            places,
            fill,
            empty,
        };
        Self {
            batches: Batches { filled, emptied },
            reader: std::thread::spawn(move || winder.wind(reader)),
        }
    }
}

/// Builds batches from records.
struct Winder {
    places: Places,
    against_clock: bool,
    /// Planned number of steps of the run.
    steps: u64,
    batch: Batch,
    /// First step whose answer is still unknown.
    open_from: u64,
    /// `held_steps` of the previous record.
    held_steps: u32,
    /// Step of the next record.
    next: u64,
    fill: SyncSender<Batch>,
    empty: Receiver<Batch>,
}

impl Winder {
    fn wind(mut self, reader: RunReader) -> Result<Length, TapeError> {
        let mut reader = reader.without_digest();
        if self.against_clock
            && (self.places.held_steps.is_none() || self.places.answered.is_none())
        {
            return Err(TapeError::Lacking(
                "the run was in real time, and its recording does not state which samples its controller saw".into(),
            ));
        }
        while reader.advance()? {
            for event in reader.events() {
                self.check(event)?;
                if let Event::Change(change) = event {
                    let row = self.batch.len();
                    self.batch.changes.push((row, change.clone()));
                }
            }
            if reader.step() == self.steps {
                break; // the truth after the last step, which no command answers
            }
            self.take(reader.words())?;
            if self.batch.len() >= BATCH && self.open_from == self.next && !self.hand_over() {
                return Ok(self.length(false)); // the host has ended and wants no more
            }
        }
        while reader.advance()? {}
        if reader.result("lost").is_some_and(|lost| lost != "0") {
            return Err(TapeError::Lacking(format!(
                "{} records were lost at its end, but a replay needs every sample",
                reader.result("lost").unwrap_or_default()
            )));
        }
        // Samples without an answering command were not seen.
        self.close(self.next, &Answered::default(), None);
        self.hand_over();
        Ok(self.length(reader.is_whole()))
    }

    const fn length(&self, is_whole: bool) -> Length {
        Length {
            steps: self.next,
            is_whole,
        }
    }

    /// Refuses recordings of older versions that lack required information.
    fn check(&self, event: &Event) -> Result<(), TapeError> {
        match event {
            Event::Fault(FaultBegun {
                kind,
                target,
                step,
                wall_only: false,
                ..
            }) if target == "controller" && self.places.directive.is_none() => {
                Err(TapeError::Lacking(format!(
                    "fault `{kind}` made the controller late from step {step} on, but this recording lacks the details; record the run again"
                )))
            }
            Event::Controller(ControllerChange {
                epoch,
                step,
                change: ControllerFate::Lost { .. },
            }) => Err(TapeError::Lacking(format!(
                "controller {epoch} was lost at step {step}; later commands did not come from a controller"
            ))),
            _ => Ok(()),
        }
    }

    fn take(&mut self, words: &[u64]) -> Result<(), TapeError> {
        let (step, expected) = (words[0], self.next);
        if step != expected {
            return Err(TapeError::Lacking(format!(
                "found record {step} in place of record {expected}, but a replay needs every sample from step 0 on"
            )));
        }
        let word = |place: Option<usize>| place.map_or(0, |place| words[place]);
        let epoch = word(self.places.epoch);
        if epoch > 1 {
            return Err(TapeError::Lacking(format!(
                "at step {step} another controller had taken over, but a replay has only one"
            )));
        }
        let mut head = Head {
            step,
            directive: Directive {
                busy_ns: 0,
                ..Directive::from_wire(word(self.places.directive))
            },
            age_steps: word(self.places.sample_age_steps) as u32,
            held_steps: self.held_steps,
            ..Head::default()
        };
        for (to, place) in head.invalid.iter_mut().zip(&self.places.sample_invalid) {
            *to = words[*place];
        }
        self.batch.heads.push(head);
        let sample = self.places.sample.iter();
        (self.batch.values).extend(sample.map(|place| f64::from_bits(words[*place])));
        let width = self.batch.values.len() + self.batch.answers;
        self.batch.values.resize(width, f64::NAN);
        self.next += 1;

        let held_steps = word(self.places.held_steps);
        self.held_steps = held_steps as u32;
        let command = step.checked_sub(held_steps);
        if let Some(command) = command.filter(|command| *command >= self.open_from) {
            let answered = Answered::from_wire(word(self.places.answered));
            self.close(command + 1, &answered, Some(words));
        }
        Ok(())
    }

    /// Determines the fate of all samples before a step: the last of them was answered by these words, if any, and
    /// those before it as stated by `answered`. The rest were not seen.
    fn close(&mut self, end: u64, answered: &Answered, words: Option<&[u64]>) {
        let first = self.next - self.batch.len() as u64;
        for step in self.open_from..end {
            let index = (step - first) as usize;
            let is_last = step + 1 == end && words.is_some();
            let mut before = answered.steps(Step(end - 1));
            let is_seen = is_last || (words.is_some() && before.any(|before| before.0 == step));
            let head = &mut self.batch.heads[index];
            head.directive.unseen |= !is_seen;
            let (true, Some(words)) = (is_last, words) else {
                continue;
            };
            head.is_answered = !head.directive.unseen;
            for (to, place) in head
                .answer_invalid
                .iter_mut()
                .zip(&self.places.answer_invalid)
            {
                *to = words[*place];
            }
            let stride = self.batch.samples + self.batch.answers;
            let answer = &mut self.batch.values[index * stride + self.batch.samples..];
            for (to, place) in answer.iter_mut().zip(&self.places.answer) {
                *to = f64::from_bits(words[place.word]);
            }
        }
        self.open_from = end;
    }

    /// Passes the batch to the host and takes an empty one; returns `false` if the host has ended.
    fn hand_over(&mut self) -> bool {
        let (samples, answers) = (self.batch.samples, self.batch.answers);
        let empty = self.empty.try_recv();
        let mut empty = empty.unwrap_or_else(|_| Batch::new(samples, answers));
        empty.clear();
        self.fill
            .send(std::mem::replace(&mut self.batch, empty))
            .is_ok()
    }
}

#[cfg(test)]
mod tests;
