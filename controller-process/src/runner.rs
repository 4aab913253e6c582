//! The runner: the controller's main loop.
//!
//! Joins a law with the controller's side of the lockstep protocol: the runner binds the law's signals to those of the
//! sample by name, converts signals with another unit, runs the law at its own rate, delays its command by a step if
//! requested, and answers every sample. Like the plant's engine, it never blocks.

use std::borrow::Borrow;
use std::ops::Deref;

use hil_session::clock::monotonic_ns;
use hil_session::thread::ThreadSampler;
use shared_types::checkpoint::Saves;
use shared_types::connection::renamed;
use shared_types::describe::Invalid;
use shared_types::directive::{Answered, Directive};
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::{Control, Hello, Welcome};
use shared_types::layout::SignalKind;
use shared_types::link::{FrameSpec, Link, LinkError};
use shared_types::lockstep::{Abort, AbortCode, ControllerAction, ControllerEvent, ControllerSide};
use shared_types::side::Side;
use shared_types::table::Field;
use shared_types::text;
use shared_types::time::Step;
use shared_types::wait::{Sleeper, WaitLimit};

use crate::controller::{Law, LawKind, Start};
use crate::job::Job;
use answering::{Held, Made};
use converted::Converted;
use quality::Tracked;
use saved::{SavedController, save};
use tuning::{Found, Tuning, offered};

/// Result of a poll: progress, or the awaited event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Progress was made; poll again and restart any wait.
    Busy,
    /// Awaiting the plant's next message or frame.
    Plant,
    /// Awaiting the next message or frame of a plant that has just announced a hold.
    Held,
    /// The run is over.
    Over,
}

/// End of a run on this side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// All steps completed, confirmed by both sides.
    Completed {
        /// Number of steps.
        steps: u64,
    },
    /// Aborted before the last step.
    Aborted(Abort),
}

impl End {
    /// Returns `true` if the plant ended the run, because the run was complete or left the range of validity.
    #[must_use]
    pub const fn is_of_plant(&self) -> bool {
        use AbortCode::{Diverged, NotANumber};
        matches!(
            self,
            Self::Completed { .. }
                | Self::Aborted(Abort::ByPeer {
                    code: Diverged | NotANumber,
                    ..
                })
        )
    }
}

/// Run of a law, which is borrowed or shared.
pub struct Runner<K, L> {
    link: L,
    side: ControllerSide,
    kind: K,
    job: Job,
    hello: Hello,
    /// Started law until it is bound, if it has commands of its own.
    started: Option<Box<dyn Law>>,
    bound: Option<Bound>,
    saves: Saves,
    /// State to resume from, if there is one.
    saved: Option<SavedController>,
    end: Option<End>,
}

/// Law with its signals resolved and all memory allocated.
struct Bound {
    law: Box<dyn Law>,
    /// Index of each measured signal of the law in the sample.
    measured_places: Vec<usize>,
    reference_places: Vec<usize>,
    converted: Converted,
    quality: Tracked,
    sample: Vec<f64>,
    measured: Vec<f64>,
    reference: Vec<f64>,
    /// Last answer of the law: commands, then internals.
    answer: Vec<f64>,
    /// Commands of the previous answer, for a delayed command.
    previous: Vec<f64>,
    /// Values of the frame to send.
    frame: Vec<f64>,
    /// Step of the sample on which each command is based; before the first sample, one period earlier.
    made: Made,
    /// Commands of each of them that the law did not refresh.
    held: Held,
    /// Step until which the last frame is repeated, if a directive delays the answer.
    late_until: Option<Step>,
    /// Values of the frame to send at `late_until`.
    late: Vec<f64>,
    /// Step of the last answer, and the steps answered before it.
    last: Option<Step>,
    answered: Answered,
    sampler: ThreadSampler,
    tuning: Tuning,
    /// Sample that waits for a preceding message of the plant.
    waiting: Option<Header>,
    /// Time of the last answer in ns; before the first answer, the creation time of this [`Bound`].
    sent_ns: u64,
}

