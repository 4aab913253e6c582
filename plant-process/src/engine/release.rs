//! Between two steps: saving, waiting for the clock, and sending the next sample.

use hil_config::plan::{Clock, Waveform};
use hil_session::clock::monotonic_ns;
use shared_types::describe::Invalid;
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::Control;
use shared_types::link::{Link, LinkError};
use shared_types::lockstep::{AbortCode, PlantAction, PlantEvent};
use shared_types::pacer::Pacer;
use shared_types::record::Outcome;
use shared_types::state::State;
use shared_types::stream::RecordSink;
use shared_types::time::Step;

use super::{Engine, Plant, Progress};
use crate::checkpoint::SavedPlant;
use crate::stimulus;

/// Last sample sent, and the wait for its command.
pub(super) struct SentSample {
    pub age_steps: u32,
    /// [`Directive`](shared_types::directive::Directive) for the controller's runner, as sent.
    pub directive: u64,
    pub sent_ns: u64,
    /// Delay in sending the sample.
    pub late_ns: u64,
    /// Time until which the command is awaited; unlimited except in real time.
    pub deadline_ns: u64,
}

impl Default for SentSample {
    fn default() -> Self {
        Self {
            age_steps: 0,
            directive: 0,
            sent_ns: 0,
            late_ns: 0,
            deadline_ns: u64::MAX,
        }
    }
}

