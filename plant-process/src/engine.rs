//! The engine: the plant's main loop.
//!
//! It joins a model, its stimuli and faults with the plant's side of the lockstep protocol. It never
//! blocks: [`Engine::poll`] does what can be done now and says what it waits for, so that one driver
//! can wait in a process of its own and another can run both sides in one thread.

use std::sync::Arc;

use hil_config::plan::Clock;
use shared_types::checkpoint::{Saves, Side};
use shared_types::clock::monotonic_ns;
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::Control;
use shared_types::link::{Link, LinkError};
use shared_types::lockstep::{AbortCode, PlantAction, PlantEvent, PlantSide};
use shared_types::pacer::{Pacer, Streaks};
use shared_types::record::{Outcome, RunEnd, Timing};
use shared_types::stream::RecordSink;
use shared_types::surroundings::Lookout;
use shared_types::table::Field;
use shared_types::time::Step;

use crate::checkpoint::SavedPlant;
use crate::desk::Desk;
use crate::faults::{FaultKindEntry, FaultLayer, FaultWorkshop};
use crate::guard::Guard;
use crate::job::Job;
use crate::plant::{Model, PlantKind};
use crate::repeat::Repetition;
use crate::rows::Rows;
use succession::Agreed;
use watch::Watch;

/// A step that no run reaches.
const NEVER: Step = Step(u64::MAX);

/// What the engine waits for, if it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// It did something that got the run on; poll again, and any wait begins anew.
    Busy,
    /// The controller's next message or frame.
    Controller,
    /// The same, but no longer than until this time of the monotonic clock, in ns.
    ControllerUntil(u64),
    /// This time of the monotonic clock, in ns.
    Until(u64),
    /// The recorder, which must not lose a record.
    Recorder,
    /// Somebody who resumes the run.
    Held,
    /// Nothing; the run is over.
    Over,
}

/// One run of one plant.
pub struct Engine<L, S> {
    link: L,
    sink: S,
    side: PlantSide,
    plant: Plant,
    job: Job,
    pacer: Option<Pacer>,
    desk: Arc<Desk>,
    /// When the controller was told last that the run is held; `None` while it is not.
    told_held_ns: Option<u64>,
    /// Since when the run is held.
    held_since_ns: u64,
    rows: Rows,
    /// The step whose reference signals are made already.
    prepared: Option<Step>,
    /// The last record, if it was not published yet.
    pending: bool,
    /// The last step was measured and the final record is to be written.
    ending: Option<Step>,
    timing: Timing,
    sample_age_steps: u32,
    /// What the controller's runner was told with the sample.
    directive: u64,
    lookout: Lookout,
    sent_ns: u64,
    /// How much later than due the sample was sent.
    late_ns: u64,
    /// Until when the command is awaited; for ever except against the clock.
    deadline_ns: u64,
    /// The newest command, whose values are in the rows, and how it came.
    newest: Command,
    /// When a command came last.
    heard_ns: u64,
    missed: Streaks,
    watch: Watch,
    /// What is repeated, if a run against the clock is.
    repetition: Option<Repetition>,
    /// The first step that is exchanged.
    first: Step,
    saves: Saves,
    /// What the run goes on from, until hello.
    saved: Option<SavedPlant>,
    executed: u64,
    /// A control message that waits until it is known who may speak for the controller.
    heard: Option<Control>,
    /// What was agreed with a controller that is not in office yet.
    agreed: Option<Agreed>,
    /// The epoch of the controller that was announced last, and since when it is awaited.
    expected: u32,
    expected_ns: u64,
    end: Option<RunEnd>,
}

/// A command that a step meets.
#[derive(Clone, Copy)]
struct Command {
    header: Header,
    /// How many steps before this one it was sent.
    held_steps: u32,
    /// From sending its sample, or when that was due, to having it; 0 if none came at this step.
    /// Of a late command and the one after it, those of the late one.
    round_trip_ns: u64,
    /// The controller's work on it; 0 likewise.
    work_ns: u64,
}

impl Default for Command {
    fn default() -> Self {
        Self {
            header: Header::new(FrameKind::Command, Step(0)),
            held_steps: 0,
            round_trip_ns: 0,
            work_ns: 0,
        }
    }
}

