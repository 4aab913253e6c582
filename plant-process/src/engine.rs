//! The engine: the plant's main loop.
//!
//! Joins a model, its stimuli and faults with the plant's side of the lockstep protocol. The engine never blocks:
//! [`Engine::poll`] does everything that is possible now and returns the awaited event, so that one driver can wait in
//! a separate process and another can run both sides in one thread.

use std::sync::Arc;

use hil_config::plan::{Clock, PLANT_KEYS, driven, settings_after};
use hil_session::clock::monotonic_ns;
use hil_session::thread::ThreadSampler;
use shared_types::checkpoint::Saves;
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::link::{Link, LinkError};
use shared_types::lockstep::{AbortCode, PlantAction, PlantEvent, PlantSide};
use shared_types::pacer::Pacer;
use shared_types::record::{MOST_MARKS, Outcome, RunEnd, Timing};
use shared_types::side::Side;
use shared_types::stream::RecordSink;
use shared_types::table::Field;
use shared_types::time::Step;
use shared_types::wait::{Sleeper, WaitLimit};

use crate::checkpoint::SavedPlant;
use crate::faults::{Bus, FaultBuilder, FaultKindEntry, FaultLayer};
use crate::guard::Guards;
use crate::inputs::InputRow;
use crate::instruments::Instruments;
use crate::job::Job;
use crate::plant::{Model, PlantKind};
use crate::probe::Probes;
use crate::request_queue::RequestQueue;
use crate::rows::Rows;
use crate::tuning::Tuning;
use commands::Commands;
use handover::Handover;
use publisher::Publisher;
use release::SentSample;
use requests::Held;

/// Step beyond the end of any run.
const NEVER: Step = Step(u64::MAX);

/// Result of a poll: progress, the awaited event, or the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Progress was made; poll again and restart any wait.
    Busy,
    /// Awaiting the controller's next message or frame.
    Controller,
    /// Like [`Controller`](Self::Controller), but only until this time of the monotonic clock, in ns.
    ControllerUntil(u64),
    /// Awaiting this time of the monotonic clock, in ns.
    Until(u64),
    /// Awaiting the recorder, which must not lose a record.
    Recorder,
    /// Paused until a request resumes the run.
    Held,
    /// The run is over.
    Over,
}

/// Run of a plant.
pub struct Engine<L, S> {
    link: L,
    publisher: Publisher<S>,
    side: PlantSide,
    plant: Plant,
    job: Job,
    pacer: Option<Pacer>,
    queue: Arc<RequestQueue>,
    held: Option<Held>,
    /// `true` if messages go to the log of this process, not only into the recording.
    has_log: bool,
    /// Reason of a controller in this process that has failed.
    controller_failure: Option<String>,
    /// Number of marks set so far.
    marks: usize,
    rows: Rows,
    /// Number of steps of a finished run whose final record is still to be written.
    ending: Option<Step>,
    timing: Timing,
    sampler: ThreadSampler,
    sample: SentSample,
    commands: Commands,
    handover: Handover,
    /// First step that is exchanged.
    first: Step,
    executed: u64,
    saves: Saves,
    /// State to resume from, kept until hello.
    saved: Option<SavedPlant>,
    end: Option<RunEnd>,
}

