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
use shared_types::hello::{Control, Welcome};
use shared_types::layout::SignalKind;
use shared_types::link::{FrameSpec, Link, LinkError};
use shared_types::lockstep::{Abort, AbortCode, PlantAction, PlantEvent, PlantSide};
use shared_types::pacer::{OverrunPolicy, Pacer, Streaks};
use shared_types::record::{Event, FaultAccepted, Outcome, RecordLayout, RunEnd, Timing};
use shared_types::stream::RecordSink;
use shared_types::surroundings::Lookout;
use shared_types::table::Field;
use shared_types::time::{Interval, Step};
use shared_types::wait::WaitLimit;

use crate::checkpoint::SavedPlant;
use crate::desk::{Desk, Order};
use crate::faults::{FaultKindEntry, FaultLayer, FaultWorkshop};
use crate::guard::{Guard, first_bad};
use crate::job::Job;
use crate::plant::{Model, PlantKind};
use crate::repeat::Repetition;
use crate::rows::Rows;
use crate::stimulus;
use succession::Agreed;

/// A step that no run reaches.
const NEVER: Step = Step(u64::MAX);

/// What the engine waits for, if it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// It did something; poll again.
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

    /// What the wait limit, a death or a request to stop means now.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn interrupt(&mut self, event: &PlantEvent<'_>) -> Result<(), LinkError> {
        let action = self.side.on(event);
        self.react(&action)
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

    /// Before the first step: agree with a controller on what the frames carry.
    fn greet(&mut self) -> Result<Progress, LinkError> {
        let Some(message) = self.hear()? else {
            return Ok(Progress::Controller);
        };
        match self.told(&message, 1) {
            PlantAction::Welcome(welcome) => self.welcome(*welcome)?,
            PlantAction::Refuse(reason) => {
                let refusal = Control::Refusal {
                    reason: reason.clone(),
                };
                self.link.send_control(&refusal.to_bytes())?;
                self.finish(
                    Outcome::Failed,
                    Some(format!("refused the controller: {reason}")),
                )?;
            }
            action => self.react(&action)?,
        }
        Ok(Progress::Busy)
    }

    fn welcome(&mut self, welcome: Welcome) -> Result<(), LinkError> {
        let description = &self.plant.description;
        let layout = RecordLayout {
            truth: description.truth.clone(),
            measured: description.measured.clone(),
            reference: self.plant.reference.clone(),
            command: description.commands.clone(),
            internal: welcome.command.fields(SignalKind::Internal),
            command_signals: welcome.command.len(),
            parameter: (description.parameters.iter())
                .filter(|field| field.faultable)
                .cloned()
                .collect(),
        };
        self.link.open_frames(&FrameSpec {
            seal: welcome.seal(),
            outgoing: welcome.sample.len(),
            incoming: welcome.command.len(),
        })?;
        self.sink.open(&layout)?;
        self.desk.opened(&layout);
        let opened = self.plant.faults.open(&self.plant.workshop, &layout);
        self.rows = Rows::new(layout, &welcome);
        let opened = opened.and_then(|()| self.restore());
        let missed = std::mem::take(&mut self.job.missed);
        self.repetition =
            (!missed.is_empty()).then(|| Repetition::new(missed, welcome.command.len()));
        self.plant.faults.faultable(&mut self.rows.parameter);
        self.link
            .send_control(&Control::Welcome(Box::new(welcome)).to_bytes())?;
        match opened {
            Ok(()) => Ok(()),
            Err(invalid) => self.give_up(Outcome::Failed, AbortCode::Stopped, invalid.to_string()),
        }
    }

    /// Puts back what the run goes on from; the model has its state since the start.
    fn restore(&mut self) -> Result<(), Invalid> {
        let Some(saved) = self.saved.take() else {
            return Ok(());
        };
        self.plant.faults.restore(saved.faults)?;
        self.rows.restore_record(&saved.record)
    }

    /// Saves the state before a step, of which nothing was done yet; every record before it was
    /// published.
    fn save(&mut self, step: Step) -> Result<(), String> {
        let Plant { model, faults, .. } = &mut self.plant;
        let saved = model.save().and_then(|model| {
            Ok(SavedPlant {
                model,
                faults: faults.save()?,
                record: self.rows.record.clone(),
            })
        });
        self.saves.write(step, &saved.map_err(|e| e.to_string())?)
    }

    /// Between two steps: wait for the clock, then send the sample of the next one.
    fn release(&mut self, step: Step) -> Result<Progress, LinkError> {
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
        if !self.desk.is_open_for(step) && self.attend(step)? {
            return Ok(Progress::Held);
        }
        if !self.sink.has_room()? {
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
                if let Some(repetition) = &mut self.repetition {
                    directive.unseen = !repetition.is_seen(step);
                }
                self.directive = directive.to_wire();
                let header = self.sample_header(step);
                if busy_ns > 0 {
                    self.plant.faults.plant_was_busy(spin(busy_ns));
                }
                self.sent_ns = monotonic_ns();
                self.late_ns = match release_ns {
                    0 => 0,
                    _ => self.sent_ns - release_ns,
                };
                self.deadline_ns = self.deadline_of(step);
                self.link.send(&header, &self.rows.sample)?;
                // While the controller works: what observers need, and what needs no command.
                self.tell()?;
                self.prepare(step.next());
            }
            PlantAction::SendEnd(step) => {
                if !self.measure(step)? {
                    return Ok(Progress::Over);
                }
                self.ending = Some(step);
                self.deadline_ns = u64::MAX;
            }
            _ => {}
        }
        Ok(Progress::Busy)
    }

    fn sample_header(&self, step: Step) -> Header {
        Header {
            time_ns: self.job.run.rate.nanoseconds(step),
            work_ns: self.timing.plant_ns,
            directive: self.directive,
            age_steps: self.sample_age_steps,
            surroundings: self.timing.plant_surroundings,
            held_steps: self.newest.held_steps,
            invalid: self.rows.invalid,
            ..Header::new(FrameKind::Sample, step)
        }
    }

    /// Serves what waits at the desk before a step; true if the run is held there.
    fn attend(&mut self, step: Step) -> Result<bool, LinkError> {
        while self.sink.has_room()?
            && let Some(order) = self.desk.next_order()
        {
            self.serve(order, step)?;
        }
        if !self.desk.holds(step) {
            if self.told_held_ns.take().is_some() {
                let held_ns = monotonic_ns() - self.held_since_ns;
                self.heard_ns += held_ns;
                if let Some(pacer) = &mut self.pacer {
                    pacer.delay(held_ns);
                }
            }
            return Ok(false);
        }
        self.tell()?; // an observer should see all that happened
        let now_ns = monotonic_ns();
        let again_ns = self.hold_again_ns();
        let due = |told_ns: u64| now_ns - told_ns >= again_ns;
        if self.told_held_ns.is_none() {
            self.held_since_ns = now_ns;
        }
        if self.told_held_ns.is_none_or(due) {
            self.told_held_ns = Some(now_ns);
            self.link.send(&Header::new(FrameKind::Hold, step), &[])?;
        }
        Ok(true)
    }

    /// How often the controller is told that the run is held: well before its patience ends.
    fn hold_again_ns(&self) -> u64 {
        const OFTEN_NS: u64 = 100_000_000;
        let patience_ns = (self.job.wait_limit_s * 0.25e9) as u64;
        patience_ns.min(OFTEN_NS)
    }

    fn serve(&mut self, order: Order, step: Step) -> Result<(), LinkError> {
        let (desk, faults) = (&self.desk, &mut self.plant.faults);
        // Whoever asked may have gone away; what was asked is done all the same.
        match order {
            Order::Admit(prepared, answer) => {
                let events: Vec<_> = (prepared.iter().map(|fault| fault.event().clone())).collect();
                let admitted = if step.0 < self.job.run.steps {
                    faults.admit(prepared, step)
                } else {
                    Err("the run is over".into())
                };
                if let Ok(admitted) = &admitted {
                    for (fault, event) in admitted.iter().zip(events) {
                        self.sink.event(&Event::Accepted(FaultAccepted {
                            id: fault.id,
                            step: step.0,
                            fault: serde_json::to_value(event).unwrap_or_default(),
                        }))?;
                    }
                }
                let _ = answer.send(admitted);
            }
            Order::Clear(id, answer) => {
                let _ = answer.send((faults.clear(id, step), step));
            }
            Order::Show(answer) => {
                let _ = answer.send(faults.states());
            }
            Order::Pause(answer) => {
                desk.hold_at(step);
                let _ = answer.send(());
            }
            Order::Resume(answer) => {
                desk.hold_at(NEVER);
                let _ = answer.send(());
            }
            Order::Advance(steps, answer) => {
                let until = Step(step.0.saturating_add(steps));
                let _ = answer.send(if self.told_held_ns.is_some() {
                    desk.hold_at(until);
                    Ok(until)
                } else {
                    Err("the run is not paused; `hil pause` first".into())
                });
            }
        }
        Ok(())
    }

    /// Simulated seconds per second of the clock; `None` in lockstep.
    const fn pace(&self) -> Option<f64> {
        match self.job.run.clock {
            Clock::Lockstep => None,
            Clock::Paced { factor } => Some(factor),
            Clock::Realtime => Some(1.0),
        }
    }

    /// Until when the command of a step is awaited. The first waits for the controller: time has not
    /// begun.
    fn deadline_of(&self, step: Step) -> u64 {
        match (&self.pacer, self.job.run.clock) {
            (Some(pacer), Clock::Realtime) if step > self.first => {
                pacer.deadline_ns(step, self.job.run.deadline)
            }
            _ => u64::MAX,
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

    /// Makes the reference signals of a step, which depend on time alone.
    fn prepare(&mut self, step: Step) {
        let time_s = self.job.run.rate.seconds(step);
        let mut reference = &mut self.rows.stimulus[..];
        for stimulus in &self.job.stimuli {
            let count = 1 + stimulus.waveform.derivatives();
            let (row, rest) = reference.split_at_mut(count);
            stimulus::evaluate(&stimulus.waveform, time_s, row);
            reference = rest;
        }
        self.prepared = Some(step);
    }

    /// Fills the sample of a step; false if the plant diverged.
    fn measure(&mut self, step: Step) -> Result<bool, LinkError> {
        let (plant, rows) = (&mut self.plant, &mut self.rows);
        if plant.faults.advance(step, rows.last_values(step)) {
            plant.model.retune(plant.faults.parameters());
            plant.faults.faultable(&mut rows.parameter);
        }
        if self.prepared != Some(step) {
            self.prepare(step);
        }
        let (plant, rows) = (&mut self.plant, &mut self.rows);
        plant.model.measure(&mut rows.sensed);
        if let Err(bad) = first_bad(&plant.description.measured, &rows.sensed) {
            self.diverged(step, &format!("measured {bad}"))?;
            return Ok(false);
        }
        rows.sent_stimulus.copy_from_slice(&rows.stimulus);
        self.sample_age_steps = plant.faults.sample(
            step,
            (&rows.sensed, &rows.sent_stimulus),
            &mut rows.sample,
            &mut rows.invalid,
        );
        Ok(true)
    }

    /// After a sample was sent: take the command that answers it and integrate to the next step.
    fn collect(&mut self) -> Result<Progress, LinkError> {
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
        let Some(header) = self.link.receive(self.rows.receiver())? else {
            return match self.deadline_ns {
                u64::MAX => Ok(Progress::Controller),
                deadline_ns if monotonic_ns() < deadline_ns => {
                    Ok(Progress::ControllerUntil(deadline_ns))
                }
                _ => self.miss(),
            };
        };
        match self.side.on(&PlantEvent::Frame(&header)) {
            PlantAction::Apply(step) => {
                let header = self.rows.translate(header);
                self.take(step, header)?;
            }
            PlantAction::Keep => {
                let header = self.rows.translate(header);
                self.keep(header);
            }
            PlantAction::Finish => self.finish(Outcome::Completed, None)?,
            action => self.react(&action)?,
        }
        Ok(Progress::Busy)
    }

    /// Takes the command that answers a step, or what it had to do with in the run that is repeated.
    fn take(&mut self, step: Step, header: Header) -> Result<(), LinkError> {
        let received_ns = monotonic_ns();
        self.heard_ns = received_ns;
        if step == self.first
            && let Some(pacer) = &mut self.pacer
        {
            // Time begins when the controller has answered once.
            pacer.anchor(step, received_ns);
        }
        self.came(header, received_ns - self.sent_ns);
        if let Some(repetition) = &mut self.repetition {
            match repetition.exchange(step, header, &mut self.rows.frame) {
                Ok(header) => self.newest.header = header,
                Err(reason) => return self.give_up(Outcome::Failed, AbortCode::Other, reason),
            }
        }
        self.meet(step, received_ns)
    }

    /// Keeps a command that came too late for its own step.
    fn keep(&mut self, header: Header) {
        self.heard_ns = monotonic_ns();
        let due_ns = (self.pacer).map_or(0, |pacer| pacer.due_ns(Step(header.step)));
        self.came(header, self.heard_ns.saturating_sub(due_ns));
    }

    /// A command is the newest there is.
    fn came(&mut self, header: Header, round_trip_ns: u64) {
        let newest = &mut self.newest;
        newest.header = header;
        if round_trip_ns > newest.round_trip_ns {
            (newest.round_trip_ns, newest.work_ns) = (round_trip_ns, header.work_ns);
        }
    }

    /// The command missed its deadline: the step meets the newest there is.
    fn miss(&mut self) -> Result<Progress, LinkError> {
        let now_ns = monotonic_ns();
        let limit = WaitLimit::from_seconds(self.job.wait_limit_s);
        if now_ns - self.heard_ns >= limit.ns() {
            self.interrupt(&PlantEvent::Deadline(limit.ms()))?;
            return Ok(Progress::Busy);
        }
        let PlantAction::Hold(step) = self.side.on(&PlantEvent::Missed) else {
            return Ok(Progress::Controller);
        };
        if self.job.run.overrun == OverrunPolicy::Abort {
            self.missed.note(step);
            let late = format!(
                "controller did not answer step {step} by its deadline, and the policy for overruns is `abort`"
            );
            return self.overran(late);
        }
        self.meet(step, now_ns)?;
        Ok(Progress::Busy)
    }

    fn overran(&mut self, reason: String) -> Result<Progress, LinkError> {
        self.give_up(Outcome::Failed, AbortCode::Overrun, reason)?;
        Ok(Progress::Over)
    }

    /// A step meets the newest command: it is applied and the plant integrates to the next step.
    fn meet(&mut self, step: Step, received_ns: u64) -> Result<(), LinkError> {
        self.newest.held_steps = (step.0 - self.newest.header.step) as u32;
        if self.newest.held_steps > 0 && !self.side.is_alone() {
            self.missed.note(step);
        }
        let met = self.newest;
        (self.newest.round_trip_ns, self.newest.work_ns) = (0, 0);
        let header = &Header {
            age_steps: met.header.age_steps.saturating_add(met.held_steps),
            work_ns: met.work_ns,
            ..met.header
        };
        let (rows, plant) = (&mut self.rows, &mut self.plant);
        rows.take_command(header);
        let commands = &plant.description.commands;
        if let Err(bad) = first_bad(commands, &rows.command) {
            let reason = format!("controller's command of step {}: {bad}", header.step);
            return self.give_up(Outcome::Failed, AbortCode::NotANumber, reason);
        }
        let command = (&rows.command[..], &rows.command_invalid);
        let age_steps = (plant.faults).command(step, header, command, &mut rows.applied);

        let rate = self.job.run.rate;
        let time_s = rate.seconds(step);
        plant.model.truth(time_s, &rows.applied, &mut rows.truth);
        if let Err(bad) = plant.guard.check(&rows.truth) {
            if rows.truth.iter().all(|value| value.is_finite()) {
                self.note_record(step, &met, age_steps, received_ns);
            }
            return self.diverged(step, &bad.to_string());
        }
        self.note_record(step, &met, age_steps, received_ns);

        let interval = Interval {
            start_s: time_s,
            length_s: rate.period_s(),
            substeps: self.job.plant.substeps,
        };
        self.plant.model.advance(&interval, &self.rows.applied);
        self.executed += 1;
        self.timing.plant_ns = monotonic_ns() - received_ns;
        Ok(())
    }

    /// Writes down the record of a step; it is published while the controller works on the next.
    fn note_record(&mut self, step: Step, met: &Command, age_steps: u32, received_ns: u64) {
        let Command {
            header,
            held_steps,
            round_trip_ns,
            work_ns,
        } = met;
        let round_trip_ns = *round_trip_ns;
        let took_ns = received_ns - self.sent_ns + self.timing.plant_ns;
        self.timing = Timing {
            time_ns: self.job.run.rate.nanoseconds(step),
            epoch: u64::from(header.epoch),
            sample_age_steps: u64::from(self.sample_age_steps),
            command_age_steps: u64::from(age_steps),
            published_ns: received_ns,
            round_trip_ns,
            controller_ns: *work_ns,
            plant_ns: self.timing.plant_ns,
            late_ns: self.late_ns,
            held_steps: u64::from(*held_steps),
            answered: header.directive,
            plant_surroundings: self.lookout.after(took_ns),
            controller_surroundings: header.surroundings,
            directive: self.directive,
        };
        self.rows.write_record(step, header, &self.timing);
        self.pending = true;
    }

    /// Record N: the truth after the last step, which no command answers.
    fn record_final_truth(&mut self, step: Step) -> Result<(), LinkError> {
        let time_s = self.job.run.rate.seconds(step);
        let rows = &mut self.rows;
        self.plant
            .model
            .truth(time_s, &rows.applied, &mut rows.truth);
        if let Err(bad) = self.plant.guard.check(&rows.truth) {
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
        self.pending = true;
        Ok(())
    }

    fn diverged(&mut self, step: Step, what: &str) -> Result<(), LinkError> {
        let time_s = self.job.run.rate.seconds(step);
        let reason = format!("plant diverged at step {step} ({time_s} s): {what}");
        self.give_up(Outcome::Diverged, AbortCode::Diverged, reason)
    }

    fn abort(&mut self, abort: &Abort) -> Result<(), LinkError> {
        let outcome = match abort {
            Abort::Stopped { .. } => Outcome::Stopped,
            _ => Outcome::Failed,
        };
        self.give_up(outcome, abort.code(), abort.to_string())
    }

    /// Tells the controller, publishes what is there and ends.
    fn give_up(
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
            // Before the frames are open there is only the control channel.
            Err(LinkError::NotOpen) => {
                let refusal = Control::Refusal {
                    reason: reason.clone(),
                };
                self.link.send_control(&refusal.to_bytes())?;
            }
            other => other?,
        }
        self.finish(outcome, Some(reason))
    }

    fn finish(&mut self, outcome: Outcome, reason: Option<String>) -> Result<(), LinkError> {
        self.desk.close();
        self.side.on(&PlantEvent::Stop); // whatever it was in, it is over now
        // Room or not: nothing comes after it that could be lost.
        let published = if std::mem::take(&mut self.pending) {
            self.sink.record(&self.rows.record)
        } else {
            Ok(())
        };
        let end = RunEnd {
            steps: self.executed,
            outcome,
            reason,
            rejected_frames: self.link.rejected().count + self.plant.faults.rejected(),
            effects: self.plant.faults.effects(),
            overruns: (self.pacer)
                .map(|pacer| pacer.overruns())
                .unwrap_or_default(),
            missed_commands: self.missed,
        };
        self.end = Some(end.clone());
        published?;
        match self.sink.event(&Event::End(end)) {
            Err(LinkError::NotOpen) => Ok(()), // nobody records a run that never began
            other => other,
        }
    }
}

/// Spins for so long; gives how long it was.
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

mod succession;

#[cfg(test)]
mod tests;
