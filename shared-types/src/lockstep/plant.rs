//! The plant's side of lockstep.

mod event;

pub use event::{PlantAction, PlantEvent};

use super::{Abort, AbortCode, OnLoss, Standing};
use crate::frame::{FrameKind, Header};
use crate::hello::{Hello, Offer, agree};
use crate::ignored::{Ignored, Reason};
use crate::time::Step;

const PEER: &str = "controller";

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum State {
    AwaitHello,
    AwaitReady,
    /// Step not yet released.
    Between(Step),
    /// Sample sent, command awaited.
    AwaitCommand(Step),
    AwaitConfirmation,
    Over,
}

impl State {
    /// Unique number of the state, regardless of its step.
    const fn number(&self) -> u64 {
        match self {
            Self::AwaitHello => 0,
            Self::AwaitReady => 1,
            Self::Between(_) => 2,
            Self::AwaitCommand(_) => 3,
            Self::AwaitConfirmation => 4,
            Self::Over => 5,
        }
    }
}

/// Controller that exchanges steps with the plant, by its epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Controller {
    /// Active controller.
    Active(u32),
    /// Lost controller that has not been replaced yet.
    Lost(u32),
}

/// Controller that is about to take over, by its epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Candidate {
    /// Waiting for the candidate's hello.
    Announced(u32),
    /// Waiting for the candidate to open its frames.
    Welcomed(u32),
}

impl Candidate {
    const fn epoch(self) -> u32 {
        match self {
            Self::Announced(epoch) | Self::Welcomed(epoch) => epoch,
        }
    }
}

/// The plant's side: waits for hello, exchanges `steps` steps, then runs the end barrier.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PlantSide {
    state: State,
    first: Step,
    steps: u64,
    against_clock: bool,
    on_loss: OnLoss,
    controller: Controller,
    candidate: Option<Candidate>,
    /// First step whose command is newer than every accepted one.
    newer: Step,
    ignored: Ignored,
}

impl PlantSide {
    /// Creates a side that exchanges N steps.
    #[must_use]
    pub fn new(steps: u64) -> Self {
        Self {
            state: State::AwaitHello,
            first: Step(0),
            steps,
            against_clock: false,
            on_loss: OnLoss::Abort,
            controller: Controller::Active(1),
            candidate: None,
            newer: Step(0),
            ignored: Ignored::default(),
        }
    }

    /// Makes the side run in real time: commands may be late or missing.
    #[must_use]
    pub const fn against_clock(mut self) -> Self {
        self.against_clock = true;
        self
    }

    /// Sets the policy for a lost controller.
    #[must_use]
    pub const fn on_loss(mut self, on_loss: OnLoss) -> Self {
        self.on_loss = on_loss;
        self
    }

    /// Sets the first step of a resumed run: the steps before it were exchanged in another run.
    #[must_use]
    pub const fn beginning_at(mut self, first: Step) -> Self {
        self.first = first;
        self.newer = first;
        self
    }

    /// Returns the step that is not released yet, if any.
    #[must_use]
    pub const fn unreleased(&self) -> Option<Step> {
        match self.state {
            State::Between(step) => Some(step),
            _ => None,
        }
    }

    /// Returns `true` during hello.
    #[must_use]
    pub const fn is_greeting(&self) -> bool {
        matches!(self.state, State::AwaitHello | State::AwaitReady)
    }