/// The plant and everything that is stepped with it.
struct Plant {
    /// Description without the commands that the scenario drives.
    description: PlantDescription,
    reference: Vec<Field>,
    model: Box<dyn Model>,
    inputs: InputRow,
    instruments: Instruments,
    builder: Arc<FaultBuilder>,
    faults: FaultLayer,
    probes: Probes,
    tuning: Tuning,
    guards: Guards,
}

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// Creates a plant at its first step, before hello, with its available fault kinds.
    ///
    /// # Errors
    /// If the job or the state to resume from does not match the plant.
    pub fn new(
        kind: &PlantKind,
        faults: &[FaultKindEntry],
        job: Job,
        link: L,
        sink: S,
    ) -> Result<Self, Invalid> {
        let description = job.plant.commanded(&kind.description, &job.stimuli);
        let parameters = &job.plant.parameters;
        let reference: Vec<Field> = (job.stimuli.iter())
            .flat_map(|stimulus| stimulus.fields())
            .collect();
        let builder = FaultBuilder::new(
            &description,
            &reference,
            faults,
            parameters,
            (job.run.rate, job.run.seed),
            &job.derived,
        )?
        .with_inputs(driven(&job.stimuli))
        .with_networks(job.bus.as_ref().map_or(1, |bus| bus.networks));
        for changed in settings_after(&job.changes, PLANT_KEYS, parameters) {
            (kind.start)(&changed)?; // they must go together
        }
        let mut model = (kind.start)(parameters)?;
        model.check_period(job.run.rate.period_s())?;
        if !job.is_tuned {
            model.check_start()?;
        }
        let checkpoints = &job.checkpoints;
        let (first, name) = (checkpoints.first_step(), description.name.clone());
        if job.run.clock == Clock::Realtime && checkpoints.any() {
            return Err(Invalid(
                "in real time the state depends on late messages, so it can be neither saved nor resumed".into(),
            ));
        }
        let saved: Option<SavedPlant> = match &checkpoints.resume {
            Some(resume) => Some(resume.read(&name)?),
            None => None,
        };
        if let Some(saved) = &saved {
            // First, as a model accepts any parameters.
            FaultLayer::check(&builder, &job.faults, &saved.faults)?;
            saved.restore_model(model.as_mut())?;
        }
        let bus = (job.bus.as_ref())
            .map(|plan| Bus::new(plan, &description, &reference, job.run.rate))
            .transpose()?;
        let plant = Plant {
            model,
            inputs: InputRow::new(&kind.description, &job)?,
            guards: Guards::new(&description, &job.plant.limits)?,
            instruments: Instruments::new(&description, &job)?,
            faults: FaultLayer::new(&builder, &job.faults)?.with_bus(bus),
            probes: Probes::new(&description, &job.probes)?,
            tuning: Tuning::new(
                job.run.rate,
                &description.parameters,
                parameters,
                &job.stimuli,
                &job.changes,
                first,
            ),
            builder: Arc::new(builder),
            reference,
            description,
        };
        let hold_at = (job.pause_at_s).map_or(NEVER, |at_s| job.run.rate.step_at_or_after(at_s));
        Ok(Self {
            link,
            publisher: Publisher::new(sink, WaitLimit::from_seconds(job.wait_limit_s)),
            side: match job.run.clock {
                Clock::Realtime => PlantSide::new(job.run.steps).against_clock(),
                Clock::Lockstep | Clock::Paced { .. } => PlantSide::new(job.run.steps),
            }
            .beginning_at(first)
            .on_loss(job.run.on_controller_loss),
            plant,
            pacer: None,
            queue: Arc::new(RequestQueue::new(hold_at)),
            held: None,
            has_log: true,
            controller_failure: None,
            marks: 0,
            rows: Rows::default(),
            ending: None,
            timing: Timing::default(),
            sampler: ThreadSampler::default(),
            sample: SentSample::default(),
            commands: Commands::default(),
            handover: Handover::default(),
            first,
            executed: first.0,
            saves: Saves::new(Side::Plant, &name, job.checkpoints.clone()),
            saved,
            end: None,
            job,
        })
    }

    /// Does everything that is possible now. The whole run consists of repeated calls.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn poll(&mut self) -> Result<Progress, LinkError> {
        let progress = self.proceed()?;
        if progress == Progress::Recorder && self.publisher.is_stuck(monotonic_ns())? {
            self.recorder_late()?;
            return Ok(Progress::Over);
        }
        Ok(progress)
    }

    fn proceed(&mut self) -> Result<Progress, LinkError> {
        if self.side.is_over() {
            Ok(Progress::Over)
        } else if self.side.is_greeting() {
            self.greet()
        } else if self.side.candidate().is_some() && self.attend_candidate()? {
            Ok(Progress::Busy)
        } else if let Some(step) = self.side.unreleased() {
            self.release(step)
        } else {
            self.collect()
        }
    }

    /// Handles a timeout, a death or a request to stop; returns `true` if another wait begins.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn interrupt(&mut self, event: &PlantEvent<'_>) -> Result<bool, LinkError> {
        let before = self.side.standing();
        let action = self.side.on(event);
        self.react(&action)?;
        Ok(self.side.standing() != before)
    }

    /// Performs an action of the protocol that any event may cause.
    fn react(&mut self, action: &PlantAction) -> Result<(), LinkError> {
        match action {
            PlantAction::Abort(abort) => {
                let abort = self.with_reason(abort);
                self.abort(&abort)
            }
            PlantAction::Lose(why) => {
                let why = self.with_reason(why);
                self.lose(&why)
            }
            PlantAction::Dismiss(why) => self.dismiss(why),
            _ => Ok(()),
        }
    }

    /// Ends the run because the recorder took no record within the wait limit.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn recorder_late(&mut self) -> Result<(), LinkError> {
        let reason = "the recorder took no record within the wait limit";
        self.give_up(Outcome::Failed, AbortCode::Observer, reason.into())
    }

    /// Returns the sleeper for the loop's waits.
    pub fn sleeper(&self) -> Option<Box<dyn Sleeper>> {
        self.link.sleeper()
    }

    /// Returns the queue of requests to this run.
    #[must_use]
    pub fn queue(&self) -> Arc<RequestQueue> {
        Arc::clone(&self.queue)
    }

    /// Returns the fault builder of this run.
    #[must_use]
    pub fn builder(&self) -> Arc<FaultBuilder> {
        Arc::clone(&self.plant.builder)
    }

    /// Returns the end of the run; `None` until then.
    #[must_use]
    pub const fn end(&self) -> Option<&RunEnd> {
        self.end.as_ref()
    }

    /// Returns the simulated seconds per second of the clock; `None` in lockstep.
    const fn pace(&self) -> Option<f64> {
        match self.job.run.clock {
            Clock::Lockstep => None,
            Clock::Paced { factor } => Some(factor),
            Clock::Realtime => Some(1.0),
        }
    }

    /// Publishes the previous step's record, then changes of values, then the faults that began or ended at this step.
    /// Returns `false` if the recorder lacks room for all of these items now.
    fn tell(&mut self) -> Result<bool, LinkError> {
        if !self.publisher.publish(&self.rows.record)? {
            return Ok(false);
        }
        while self.plant.tuning.has_events() {
            if !self.publisher.sink.has_room()? {
                return Ok(false);
            }
            if let Some(event) = self.plant.tuning.next_event() {
                self.publisher.sink.event(&event)?;
            }
        }
        while self.plant.faults.has_events() {
            if !self.publisher.sink.has_room()? {
                return Ok(false);
            }
            if let Some(event) = self.plant.faults.next_event() {
                let is_mark = event.mark().is_some();
                if is_mark && self.marks >= MOST_MARKS {
                    continue;
                }
                self.marks += usize::from(is_mark);
                self.publisher.sink.event(&event)?;
            }
        }
        Ok(true)
    }

    fn wait_limit(&self) -> WaitLimit {
        WaitLimit::from_seconds(self.job.wait_limit_s)
    }
}

mod commands;
mod ending;
mod exchange;
mod greeting;
mod handover;
mod publisher;
mod release;
mod requests;

#[cfg(test)]
mod chatter;
#[cfg(test)]
mod tests;
