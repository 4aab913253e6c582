//! Handover: authentication of the controller, its loss, and another controller that takes over during the run.

use hil_session::clock::monotonic_ns;
use hil_session::program;
use hil_session::supervision::Gone;
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::{Control, Offer, TunableParameter, Welcome};
use shared_types::ignored::Reason;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::lockstep::{Abort, AbortCode, OnLoss, PlantAction, PlantEvent};
use shared_types::record::{ControllerChange, ControllerFate, Event, Outcome};
use shared_types::stream::RecordSink;
use shared_types::time::Step;
use shared_types::wait::WaitLimit;

use super::commands::Command;
use super::{Clock, Engine, Progress};
use crate::tuning::Offered;

/// State of the latest controller that is to take over.
pub(super) struct Handover {
    /// Epoch of the controller that was announced last.
    expected: u32,
    /// Time since which the controller is awaited.
    since_ns: u64,
    /// Control message held until its sender is authenticated.
    pending: Option<Control>,
    agreed: Option<Agreed>,
}

/// Agreement with a controller that has not taken over yet.
struct Agreed {
    welcome: Welcome,
    law: String,
    tunable: Vec<TunableParameter>,
}

impl Default for Handover {
    fn default() -> Self {
        Self::to(1, 0)
    }
}

impl Handover {
    /// Begins with the controller of an epoch, not yet identified.
    const fn to(expected: u32, since_ns: u64) -> Self {
        Self {
            expected,
            since_ns,
            pending: None,
            agreed: None,
        }
    }
}

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// Expects another controller, announced for this epoch. If no control channel can be created for the controller,
    /// the run continues without it.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    pub fn expect(&mut self, epoch: u32) -> Result<(), LinkError> {
        if let PlantAction::Expect(epoch) = self.side.on(&PlantEvent::Expect(epoch)) {
            self.handover = Handover::to(epoch, monotonic_ns());
            if let Err(error) = self.link.expect(epoch) {
                self.say(&error.to_string());
                self.interrupt(&PlantEvent::PeerGone(epoch))?;
            }
        }
        Ok(())
    }

    /// Makes a run without a log of its own: what happens to its controllers is in its recording alone.
    #[must_use]
    pub fn without_log(self) -> Self {
        Self {
            has_log: false,
            ..self
        }
    }

    /// Takes the reason of a controller in this process that has failed, which its last frame cannot carry.
    pub fn controller_failed(&mut self, reason: String) {
        self.controller_failure = Some(reason);
    }

    /// Returns an abort with the controller's own reason where that is known.
    pub(super) fn with_reason(&mut self, abort: &Abort) -> Abort {
        match (abort, self.controller_failure.take()) {
            (
                Abort::ByPeer {
                    code: AbortCode::Other,
                    ..
                },
                Some(reason),
            ) => Abort::Failed(reason),
            _ => abort.clone(),
        }
    }

    fn say(&self, line: &str) {
        if self.has_log {
            program::say(line);
        }
    }

    /// Returns `true` while the first controller is being greeted.
    #[must_use]
    pub const fn is_greeting(&self) -> bool {
        self.side.is_greeting()
    }

    /// Returns `true` while the first controller may still be starting after this waiting time.
    #[must_use]
    pub fn is_controller_starting(&self, waited_ns: u64) -> bool {
        let limit = self.job.start_limit_s.map(WaitLimit::from_seconds);
        self.is_greeting() && limit.is_some_and(|limit| waited_ns < limit.ns())
    }

    /// Returns `true` while the first controller, started manually, may be stopped in a debugger for any length of
    /// time.
    #[must_use]
    pub const fn is_controller_in_hand(&self) -> bool {
        self.job.is_controller_by_hand && self.is_greeting()
    }

    /// Returns a newly detected loss: the active controller or the announced one.
    #[must_use]
    pub fn news(&self, gone_epochs: Gone) -> Option<u32> {
        if !gone_epochs.any() {
            return None;
        }
        let active = self.side.epoch();
        if (gone_epochs.is(active) || gone_epochs.is_everybody()) && !self.side.is_alone() {
            return Some(active);
        }
        self.candidate_gone(gone_epochs)
    }

    /// Returns the announced controller if it ended before taking over.
    #[must_use]
    pub fn candidate_gone(&self, gone_epochs: Gone) -> Option<u32> {
        self.side.candidate().filter(|epoch| gone_epochs.is(*epoch))
    }

    /// Receives the next control message of the process that was launched as the controller. Other processes are told
    /// to leave.
    pub(super) fn hear(&mut self) -> Result<Option<Control>, LinkError> {
        let pending = &mut self.handover.pending;
        if pending.is_none() {
            *pending = match self.link.receive_message()? {
                Some(None) => {
                    self.side.ignore(Reason::Unreadable);
                    None
                }
                message => message.flatten(),
            };
        }
        if pending.is_none() {
            return Ok(None);
        }
        match self.link.peer()? {
            Peer::Launched => Ok(pending.take()),
            Peer::Unknown => Ok(None),
            Peer::Stranger(reason) => {
                *pending = None;
                self.side.ignore(Reason::Impostor);
                self.say(&format!("refused: {reason}"));
                let refusal = Control::Refusal { reason };
                self.link.send_message(refusal)?;
                Ok(None)
            }
        }
    }

    /// Passes a message of this epoch's controller to the protocol.
    pub(super) fn take_message(&mut self, message: &Control, epoch: u32) -> PlantAction {
        match message {
            Control::Hello(hello) => {
                let described = (self.job.law.as_ref()).filter(|_| self.side.is_greeting());
                let result = described.map_or(Ok(()), |law| hello.check_described(law));
                if let Err(error) = result {
                    return PlantAction::Refuse(error.to_string());
                }
                let offer = Offer {
                    session: self.job.session,
                    epoch,
                    rate: self.job.run.rate,
                    steps: self.job.run.steps,
                    first: self.side.at(),
                    against_clock: self.job.run.clock == Clock::Realtime,
                    measured: &self.plant.description.measured,
                    reference: &self.plant.reference,
                    commands: &self.plant.description.commands,
                };
                self.side.on(&PlantEvent::Hello(hello, &offer))
            }
            Control::Ready { epoch } => self.side.on(&PlantEvent::Ready(*epoch)),
            Control::Welcome(_) | Control::Refusal { .. } | Control::Tuned(_) => {
                self.side.ignore(Reason::OutOfTurn)
            }
        }
    }

    /// Receives messages of the announced controller; returns `true` if the run was affected, because the controller
    /// takes over or was the last hope. Otherwise the active controller continues within its current limit.
    pub(super) fn attend_candidate(&mut self) -> Result<bool, LinkError> {
        let limit = self.wait_limit();
        if monotonic_ns() - self.handover.since_ns >= limit.ns() {
            return self.interrupt(&PlantEvent::CandidateLate(limit.ms()));
        }
        let Some(message) = self.hear()? else {
            return Ok(false);
        };
        let standing = self.side.standing();
        let before = (self.side.is_alone(), self.side.waits_for_controller());
        match self.take_message(&message, self.handover.expected) {
            PlantAction::Welcome(welcome) => {
                self.link.open_frames(&FrameSpec {
                    identity: welcome.frame_identity(),
                    outgoing: welcome.sample.len(),
                    incoming: welcome.command.len(),
                })?;
                if let Control::Hello(hello) = message {
                    self.handover.agreed = Some(Agreed {
                        welcome: (*welcome).clone(),
                        law: hello.law,
                        tunable: hello.tunable,
                    });
                }
                self.link.send_message(Control::Welcome(welcome))?;
            }
            PlantAction::TakeOver(unanswered) => self.take_over(unanswered, before)?,
            action => self.react(&action)?,
        }
        Ok(self.side.standing() != standing)
    }

    /// Activates the announced controller, possibly after the run waited or continued without one.
    fn take_over(
        &mut self,
        unanswered: Option<Step>,
        (was_alone, waited): (bool, bool),
    ) -> Result<(), LinkError> {
        let Some(Agreed {
            welcome,
            law,
            tunable,
        }) = self.handover.agreed.take()
        else {
            return Ok(()); // there is one whenever the protocol says so
        };
        if !was_alone {
            self.dismiss_active(AbortCode::Replaced)?;
        }
        self.link.take_over();
        self.rows.rebind(&welcome);
        let now_ns = monotonic_ns();
        // Time stopped while there was no controller; a hold by itself delays everything after its beginning.
        if waited && let Some(pacer) = &mut self.pacer {
            let until_ns = self.held.map_or(now_ns, |hold| hold.since_ns);
            pacer.delay(until_ns.saturating_sub(self.commands.heard_ns));
        }
        self.commands.heard_ns = now_ns;
        self.plant.tuning.offer(Offered {
            epoch: self.side.epoch(),
            law: law.clone(),
            parameters: tunable,
        });
        if self.plant.tuning.number() > 0 {
            self.tell_law()?;
        }
        self.publish(self.side.epoch(), ControllerFate::Joined { law })?;
        if let Some(step) = unanswered {
            self.sample.sent_ns = monotonic_ns();
            self.link
                .send(&self.sample_header(step), &self.rows.sample)?;
        }
        Ok(())
    }

    /// Gives up the active controller and continues according to the policy.
    pub(super) fn lose(&mut self, why: &Abort) -> Result<(), LinkError> {
        let (at, policy) = (self.side.at(), self.job.run.on_controller_loss);
        // It may only be stopped, and wake up again.
        self.dismiss_active(why.code())?;
        self.plant.tuning.lose_controller();
        if policy == OnLoss::SafeCommand {
            let invalid = self.rows.fill_frame(&self.job.plant.safe_command);
            self.commands.newest = Command::new(Header {
                invalid,
                ..Header::new(FrameKind::Command, at)
            });
        }
        let reason = why.to_string();
        self.publish(self.side.epoch(), ControllerFate::Lost { reason, policy })?;
        self.say(&format!("{why}; {}", policy.name()));
        self.commands.heard_ns = monotonic_ns();
        if policy == OnLoss::WaitForRestart && self.side.candidate().is_none() {
            self.expect(self.handover.expected + 1)?;
        }
        Ok(())
    }

    fn dismiss_active(&mut self, code: AbortCode) -> Result<(), LinkError> {
        let header = Header {
            directive: code as u64,
            ..Header::new(FrameKind::Abort, self.side.at())
        };
        self.link.send(&header, &[])
    }

    /// Dismisses the announced controller.
    pub(super) fn dismiss(&mut self, why: &Abort) -> Result<(), LinkError> {
        let reason = why.to_string();
        self.say(&format!("refused another controller: {reason}"));
        self.handover.agreed = None;
        let refusal = Control::Refusal {
            reason: reason.clone(),
        };
        self.link.send_message(refusal)?;
        self.publish(self.handover.expected, ControllerFate::Refused { reason })
    }

    /// Reports a change to observers, after all earlier items.
    fn publish(&mut self, epoch: u32, change: ControllerFate) -> Result<(), LinkError> {
        self.tell()?;
        let step = self.side.at().0;
        let change = ControllerChange {
            epoch,
            step,
            change,
        };
        self.publisher.sink.event(&Event::Controller(change))
    }

    /// Continues after a loss with the latest command, or waits for another controller.
    pub(super) fn go_on_alone(&mut self) -> Result<Progress, LinkError> {
        let (limit, now_ns) = (self.wait_limit(), monotonic_ns());
        let waits = self.job.run.on_controller_loss == OnLoss::WaitForRestart;
        if waits && self.commands.are_silent(now_ns, limit) {
            self.interrupt(&PlantEvent::Deadline(limit.ms()))?;
            return Ok(Progress::Busy);
        }
        match self.side.on(&PlantEvent::Missed) {
            PlantAction::Hold(step) => self.meet(step, now_ns)?,
            PlantAction::Finish => self.finish(Outcome::Completed, None)?,
            _ => return Ok(Progress::Controller),
        }
        Ok(Progress::Busy)
    }
}