/// The plant with everything around it that is stepped with it.
struct Plant {
    description: PlantDescription,
    reference: Vec<Field>,
    model: Box<dyn Model>,
    workshop: Arc<FaultWorkshop>,
    faults: FaultLayer,
    guard: Guard,
}

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// A plant at its first step that waits for hello, with the kinds of faults that it may have.
    ///
    /// # Errors
    /// If the job does not fit the plant, or the state that it is to go on from does not.
    pub fn new(
        kind: &PlantKind,
        faults: &[FaultKindEntry],
        job: Job,
        link: L,
        sink: S,
    ) -> Result<Self, Invalid> {
        let description = kind.description.clone();
        let parameters = &job.plant.parameters;
        let reference: Vec<Field> = (job.stimuli.iter())
            .flat_map(|stimulus| stimulus.fields())
            .collect();
        let workshop = FaultWorkshop::new(
            &description,
            &reference,
            faults,
            parameters,
            (job.run.rate, job.run.seed),
            &job.derived,
        )?;
        let mut model = (kind.start)(parameters)?;
        let checkpoints = &job.checkpoints;
        let (first, name) = (checkpoints.first_step(), description.name.clone());
        if job.run.clock == Clock::Realtime && checkpoints.any() {
            return Err(Invalid(
                "against the clock a state depends on what came too late: it cannot be saved or gone on from".into(),
            ));
        }
        let saved: Option<SavedPlant> = match &checkpoints.resume {
            Some(resume) => Some(resume.read(&name)?),
            None => None,
        };
        if let Some(saved) = &saved {
            // First: a model takes whatever parameters it is given.
            FaultLayer::check(&workshop, &job.faults, &saved.faults)?;
            saved.restore_model(model.as_mut())?;
        }
        let plant = Plant {
            model,
            guard: Guard::new(&description.truth, &job.plant.limits)?,
            faults: FaultLayer::new(&workshop, &job.faults)?,
            workshop: Arc::new(workshop),
            reference,
            description,
        };
        let hold_at = (job.pause_at_s).map_or(NEVER, |at_s| job.run.rate.step_at_or_after(at_s));
        Ok(Self {
            link,
            sink,
            side: match job.run.clock {
                Clock::Realtime => PlantSide::new(job.run.steps).against_clock(),
                Clock::Lockstep | Clock::Paced { .. } => PlantSide::new(job.run.steps),
            }
            .beginning_at(first)
            .on_loss(job.run.on_controller_loss),
            plant,
            pacer: None,
            desk: Arc::new(Desk::new(hold_at)),
            told_held_ns: None,
            held_since_ns: 0,
            rows: Rows::default(),
            prepared: None,
            pending: false,
            ending: None,
            timing: Timing::default(),
            sample_age_steps: 0,
            directive: 0,
            lookout: Lookout::default(),
            sent_ns: 0,
            late_ns: 0,
            deadline_ns: u64::MAX,
            newest: Command::default(),
            heard_ns: 0,
            missed: Streaks::default(),
            watch: Watch::default(),
            repetition: None,
            first,
            saves: Saves::new(Side::Plant, &name, job.checkpoints.clone()),
            saved,
            executed: first.0,
            heard: None,
            agreed: None,
            expected: 1,
            expected_ns: 0,
            end: None,
            job,
        })
    }

    /// Does what can be done now. The whole run is this function, called again and again.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn poll(&mut self) -> Result<Progress, LinkError> {
        let progress = self.proceed()?;
        if progress == Progress::Recorder && self.recorder_is_stuck(monotonic_ns())? {
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

    /// What the wait limit, a death or a request to stop means now; true if another wait begins.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn interrupt(&mut self, event: &PlantEvent<'_>) -> Result<bool, LinkError> {
        let before = self.side.standing();
        let action = self.side.on(event);
        self.react(&action)?;
        Ok(self.side.standing() != before)
    }

    /// What an answer of the protocol means that any event may bring about.
    fn react(&mut self, action: &PlantAction) -> Result<(), LinkError> {
        match action {
            PlantAction::Abort(abort) => self.abort(abort),
            PlantAction::Lose(why) => self.lose(why),
            PlantAction::Dismiss(why) => self.dismiss(why),
            _ => Ok(()),
        }
    }

    /// The recorder took no record within the wait limit.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn recorder_late(&mut self) -> Result<(), LinkError> {
        let reason = "the recorder took no record within the wait limit";
        self.give_up(Outcome::Failed, AbortCode::Observer, reason.into())
    }

    /// Where requests to this run are put.
    #[must_use]
    pub fn desk(&self) -> Arc<Desk> {
        Arc::clone(&self.desk)
    }

    /// Where faults for this run are prepared.
    #[must_use]
    pub fn workshop(&self) -> Arc<FaultWorkshop> {
        Arc::clone(&self.plant.workshop)
    }

    /// How the run ended; `None` until then.
    #[must_use]
    pub const fn end(&self) -> Option<&RunEnd> {
        self.end.as_ref()
    }

    /// Simulated seconds per second of the clock; `None` in lockstep.
    const fn pace(&self) -> Option<f64> {
        match self.job.run.clock {
            Clock::Lockstep => None,
            Clock::Paced { factor } => Some(factor),
            Clock::Realtime => Some(1.0),
        }
    }

    /// Publishes what observers await: the record of the step before, then which faults took hold
    /// or ended at this step. False if the recorder has no room for all of it now.
    fn tell(&mut self) -> Result<bool, LinkError> {
        if self.pending {
            if !self.sink.has_room()? {
                return Ok(false);
            }
            self.sink.record(&self.rows.record)?;
            self.pending = false;
        }
        while self.plant.faults.has_events() {
            if !self.sink.has_room()? {
                return Ok(false);
            }
            if let Some(event) = self.plant.faults.next_event() {
                self.sink.event(&event)?;
            }
        }
        Ok(true)
    }
}

mod ending;
mod exchange;
mod greeting;
mod orders;
mod release;
mod succession;
mod watch;

#[cfg(test)]
mod chatter;
#[cfg(test)]
mod tests;
