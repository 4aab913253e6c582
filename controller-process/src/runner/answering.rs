//! Answers of the bound law: the command in the frame of each step, and its age.
//!
//! Called by the runner for every sample accepted by its side of the protocol. Sends nothing and is independent of the
//! link.

use hil_session::clock::monotonic_ns;
use shared_types::directive::{Answered, Directive};
use shared_types::failure::Failure;
use shared_types::frame::Header;
use shared_types::time::Step;

use super::Bound;
use crate::controller::Row;
use crate::job::Job;

impl Bound {
    /// Fills the frame that answers a sample; returns the age of its command in steps.
    pub(super) fn answer(
        &mut self,
        step: Step,
        header: &Header,
        job: &Job,
    ) -> Result<u32, Failure> {
        match self.late_until {
            _ if Directive::from_wire(header.directive).unseen => {}
            Some(due) if step < due => {}
            Some(_) => {
                self.late_until = None;
                self.frame.copy_from_slice(&self.late);
                self.made.frame = self.made.late;
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
        if self.is_due(step, job) {
            self.run_law(step, header, job)?;
            self.made.answer = step.0 as i64;
        }
        let directive = Directive::from_wire(header.directive);
        let (frame, made) = if directive.late_steps == 0 {
            (&mut self.frame, &mut self.made.frame)
        } else {
            self.late_until = Some(Step(step.0 + u64::from(directive.late_steps)));
            (&mut self.late, &mut self.made.late)
        };
        frame.copy_from_slice(&self.answer);
        *made = self.made.answer;
        if job.command_delay_steps > 0 {
            frame[..commands].copy_from_slice(&self.previous);
            *made = self.made.previous;
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
        let mut valid = true;
        for (value, place) in self.measured.iter_mut().zip(&self.measured_places) {
            *value = self.sample[*place];
            valid &= header.is_valid(*place);
        }
        for (value, place) in self.reference.iter_mut().zip(&self.reference_places) {
            *value = self.sample[*place];
            valid &= header.is_valid(*place);
        }
        self.converted
            .sample(&mut self.measured, &mut self.reference);
        let row = Row {
            time_s: job.rate.seconds(step),
            measured: &self.measured,
            reference: &self.reference,
            valid,
            held_steps: header.held_steps,
        };
        self.tuning.apply(step, self.law.as_mut());
        let (command, internals) = self.answer.split_at_mut(self.previous.len());
        self.law.step(&row, command, internals)?;
        self.converted.command(command);
        Ok(())
    }
}