impl SentSample {
    /// Records when the sample is sent and was due; 0 if it had no due time.
    const fn is_sent(&mut self, now_ns: u64, due_ns: u64) {
        self.sent_ns = now_ns;
        self.late_ns = match due_ns {
            0 => 0,
            _ => now_ns - due_ns,
        };
    }
}

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// Waits for the clock, then sends the sample of the next step.
    pub(super) fn release(&mut self, step: Step) -> Result<Progress, LinkError> {
        if self.saves.are_due(step) {
            if !self.tell()? {
                return Ok(Progress::Recorder);
            }
            if let Err(reason) = self.save(step) {
                let reason = format!("no checkpoint before step {step}: {reason}");
                self.give_up(Outcome::Failed, AbortCode::Other, reason)?;
                return Ok(Progress::Over);
            }
        }
        if !self.queue.is_open_for(step) && self.attend(step)? {
            return Ok(Progress::Held);
        }
        if !self.publisher.sink.has_room()? {
            return Ok(Progress::Recorder);
        }
        let run = self.job.run;
        let mut release_ns = 0;
        if let Some(factor) = self.pace() {
            let now_ns = monotonic_ns();
            let first = self.first;
            let start = || {
                let mut pacer = Pacer::paced(run.rate, now_ns, factor, run.overrun);
                pacer.anchor(first, now_ns);
                pacer
            };
            let released = (self.pacer.get_or_insert_with(start)).release_ns(step, now_ns);
            release_ns = match released {
                Ok(release_ns) => release_ns,
                Err(overrun) => return self.overran(overrun.to_string()),
            };
            if release_ns > now_ns {
                self.tell()?; // an observer should not have to wait for the next step
                return Ok(Progress::Until(release_ns));
            }
        }
        match self.side.on(&PlantEvent::Release) {
            PlantAction::SendSample(step) => {
                if !self.measure(step)? {
                    return Ok(Progress::Over);
                }
                let (mut directive, busy_ns) = self.plant.faults.timing(step);
                if let Some(repetition) = &mut self.commands.repetition {
                    directive.unseen = !repetition.is_seen(step);
                }
                self.sample.directive = directive.to_wire();
                let header = self.sample_header(step);
                if busy_ns > 0 {
                    self.plant.faults.plant_was_busy(spin(busy_ns));
                }
                self.sample.deadline_ns = self.deadline_of(step);
                self.sample.is_sent(monotonic_ns(), release_ns);
                self.link.send(&header, &self.rows.sample)?;
                // While the controller works: publishing, and work that needs no command.
                self.tell()?;
                self.prepare(step.next());
            }
            PlantAction::SendEnd(step) => {
                if !self.measure(step)? {
                    return Ok(Progress::Over);
                }
                self.ending = Some(step);
                self.sample.deadline_ns = u64::MAX;
            }
            _ => {}
        }
        Ok(Progress::Busy)
    }

    /// Saves the state before any work on a step; every earlier record has been published.
    fn save(&mut self, step: Step) -> Result<(), String> {
        let saved = self.saved_plant().map_err(|e| e.to_string())?;
        self.saves.write(step, &saved)
    }

    /// Returns the state of a run that is held before a step.
    ///
    /// # Errors
    /// If the plant or a fault cannot save its state.
    pub fn state(&mut self) -> Result<State, Invalid> {
        State::of(&self.saved_plant()?)
    }

    fn saved_plant(&mut self) -> Result<SavedPlant, Invalid> {
        let Plant {
            model,
            instruments,
            faults,
            tuning,
            ..
        } = &mut self.plant;
        Ok(SavedPlant {
            model: model.save()?,
            instruments: {
                let mut states = instruments.save()?;
                states.extend(faults.save_bus()?);
                states
            },
            faults: faults.save()?,
            tuning: tuning.save(),
            record: self.rows.record.clone(),
        })
    }

    pub(super) fn sample_header(&self, step: Step) -> Header {
        Header {
            time_ns: self.job.run.rate.nanoseconds(step),
            work_ns: self.timing.plant_ns,
            directive: self.sample.directive,
            age_steps: self.sample.age_steps,
            surroundings: self.timing.plant_surroundings,
            tuning: self.plant.tuning.number(),
            held_steps: self.commands.newest.held_steps,
            invalid: *self.rows.invalid.words(),
            ..Header::new(FrameKind::Sample, step)
        }
    }

    /// Returns the deadline of a step's command. The first command has no deadline, because the clock has not started.
    fn deadline_of(&self, step: Step) -> u64 {
        match (&self.pacer, self.job.run.clock) {
            (Some(pacer), Clock::Realtime) if step > self.first => {
                pacer.deadline_ns(step, self.job.run.deadline)
            }
            _ => u64::MAX,
        }
    }

    /// Computes the reference signals and driven inputs of a step, which depend on time alone.
    pub(super) fn prepare(&mut self, step: Step) {
        let time_s = self.job.run.rate.seconds(step);
        let references = self.plant.reference.len();
        let (mut reference, inputs) = self.rows.stimulus.split_at_mut(references);
        let mut inputs = inputs.iter_mut();
        for stimulus in &self.job.stimuli {
            let count = 1 + stimulus.waveform.derivatives();
            if stimulus.input().is_some() {
                // The model needs no derivative.
                let mut row = [0.0; 1 + Waveform::MOST_DERIVATIVES];
                stimulus::evaluate(&stimulus.waveform, time_s, &mut row[..count]);
                if let Some(value) = inputs.next() {
                    *value = row[0];
                }
                continue;
            }
            let (row, rest) = reference.split_at_mut(count);
            stimulus::evaluate(&stimulus.waveform, time_s, row);
            reference = rest;
        }
        self.rows.stimulus_of = Some(step);
    }

    /// Applies the value changes of a step, and sends those of the law to the controller before the sample that they
    /// apply to.
    fn tune(&mut self, step: Step) -> Result<(), LinkError> {
        let Plant { tuning, faults, .. } = &mut self.plant;
        let moves_law = tuning.advance(step, &self.rows.stimulus);
        for (index, value) in tuning.bases(step) {
            faults.rebase(index, value);
        }
        if moves_law {
            self.tell_law()?;
        }
        Ok(())
    }

    /// Sends all changed law parameters to the active controller.
    pub(super) fn tell_law(&mut self) -> Result<(), LinkError> {
        if self.side.is_alone() {
            return Ok(()); // the next one is told when it takes over
        }
        let tuned = Control::Tuned(self.plant.tuning.tuned());
        self.link.tell(&tuned.to_bytes())
    }

    /// Fills the sample of a step; returns `false` if the plant diverged or failed.
    fn measure(&mut self, step: Step) -> Result<bool, LinkError> {
        if self.rows.stimulus_of != Some(step) {
            self.prepare(step);
        }
        if self.plant.tuning.is_due(step) {
            self.tune(step)?;
        }
        let (plant, rows) = (&mut self.plant, &mut self.rows);
        if plant.faults.advance(step, rows.last_values(step)) {
            if let Err(failure) = plant.model.retune(plant.faults.parameters()) {
                self.failed(step, &failure)?;
                return Ok(false);
            }
            plant.faults.faultable(&mut rows.parameter);
        }
        rows.invalid.clear();
        if let Err(failure) = plant.model.read(&mut rows.sensed, &mut rows.invalid) {
            self.failed(step, &failure)?;
            return Ok(false);
        }
        if rows.invalid.any() {
            rows.hold_readings();
        }
        let guard = &plant.guards.measured;
        if let Err(bad) = guard.check_valid(&rows.sensed, &rows.invalid) {
            self.diverged(step, &format!("measured {bad}"))?;
            return Ok(false);
        }
        let instruments = &mut plant.instruments;
        if let Err(bad) =
            instruments.sense(step, &mut rows.sensed, &mut rows.sensor, &mut rows.invalid)
        {
            self.diverged(step, &bad)?;
            return Ok(false);
        }
        rows.sent_stimulus.copy_from_slice(&rows.stimulus);
        plant.tuning.overrule(step, &mut rows.sent_stimulus);
        let (reference, inputs) = rows.sent_stimulus.split_at(plant.reference.len());
        plant.faults.input(step, inputs, &mut rows.input);
        if let Err(bad) = plant.inputs.guard.check(&rows.input) {
            self.diverged(step, &format!("input {bad}"))?;
            return Ok(false);
        }
        self.sample.age_steps = plant.faults.sample(
            step,
            (&rows.sensed, reference),
            &mut rows.sample,
            rows.invalid.words_mut(),
        );
        Ok(true)
    }
}

/// Spins for this time; returns the actual duration.
fn spin(busy_ns: u64) -> u64 {
    let since_ns = monotonic_ns();
    loop {
        let spun_ns = monotonic_ns() - since_ns;
        if spun_ns >= busy_ns {
            return spun_ns;
        }
        std::hint::spin_loop();
    }
}