/// Selects the law of this name that is made for this plant, or for any plant.
///
/// # Errors
/// If there is no such law.
pub fn choose<'a, K: Borrow<LawKind>>(
    laws: &'a [K],
    law: &str,
    plant: &str,
) -> Result<&'a K, Invalid> {
    let is_it = |kind: &&K| {
        let description = &(**kind).borrow().description;
        description.name == law && description.suits(plant)
    };
    let kind = laws.iter().find(is_it);
    kind.ok_or_else(|| {
        Invalid(format!(
            "this binary has no law `{law}` for plant `{plant}`"
        ))
    })
}

fn start(kind: &LawKind, job: &Job, commands: &[Field]) -> Result<Box<dyn Law>, Invalid> {
    (kind.start)(&Start {
        parameters: &job.parameters,
        model: &job.model,
        period_s: period_s(job),
        commands,
    })
}

/// Returns the time between two samples of the law.
fn period_s(job: &Job) -> f64 {
    f64::from(job.rate_divisor) / job.rate.hz()
}

impl<K: Deref<Target = LawKind>, L: Link> Runner<K, L> {
    /// Returns the sleeper for the loop's waits.
    pub fn sleeper(&self) -> Option<Box<dyn Sleeper>> {
        self.link.sleeper()
    }

    /// Creates a runner that is about to send hello.
    ///
    /// # Errors
    /// If the job does not match the law.
    pub fn new(kind: K, job: Job, link: L) -> Result<Self, Invalid> {
        let law = &kind.description;
        let checkpoints = &job.checkpoints;
        let resume = checkpoints.resume.as_ref();
        let saved: Option<SavedController> =
            resume.map(|resume| resume.read(&law.name)).transpose()?;
        let commands = law.commands.as_deref().unwrap_or_default();
        let mut started = start(&kind, &job, commands)?;
        if !job.is_tuned {
            started.check_start()?;
        }
        for parameters in &job.changes {
            let (parameters, job) = (parameters.clone(), job.clone());
            start(&kind, &Job { parameters, ..job }, commands)?;
        }
        if let Some(saved) = &saved {
            started.restore(&saved.law)?;
        }
        let hello = Hello {
            tunable: offered(law, &job.parameters, &started.unreadable()),
            ..Hello::of(&law.connected(&job.connections)?, job.session)
        };
        Ok(Self {
            link,
            side: ControllerSide::new(),
            saves: Saves::new(Side::Controller, &law.name, checkpoints.clone()),
            saved,
            job,
            hello,
            // A law that takes the commands of any plant is started anew once they are known.
            started: law.commands.as_ref().map(|_| started),
            bound: None,
            end: None,
            kind,
        })
    }

    /// Sends hello; call once, before polling.
    ///
    /// # Errors
    /// If the link failed.
    pub fn begin(&mut self) -> Result<(), LinkError> {
        match self.side.on(&ControllerEvent::Begin(&self.hello)) {
            ControllerAction::SendHello => {
                let hello = self.hello.clone();
                self.link.send_message(Control::Hello(hello))
            }
            _ => Ok(()),
        }
    }

    /// Does everything that is possible now.
    ///
    /// # Errors
    /// If the link failed.
    pub fn poll(&mut self) -> Result<Progress, LinkError> {
        if self.side.is_over() {
            return Ok(Progress::Over);
        }
        let progress = match &mut self.bound {
            None => self.greet()?,
            Some(bound) => match self
                .link
                .receive(&mut bound.sample)?
                .or(bound.waiting.take())
            {
                Some(header) if header.tuning > bound.tuning.number() && !self.hear(&header)? => {
                    false
                }
                Some(header) => {
                    let progress = self.take(&header)?;
                    if header.kind() == Some(FrameKind::Hold) && !self.side.is_over() {
                        return Ok(Progress::Held);
                    }
                    progress
                }
                // While frames flow, a refusal means that the plant aborts before the first step.
                None if self.side.awaits_first() => self.greet()?,
                None => false,
            },
        };
        Ok(if progress {
            Progress::Busy
        } else {
            Progress::Plant
        })
    }

