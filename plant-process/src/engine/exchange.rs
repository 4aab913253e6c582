//! Exchange of a step after its sample was sent: the command, punctual or late, the record, and the integration.

use hil_session::clock::monotonic_ns;
use shared_types::frame::{FrameKind, Header};
use shared_types::link::{Link, LinkError};
use shared_types::lockstep::{AbortCode, PlantAction, PlantEvent};
use shared_types::pacer::OverrunPolicy;
use shared_types::record::{Outcome, RunEnd, Timing};
use shared_types::stream::RecordSink;
use shared_types::time::{Interval, Step};

use super::commands::Met;
use super::{Engine, Progress};

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// Takes the command that answers the sample and integrates to the next step.
    pub(super) fn collect(&mut self) -> Result<Progress, LinkError> {
        if !self.tell()? {
            return Ok(Progress::Recorder);
        }
        if let Some(step) = self.ending.take() {
            self.record_final_truth(step)?;
            if self.side.is_over() {
                return Ok(Progress::Over);
            }
            self.link.send(&Header::new(FrameKind::End, step), &[])?;
            return Ok(Progress::Busy);
        }
        if self.side.is_alone() {
            return self.go_on_alone();
        }
        if let Some(mut header) = self.link.receive(self.rows.receiver())?
            && self.hears(&mut header)?
        {
            return Ok(Progress::Busy);
        }
        match self.sample.deadline_ns {
            u64::MAX => Ok(Progress::Controller),
            deadline_ns if monotonic_ns() < deadline_ns => {
                Ok(Progress::ControllerUntil(deadline_ns))
            }
            _ => self.miss(),
        }
    }

    /// Processes a frame of the controller; returns `false` if the run does not advance, so that the wait continues.
    fn hears(&mut self, header: &mut Header) -> Result<bool, LinkError> {
        let before = self.side.standing();
        match self.side.on(&PlantEvent::Frame(header)) {
            PlantAction::Apply(step) => {
                self.rows.take_frame(header);
                self.take(step, header)?;
            }
            PlantAction::Keep => {
                self.rows.take_frame(header);
                self.keep(header);
            }
            PlantAction::Finish => self.finish(Outcome::Completed, None)?,
            PlantAction::Ignore(_) if self.contradicts(header) => {
                self.interrupt(&PlantEvent::Contradiction(Step(header.step)))?;
            }
            action => self.react(&action)?,
        }
        Ok(self.side.standing() != before)
    }

    /// Returns `true` if an ignored command contradicts the latest command, which belongs to the same step. The latest
    /// command may have another origin, as in a repeated run or after a loss.
    fn contradicts(&self, header: &Header) -> bool {
        let newest = &self.commands.newest.header;
        header.kind() == Some(FrameKind::Command)
            && (header.epoch, header.step) == (newest.epoch, newest.step)
            && self.commands.repetition.is_none()
            && self.rows.differs(header, newest)
    }

    /// Takes the command that answers a step, or reproduces its fate in the repeated run.
    fn take(&mut self, step: Step, header: &Header) -> Result<(), LinkError> {
        let received_ns = monotonic_ns();
        if step == self.first
            && let Some(pacer) = &mut self.pacer
        {
            // Time starts with the controller's first answer.
            pacer.anchor(step, received_ns);
        }
        let round_trip_ns = received_ns - self.sample.sent_ns;
        (self.commands).came(header, received_ns, round_trip_ns);
        if let Some(repetition) = &mut self.commands.repetition {
            match repetition.exchange(step, *header, &mut self.rows.frame) {
                Ok(header) => self.commands.newest.header = header,
                Err(reason) => return self.give_up(Outcome::Failed, AbortCode::Other, reason),
            }
        }
        self.meet(step, received_ns)
    }

    /// Stores a command that arrived too late for its own step.
    fn keep(&mut self, header: &Header) {
        let received_ns = monotonic_ns();
        let due_ns = (self.pacer).map_or(0, |pacer| pacer.due_ns(Step(header.step)));
        let round_trip_ns = received_ns.saturating_sub(due_ns);
        (self.commands).came(header, received_ns, round_trip_ns);
    }

    /// Uses the latest available command for a step whose own command missed its deadline.
    fn miss(&mut self) -> Result<Progress, LinkError> {
        let now_ns = monotonic_ns();
        let limit = self.wait_limit();
        if self.commands.are_silent(now_ns, limit) {
            self.interrupt(&PlantEvent::Deadline(limit.ms()))?;
            return Ok(Progress::Busy);
        }
        let PlantAction::Hold(step) = self.side.on(&PlantEvent::Missed) else {
            return Ok(Progress::Controller);
        };
        if self.job.run.overrun == OverrunPolicy::Abort {
            self.commands.missed.note(step);
            let late = format!(
                "controller did not answer step {step} by its deadline, and the overrun policy is `abort`"
            );
            return self.overran(late);
        }
        self.meet(step, now_ns)?;
        Ok(Progress::Busy)
    }

    pub(super) fn overran(&mut self, reason: String) -> Result<Progress, LinkError> {
        self.give_up(Outcome::Failed, AbortCode::Overrun, reason)?;
        Ok(Progress::Over)
    }

    /// Applies the latest command to a step and integrates to the next step.
    pub(super) fn meet(&mut self, step: Step, received_ns: u64) -> Result<(), LinkError> {
        if self.publisher.is_stuck(received_ns)? {
            return self.recorder_late();
        }
        let meeting = self.commands.meet(step, self.side.is_alone());
        let header = &self.commands.newest.header;
        let (rows, plant) = (&mut self.rows, &mut self.plant);
        rows.take_command(header);
        let guard = &plant.guards.command;
        if let Err(bad) = guard.check_valid(&rows.command, &rows.command_invalid) {
            let reason = format!("{}{}: {bad}", RunEnd::INVALID_COMMAND, header.step);
            return self.give_up(Outcome::Failed, AbortCode::NotANumber, reason);
        }
        let command = (&rows.command[..], rows.command_invalid.words_mut());
        let age_steps = (plant.faults).command(
            step,
            (meeting.age_steps, meeting.work_ns),
            command,
            &mut rows.applied,
        );
        (plant.probes).cut(step, &mut rows.applied, &mut rows.cut);
        if let Err(bad) = plant
            .instruments
            .actuate(step, &mut rows.applied, &mut rows.actuator)
        {
            return self.diverged(step, &bad);
        }

        plant.inputs.join(&rows.applied, &rows.input);

        let rate = self.job.run.rate;
        let time_s = rate.seconds(step);
        let command = plant.inputs.joined(&rows.applied);
        let result = (plant.model).truth(time_s, command, &mut rows.truth);
        if let Err(failure) = result {
            return self.failed(step, &failure);
        }
        if let Err(bad) = plant.guards.truth.check(&rows.truth) {
            if rows.truth.iter().all(|value| value.is_finite()) {
                self.note_record(step, &meeting, age_steps, received_ns);
            }
            return self.diverged(step, &bad.to_string());
        }
        self.note_record(step, &meeting, age_steps, received_ns);

        let interval = Interval {
            start_s: time_s,
            length_s: rate.period_s(),
            substeps: self.job.plant.substeps,
        };
        let command = self.plant.inputs.joined(&self.rows.applied);
        if let Err(failure) = (self.plant.model).advance(&interval, command) {
            return self.failed(step, &failure);
        }
        self.executed += 1;
        self.timing.plant_ns = monotonic_ns() - received_ns;
        Ok(())
    }

    /// Writes the record of a step, which is published while the controller works on the next step.
    fn note_record(&mut self, step: Step, meeting: &Met, age_steps: u32, received_ns: u64) {
        let header = &self.commands.newest.header;
        let took_ns = received_ns - self.sample.sent_ns + self.timing.plant_ns;
        self.timing = Timing {
            time_ns: self.job.run.rate.nanoseconds(step),
            epoch: u64::from(header.epoch),
            sample_age_steps: u64::from(self.sample.age_steps),
            command_age_steps: u64::from(age_steps),
            published_ns: received_ns,
            round_trip_ns: meeting.round_trip_ns,
            controller_ns: meeting.work_ns,
            plant_ns: self.timing.plant_ns,
            late_ns: self.sample.late_ns,
            held_steps: u64::from(meeting.held_steps),
            answered: header.directive,
            plant_surroundings: self.sampler.after(took_ns),
            controller_surroundings: header.surroundings,
            directive: self.sample.directive,
        };
        self.rows.write_record(step, header, &self.timing);
        self.publisher.note();
    }

    /// Writes record N: the truth after the last step, without a command.
    fn record_final_truth(&mut self, step: Step) -> Result<(), LinkError> {
        let time_s = self.job.run.rate.seconds(step);
        let (rows, plant) = (&mut self.rows, &mut self.plant);
        plant.inputs.join(&rows.applied, &rows.input);
        let command = plant.inputs.joined(&rows.applied);
        let result = (plant.model).truth(time_s, command, &mut rows.truth);
        if let Err(failure) = result {
            return self.failed(step, &failure);
        }
        if let Err(bad) = self.plant.guards.truth.check(&rows.truth) {
            return self.diverged(step, &bad.to_string());
        }
        self.timing = Timing {
            time_ns: self.job.run.rate.nanoseconds(step),
            epoch: u64::from(self.side.epoch()),
            published_ns: monotonic_ns(),
            plant_ns: self.timing.plant_ns,
            ..Timing::default()
        };
        self.rows.write_final_record(step, &self.timing);
        self.publisher.note();
        Ok(())
    }
}
