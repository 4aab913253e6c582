//! Answers of the bound law: the command in the frame of each step, and its age.
//!
//! Called by the runner for every sample accepted by its side of the protocol. Sends nothing and is independent of the
//! link.

use hil_session::clock::monotonic_ns;
use serde::{Deserialize, Serialize};
use shared_types::directive::{Answered, Directive};
use shared_types::failure::Failure;
use shared_types::frame::Header;
use shared_types::quality::SignalSet;
use shared_types::table::Field;
use shared_types::time::Step;

use super::Bound;
use crate::controller::{Answer, Row};
use crate::job::Job;

/// Steps of the samples on which commands are based: for the last answer, the previous one, the last frame sent and the
/// late one.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Made {
    pub(super) answer: i64,
    pub(super) previous: i64,
    pub(super) frame: i64,
    pub(super) late: i64,
}

/// Commands that are not refreshed, of the rows of commands named as in [`Made`].
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Held {
    pub(super) answer: SignalSet,
    pub(super) previous: SignalSet,
    pub(super) frame: SignalSet,
    pub(super) late: SignalSet,
}

/// Returns the row of a frame before the first answer: the start values that the plant declares for its commands, and
/// 0 for everything else.
pub(super) fn begin(commands: &[Field], signals: usize) -> Vec<f64> {
    let starts = commands.iter().map(|field| field.default.unwrap_or(0.0));
    let mut row: Vec<f64> = starts.collect();
    row.resize(signals, 0.0);
    row
}

impl Bound {
    /// Fills the frame that answers a sample; returns the age of its command in steps.
    pub(super) fn answer(
        &mut self,
        step: Step,
        header: &Header,
        job: &Job,
    ) -> Result<u32, Failure> {
        let is_unseen = Directive::from_wire(header.directive).unseen;
        if !is_unseen {
            let places = (&self.measured_places[..], &self.reference_places[..]);
            self.quality.note(step, header, &self.sample, places);
        }
        match self.late_until {
            _ if is_unseen => {}
            Some(due) if step < due => {}
            Some(_) => {
                self.late_until = None;
                self.frame.copy_from_slice(&self.late);
                self.made.frame = self.made.late;
                self.held.frame = self.held.late;
            }
            None => self.take(step, header, job)?,
        }
        Ok((step.0 as i64 - self.made.frame) as u32)
    }

    /// Records that a step is answered, if its sample was received; returns the steps answered earlier.
    pub(super) fn note(&mut self, step: Step, is_seen: bool) -> Answered {
        if !is_seen {
            return self.answered;
        }
        if let Some(last) = self.last {
            self.answered = self.answered.then((step.0 - last.0) as u32);
        }
        self.last = Some(step);
        self.answered
    }

    /// Samples the statistics of this thread, as one word.
    pub(super) fn look(&mut self, answered_ns: u64) -> u64 {
        let cycle_ns = answered_ns - self.sent_ns;
        self.sent_ns = answered_ns;
        self.sampler.after(cycle_ns)
    }

    /// Processes a sample and the timing directive in its header.
    fn take(&mut self, step: Step, header: &Header, job: &Job) -> Result<(), Failure> {
        let commands = self.previous.len();
        self.previous.copy_from_slice(&self.answer[..commands]);
        self.made.previous = self.made.answer;
        self.held.previous = self.held.answer;
        if self.is_due(step, job) {
            self.run_law(step, header, job)?;
            self.made.answer = step.0 as i64;
        }
        let directive = Directive::from_wire(header.directive);
        let (frame, made, held) = if directive.late_steps == 0 {
            (&mut self.frame, &mut self.made.frame, &mut self.held.frame)
        } else {
            self.late_until = Some(Step(step.0 + u64::from(directive.late_steps)));
            (&mut self.late, &mut self.made.late, &mut self.held.late)
        };
        frame.copy_from_slice(&self.answer);
        (*made, *held) = (self.made.answer, self.held.answer);
        if job.command_delay_steps > 0 {
            frame[..commands].copy_from_slice(&self.previous);
            (*made, *held) = (self.made.previous, self.held.previous);
        }
        if directive.busy_ns > 0 {
            let since_ns = monotonic_ns();
            while monotonic_ns() - since_ns < u64::from(directive.busy_ns) {
                std::hint::spin_loop();
            }
        }
        Ok(())
    }

    /// Returns `true` if the law runs at a step: at the first sample received in each of its periods.
    fn is_due(&self, step: Step, job: &Job) -> bool {
        let period = |step: Step| step.0 / u64::from(job.rate_divisor);
        self.last.is_none_or(|last| period(step) != period(last))
    }

    fn run_law(&mut self, step: Step, header: &Header, job: &Job) -> Result<(), Failure> {
        for (value, place) in self.measured.iter_mut().zip(&self.measured_places) {
            *value = self.sample[*place];
        }
        for (value, place) in self.reference.iter_mut().zip(&self.reference_places) {
            *value = self.sample[*place];
        }
        self.converted
            .sample(&mut self.measured, &mut self.reference);
        let row = Row {
            time_s: job.rate.seconds(step),
            measured: &self.measured,
            reference: &self.reference,
            valid: self.quality.is_valid(),
            held_steps: header.held_steps,
        };
        self.tuning.apply(step, self.law.as_mut());
        let (command, internals) = self.answer.split_at_mut(self.previous.len());
        self.held.answer.clear();
        let answer = Answer {
            command,
            internals,
            held: &mut self.held.answer,
        };
        self.law.answer(&row, &self.quality.view(), answer)?;
        let (command, _) = self.answer.split_at_mut(self.previous.len());
        self.converted.command(command);
        if self.held.answer.any() {
            for index in self.held.answer.iter(command.len()) {
                command[index] = self.previous[index];
            }
        }
        Ok(())
    }
}