    /// Processes the plant's parameter messages before a sample; returns `false` if the sample must wait for a message
    /// that has not arrived.
    fn hear(&mut self, header: &Header) -> Result<bool, LinkError> {
        let Some(bound) = &mut self.bound else {
            return Ok(true);
        };
        if header.kind() != Some(FrameKind::Sample) {
            return Ok(true);
        }
        while let Some(message) = self.link.receive_message()? {
            if let Some(Control::Tuned(tuned)) = message {
                bound.tuning.hear(tuned);
            }
        }
        let result = bound.tuning.find(header.tuning);
        bound.waiting = (result == Found::Missing).then_some(*header);
        Ok(result == Found::Here)
    }

    /// Handles a timeout, a death or a request to stop.
    ///
    /// # Errors
    /// If the link failed.
    pub fn interrupt(&mut self, event: &ControllerEvent<'_>) -> Result<(), LinkError> {
        match self.side.on(event) {
            ControllerAction::Abort(abort) => self.abort(abort),
            _ => Ok(()),
        }
    }

    /// Returns `true` while the plant, started manually, may be stopped in a debugger for any length of time.
    #[must_use]
    pub const fn is_plant_in_hand(&self) -> bool {
        self.job.is_plant_by_hand && (self.bound.is_none() || self.side.awaits_first())
    }

    /// Returns `true` while the plant may still be starting after this waiting time.
    #[must_use]
    pub fn is_plant_starting(&self, waited_ns: u64) -> bool {
        let limit = self.job.start_limit_s.map(WaitLimit::from_seconds);
        let is_before = self.bound.is_none() || self.side.awaits_first();
        is_before && limit.is_some_and(|limit| waited_ns < limit.ns())
    }

    /// Returns the end of the run; `None` until then.
    #[must_use]
    pub const fn end(&self) -> Option<&End> {
        self.end.as_ref()
    }

    /// Agrees with the plant on the content of the frames, before the first step; returns `false` if there was no
    /// progress.
    fn greet(&mut self) -> Result<bool, LinkError> {
        let Some(Some(message)) = self.link.receive_message()? else {
            return Ok(false);
        };
        // The first sample may follow the message that precedes it.
        if let (Control::Tuned(tuned), Some(bound)) = (&message, &mut self.bound) {
            bound.tuning.hear(tuned.clone());
            return Ok(false);
        }
        let before = self.side.standing();
        match self.side.on(&ControllerEvent::Control(&message)) {
            ControllerAction::OpenFrames(welcome) => match self.bind(&welcome) {
                Ok(bound) => {
                    self.link.open_frames(&FrameSpec {
                        identity: welcome.frame_identity(),
                        outgoing: welcome.command.len(),
                        incoming: welcome.sample.len(),
                    })?;
                    self.bound = Some(bound);
                    if let ControllerAction::SendReady(epoch) =
                        self.side.on(&ControllerEvent::Opened)
                    {
                        self.link.send_message(Control::Ready { epoch })?;
                    }
                }
                Err(reason) => {
                    self.side.on(&ControllerEvent::Stop);
                    self.end = Some(End::Aborted(Abort::Refused(reason)));
                }
            },
            ControllerAction::Abort(abort) => self.abort(abort)?,
            _ => {}
        }
        Ok(self.side.standing() != before)
    }

