//! End of a run: complete, diverged or aborted, and its report.

use hil_config::plan::PLANT_KEYS;
use shared_types::failure::Failure;
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::Control;
use shared_types::link::{Link, LinkError};
use shared_types::lockstep::{Abort, AbortCode, PlantEvent};
use shared_types::record::{Event, Outcome, RunEnd};
use shared_types::stream::RecordSink;
use shared_types::text;
use shared_types::time::Step;

use super::{Engine, Plant};

impl<L: Link, S: RecordSink> Engine<L, S> {
    pub(super) fn diverged(&mut self, step: Step, what: &str) -> Result<(), LinkError> {
        let time_s = self.job.run.rate.seconds(step);
        let reason = format!("plant diverged at step {step} ({time_s} s): {what}");
        self.give_up(Outcome::Diverged, AbortCode::Diverged, reason)
    }

    /// Ends the run with the plant's reason.
    pub(super) fn failed(&mut self, step: Step, failure: &Failure) -> Result<(), LinkError> {
        let cause = text::line(&failure.to_string());
        if failure.is_divergence() {
            return self.diverged(step, &cause);
        }
        let time_s = self.job.run.rate.seconds(step);
        let reason = format!("plant failed at step {step} ({time_s} s): {cause}");
        self.give_up(Outcome::Failed, AbortCode::Other, reason)
    }

    pub(super) fn abort(&mut self, abort: &Abort) -> Result<(), LinkError> {
        let outcome = match abort {
            Abort::Stopped { .. } => Outcome::Stopped,
            _ => Outcome::Failed,
        };
        self.give_up(outcome, abort.code(), abort.to_string())
    }

    /// Informs the controller, publishes pending records and ends the run.
    pub(super) fn give_up(
        &mut self,
        outcome: Outcome,
        code: AbortCode,
        reason: String,
    ) -> Result<(), LinkError> {
        let header = Header {
            directive: code as u64,
            ..Header::new(FrameKind::Abort, self.side.at())
        };
        match self.link.send(&header, &[]) {
            // Only the control channel exists before the frames are open.
            Err(LinkError::NotOpen) => {
                let refusal = Control::Refusal {
                    reason: reason.clone(),
                };
                self.link.send_message(refusal)?;
            }
            other => other?,
        }
        self.finish(outcome, Some(reason))
    }

    pub(super) fn finish(
        &mut self,
        outcome: Outcome,
        reason: Option<String>,
    ) -> Result<(), LinkError> {
        self.queue.close();
        self.side.on(&PlantEvent::Stop); // whatever it was in, it is over now
        // Regardless of room: no later item could be lost.
        let published = self.publisher.flush(&self.rows.record);
        let rejected = self.link.rejected();
        let end = RunEnd {
            steps: self.executed,
            outcome,
            reason,
            rejected_frames: rejected.total() + self.plant.faults.rejected(),
            ignored: Box::new(self.side.ignored() + rejected),
            effects: self.plant.faults.effects(),
            overruns: (self.pacer)
                .map(|pacer| pacer.overruns())
                .unwrap_or_default(),
            missed_commands: self.commands.missed,
            unconfirmed: self.plant.unconfirmed(),
            bus: self.plant.faults.bus_counts(),
        };
        self.end = Some(end.clone());
        published?;
        match self.publisher.sink.event(&Event::End(end)) {
            Err(LinkError::NotOpen) => Ok(()), // nobody records a run that never began
            other => other,
        }
    }
}

impl Plant {
    /// Returns the keys of changed or faulted parameters that cannot be read back.
    fn unconfirmed(&self) -> Vec<String> {
        let unreadable = self.model.unreadable();
        let mut keys = self.tuning.unconfirmed(&unreadable);
        let effects = self.faults.effects();
        let faulted = effects.iter().filter(|effect| effect.step.is_some());
        let names = faulted.filter_map(|effect| effect.target.strip_prefix("parameter."));
        let names = names.filter(|name| unreadable.iter().any(|one| one == name));
        keys.extend(names.map(|name| format!("{PLANT_KEYS}{name}")));
        keys.into_iter().collect()
    }
}