    /// Returns `true` if the run is over, completed or not.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        matches!(self.state, State::Over)
    }

    /// Returns `true` if there is no controller.
    #[must_use]
    pub const fn is_alone(&self) -> bool {
        matches!(self.controller, Controller::Lost(_))
    }

    /// Returns `true` if steps wait for a replacement controller.
    #[must_use]
    pub fn waits_for_controller(&self) -> bool {
        self.needs_another() && !self.against_clock
    }

    /// Returns the epoch of the active controller, or of the last one.
    #[must_use]
    pub const fn epoch(&self) -> u32 {
        match self.controller {
            Controller::Active(epoch) | Controller::Lost(epoch) => epoch,
        }
    }

    /// Returns the epoch of an announced controller that is not active yet.
    #[must_use]
    pub fn candidate(&self) -> Option<u32> {
        self.candidate.map(Candidate::epoch)
    }

    /// Returns the counts of ignored messages and frames.
    #[must_use]
    pub const fn ignored(&self) -> Ignored {
        self.ignored
    }

    /// Returns the progress with the active controller.
    #[must_use]
    pub const fn standing(&self) -> Standing {
        Standing([
            self.state.number(),
            self.at().0,
            self.epoch() as u64,
            self.is_alone() as u64,
            self.newer.0,
        ])
    }

    /// Returns the current step, for messages.
    #[must_use]
    pub const fn at(&self) -> Step {
        match self.state {
            State::Between(step) | State::AwaitCommand(step) => step,
            State::AwaitHello | State::AwaitReady => self.first,
            State::AwaitConfirmation | State::Over => Step(self.steps),
        }
    }

    /// Processes an event and returns the resulting action.
    pub fn on(&mut self, event: &PlantEvent<'_>) -> PlantAction {
        match (&self.state, event) {
            (State::Over, _) => PlantAction::Nothing,
            (_, PlantEvent::Stop) => self.abort(Abort::Stopped { at: self.at() }),
            (_, PlantEvent::PeerGone(epoch)) => self.gone(*epoch),

            (State::AwaitHello, PlantEvent::Hello(hello, offer)) => match agree(hello, offer) {
                Ok(welcome) => {
                    self.state = State::AwaitReady;
                    PlantAction::Welcome(Box::new(welcome))
                }
                Err(refused) => {
                    self.state = State::Over;
                    PlantAction::Refuse(refused.to_string())
                }
            },
            (State::AwaitReady, PlantEvent::Ready(ready)) if *ready == self.epoch() => {
                self.state = State::Between(self.first);
                PlantAction::Nothing
            }
            (_, PlantEvent::Expect(epoch)) => self.expect(*epoch),
            (_, PlantEvent::Hello(hello, offer)) => self.greet(hello, offer),
            (_, PlantEvent::Ready(epoch)) => self.take_over(*epoch),
            (_, PlantEvent::CandidateLate(ms)) => self.candidate_late(*ms),

            (State::Between(step), PlantEvent::Release) if step.0 < self.steps => {
                let step = *step;
                self.state = State::AwaitCommand(step);
                PlantAction::SendSample(step)
            }
            (State::Between(_), PlantEvent::Release) => {
                self.state = State::AwaitConfirmation;
                PlantAction::SendEnd(Step(self.steps))
            }

            (State::AwaitCommand(_), PlantEvent::Missed) if self.waits_for_controller() => {
                PlantAction::Nothing
            }
            (State::AwaitCommand(step), PlantEvent::Missed) if self.goes_on_without_command() => {
                let step = *step;
                self.state = State::Between(step.next());
                PlantAction::Hold(step)
            }
            (State::AwaitConfirmation, PlantEvent::Missed) if self.is_alone() => {
                self.state = State::Over;
                PlantAction::Finish
            }

            (_, PlantEvent::Frame(_)) if self.is_alone() => self.ignore(Reason::Lost),
            (_, PlantEvent::Frame(header)) => self.on_frame(header),
            (_, PlantEvent::Contradiction(step)) => self.broken(format!(
                "it answered step {step} twice, with different commands"
            )),

            (State::AwaitHello, PlantEvent::Deadline(ms)) => self.late("say hello".into(), *ms),
            (State::AwaitReady, PlantEvent::Deadline(ms)) => {
                self.late("open its frames".into(), *ms)
            }
            (State::AwaitCommand(step), PlantEvent::Deadline(ms)) => {
                let what = if self.is_alone() {
                    format!("take over at step {step}")
                } else {
                    format!("answer step {step}")
                };
                self.late(what, *ms)
            }
            (State::AwaitConfirmation, PlantEvent::Deadline(ms)) => {
                self.late(format!("confirm the end after {} steps", self.steps), *ms)
            }
            // No message is due from the controller between steps.
            (State::Between(_), PlantEvent::Deadline(_)) => PlantAction::Nothing,

            (_, PlantEvent::Release | PlantEvent::Missed) => PlantAction::Nothing,
        }
    }

    fn on_frame(&mut self, header: &Header) -> PlantAction {
        let frame_step = Step(header.step);
        match (&self.state, header.kind()) {
            (_, Some(FrameKind::Abort)) => {
                let code = AbortCode::from_wire(header.directive);
                self.lose(Abort::ByPeer {
                    peer: PEER,
                    at: self.at(),
                    code,
                })
            }
            (State::AwaitCommand(step), Some(FrameKind::Command)) if frame_step == *step => {
                self.state = State::Between(frame_step.next());
                self.newer = frame_step.next();
                PlantAction::Apply(frame_step)
            }
            (State::AwaitConfirmation, Some(FrameKind::EndConfirmed)) => {
                if frame_step.0 == self.steps {
                    self.state = State::Over;
                    PlantAction::Finish
                } else {
                    let what = format!("it executed {frame_step} steps of {}", self.steps);
                    self.broken(what)
                }
            }
            (State::AwaitCommand(step), Some(FrameKind::Command))
                if self.against_clock && frame_step < *step && frame_step >= self.newer =>
            {
                self.newer = frame_step.next();
                PlantAction::Keep
            }
            (_, Some(FrameKind::Command)) if frame_step < self.at() => {
                self.ignore(if frame_step < self.newer {
                    Reason::Repeated
                } else {
                    Reason::Late
                })
            }
            (_, kind) => {
                let name =
                    kind.map_or_else(|| "a frame of an unknown kind".into(), |k| format!("{k:?}"));
                self.broken(format!("unexpected {name} of step {frame_step}"))
            }
        }
    }

    /// Returns `true` if the run needs another controller to continue.
    fn needs_another(&self) -> bool {
        self.is_alone() && self.on_loss == OnLoss::WaitForRestart
    }

    /// Returns `true` if a step may use the newest command instead of its own.
    const fn goes_on_without_command(&self) -> bool {
        self.against_clock || self.is_alone()
    }

    fn expect(&mut self, epoch: u32) -> PlantAction {
        let newest = self.candidate().unwrap_or(self.epoch());
        if self.is_greeting() || epoch <= newest {
            return PlantAction::Nothing;
        }
        self.candidate = Some(Candidate::Announced(epoch));
        PlantAction::Expect(epoch)
    }

    /// Processes the hello of an announced controller.
    fn greet(&mut self, hello: &Hello, offer: &Offer<'_>) -> PlantAction {
        let Some(Candidate::Announced(epoch)) = self.candidate else {
            return self.ignore(Reason::OutOfTurn);
        };
        match agree(hello, offer) {
            Ok(welcome) => {
                self.candidate = Some(Candidate::Welcomed(epoch));
                PlantAction::Welcome(Box::new(welcome))
            }
            Err(refused) => self.dismiss(Abort::Refused(refused.to_string())),
        }
    }

    fn take_over(&mut self, epoch: u32) -> PlantAction {
        if self.candidate != Some(Candidate::Welcomed(epoch)) {
            let is_known = epoch == self.epoch() || self.candidate() == Some(epoch);
            return self.ignore(if is_known {
                Reason::OutOfTurn
            } else {
                Reason::Epoch
            });
        }
        if self.state == State::AwaitConfirmation {
            let late = format!("it came after the last of {} steps", self.steps);
            return self.dismiss(Abort::Refused(late));
        }
        self.candidate = None;
        self.controller = Controller::Active(epoch);
        // Its first sample is that of this step; it never saw the earlier ones.
        self.newer = self.at();
        PlantAction::TakeOver(match self.state {
            State::AwaitCommand(step) => Some(step),
            _ => None,
        })
    }

    /// Continues without the announced controller, if possible.
    fn dismiss(&mut self, why: Abort) -> PlantAction {
        self.candidate = None;
        if self.needs_another() {
            self.abort(why)
        } else {
            PlantAction::Dismiss(why)
        }
    }

    fn candidate_late(&mut self, limit_ms: u64) -> PlantAction {
        let what = match self.candidate {
            None => return PlantAction::Nothing,
            Some(Candidate::Announced(_)) => "say hello",
            Some(Candidate::Welcomed(_)) => "open its frames",
        };
        self.dismiss(Abort::Late {
            peer: "the new controller",
            what: what.into(),
            limit_ms,
        })
    }

    fn gone(&mut self, epoch: u32) -> PlantAction {
        let at = self.at();
        if self.candidate() == Some(epoch) {
            return self.dismiss(Abort::Gone {
                peer: "the new controller",
                at,
            });
        }
        if epoch == self.epoch() {
            return self.lose(Abort::Gone { peer: PEER, at });
        }
        PlantAction::Nothing
    }

    /// Ignores a message or frame of a controller.
    pub fn ignore(&mut self, reason: Reason) -> PlantAction {
        self.ignored.count(reason);
        PlantAction::Ignore(reason)
    }

    fn late(&mut self, what: String, limit_ms: u64) -> PlantAction {
        let late = Abort::Late {
            peer: PEER,
            what,
            limit_ms,
        };
        if self.needs_another() {
            // No replacement arrived.
            self.abort(late)
        } else {
            self.lose(late)
        }
    }

    fn broken(&mut self, what: String) -> PlantAction {
        self.lose(Abort::Protocol {
            peer: PEER,
            at: self.at(),
            what,
        })
    }

    /// Gives up the active controller.
    fn lose(&mut self, why: Abort) -> PlantAction {
        let Controller::Active(epoch) = self.controller else {
            return PlantAction::Nothing;
        };
        if self.is_greeting() || self.on_loss == OnLoss::Abort {
            return self.abort(why);
        }
        self.controller = Controller::Lost(epoch);
        PlantAction::Lose(why)
    }

    fn abort(&mut self, abort: Abort) -> PlantAction {
        self.state = State::Over;
        PlantAction::Abort(abort)
    }

    /// Complete state that determines further behaviour.
    #[cfg(test)]
    pub(super) fn key(&self) -> [u64; 7] {
        let (epoch, welcomed) = match self.candidate {
            None => (0, false),
            Some(Candidate::Announced(epoch)) => (epoch, false),
            Some(Candidate::Welcomed(epoch)) => (epoch, true),
        };
        [
            self.state.number(),
            self.at().0,
            u64::from(self.epoch()),
            u64::from(self.is_alone()),
            self.newer.0,
            u64::from(epoch),
            u64::from(welcomed),
        ]
    }
}