    fn bind(&mut self, welcome: &Welcome) -> Result<Bound, String> {
        if welcome.rate != self.job.rate {
            let (theirs, ours) = (welcome.rate.hz(), self.job.rate.hz());
            return Err(format!(
                "the plant runs at {theirs} Hz, but this controller's job is for {ours} Hz"
            ));
        }
        let (theirs, ours) = (welcome.first, self.job.checkpoints.first_step());
        // A controller that takes over begins at the current step of the run.
        if theirs != ours && self.job.epoch == 1 {
            return Err(format!(
                "the plant begins at step {theirs}, but this controller's job begins at step {ours}"
            ));
        }
        let law = &self.kind.description;
        let connections = &self.job.connections;
        let places = |kind, fields: &[Field]| {
            (welcome.sample)
                .bind(kind, &renamed(kind, fields, connections))
                .map_err(|unbound| unbound.iter().map(ToString::to_string).collect::<Vec<_>>())
                .map_err(|unbound| unbound.join("; "))
        };
        let commands = welcome.command.fields(SignalKind::Command);
        let started = match self.started.take() {
            Some(started) => started,
            None => start(&self.kind, &self.job, &commands).map_err(|e| e.to_string())?,
        };
        let row = answering::begin(&commands, welcome.command.len());
        let mut bound = Bound {
            law: started,
            measured_places: places(SignalKind::Measured, &law.measured)?,
            reference_places: places(SignalKind::Reference, &law.reference)?,
            converted: Converted::of(law, connections),
            quality: Tracked::new(&law.measured, connections, &welcome.sample),
            sample: vec![0.0; welcome.sample.len()],
            measured: vec![0.0; law.measured.len()],
            reference: vec![0.0; law.reference.len()],
            answer: row.clone(),
            previous: row[..commands.len()].to_vec(),
            frame: row.clone(),
            made: {
                let before = -i64::from(self.job.rate_divisor);
                Made {
                    answer: before,
                    previous: before,
                    frame: before,
                    late: before,
                }
            },
            held: Held::default(),
            late_until: None,
            late: row,
            last: None,
            answered: Answered::default(),
            sampler: ThreadSampler::default(),
            tuning: Tuning::new(
                law,
                &self.job.parameters,
                &self.job.model,
                period_s(&self.job),
            ),
            waiting: None,
            sent_ns: monotonic_ns(),
        };
        if let Some(saved) = self.saved.clone() {
            bound.restore(saved).map_err(|e| e.to_string())?;
        }
        Ok(bound)
    }

    /// Processes a frame of the plant; returns `false` if the run does not advance.
    fn take(&mut self, header: &Header) -> Result<bool, LinkError> {
        let received_ns = monotonic_ns();
        let before = self.side.standing();
        match (
            self.side.on(&ControllerEvent::Frame(header)),
            &mut self.bound,
        ) {
            (ControllerAction::Answer(step), Some(bound)) => {
                let age_steps = match bound.answer(step, header, &self.job) {
                    Ok(age_steps) => age_steps,
                    Err(failure) => {
                        let cause = text::line(&failure.to_string());
                        self.fail(format!("the law failed at step {step}: {cause}"))?;
                        return Ok(true);
                    }
                };
                let is_seen = !Directive::from_wire(header.directive).unseen;
                let answered_ns = monotonic_ns();
                let answer = Header {
                    time_ns: header.time_ns,
                    work_ns: answered_ns - received_ns,
                    directive: bound.note(step, is_seen).to_wire(),
                    surroundings: bound.look(answered_ns),
                    age_steps,
                    invalid: *bound.held.frame.words(),
                    ..Header::new(FrameKind::Command, step)
                };
                self.link.send(&answer, &bound.frame)?;
                let next = step.next();
                if self.saves.are_due(next)
                    && let Err(reason) = save(bound, &mut self.saves, next)
                {
                    self.fail(format!("no checkpoint before step {next}: {reason}"))?;
                }
            }
            (ControllerAction::ConfirmEnd(step), _) => {
                self.link
                    .send(&Header::new(FrameKind::EndConfirmed, step), &[])?;
                self.end = Some(End::Completed { steps: step.0 });
            }
            (ControllerAction::Abort(abort), _) => self.abort(abort)?,
            _ => {}
        }
        Ok(self.side.standing() != before)
    }

    /// Ends the run because of a failure of this side.
    fn fail(&mut self, reason: String) -> Result<(), LinkError> {
        self.side.on(&ControllerEvent::Stop);
        self.abort(Abort::Failed(reason))
    }

    /// Informs the plant and ends the run.
    fn abort(&mut self, abort: Abort) -> Result<(), LinkError> {
        let header = Header {
            directive: abort.code() as u64,
            ..Header::new(FrameKind::Abort, self.side.at())
        };
        self.end = Some(End::Aborted(abort));
        match self.link.send(&header, &[]) {
            Err(LinkError::NotOpen) => Ok(()), // the plant waits for a hello and will say so
            other => other,
        }
    }
}

mod answering;
mod converted;
pub(crate) mod local;
mod quality;
mod saved;
mod tuning;

#[cfg(test)]
mod chatter;
#[cfg(test)]
mod tests;
