//! The plant's side of lockstep.

use super::{Abort, AbortCode};
use crate::frame::{FrameKind, Header};
use crate::hello::{Hello, Offer, Welcome, agree};
use crate::time::Step;

const PEER: &str = "controller";

/// What happened.
#[derive(Debug)]
pub enum PlantEvent<'a> {
    /// A hello came; what the plant offers in return.
    Hello(&'a Hello, &'a Offer<'a>),
    /// The controller opened the frames of this epoch.
    Ready(u32),
    /// The clock releases the next step.
    Release,
    /// A frame came that passed the link's checks.
    Frame(&'a Header),
    /// The command of the step missed its deadline, against the clock.
    Missed,
    /// The bounded wait, so many ms long, is over.
    Deadline(u64),
    /// The controller's process ended.
    PeerGone,
    /// Somebody wants the run to end.
    Stop,
}

/// What to do next.
#[derive(Debug, PartialEq)]
pub enum PlantAction {
    /// Nothing; the event changes nothing.
    Ignore,
    /// Open the frames, then send this welcome.
    Welcome(Box<Welcome>),
    /// Send a refusal with this reason; the run is over.
    Refuse(String),
    /// Send the sample of this step.
    SendSample(Step),
    /// Apply the command that just came to this step, integrate, publish the record.
    Apply(Step),
    /// Keep the command that just came, of an earlier step: it is the newest now.
    Keep,
    /// The same as apply, with the newest command there is.
    Hold(Step),
    /// Send the end after so many steps.
    SendEnd(Step),
    /// Both sides executed every step.
    Finish,
    /// Tell the controller (unless it is gone) and end.
    Abort(Abort),
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum State {
    AwaitHello,
    AwaitReady {
        epoch: u32,
    },
    /// Step not yet released.
    Between(Step),
    /// Sample sent, command awaited.
    AwaitCommand(Step),
    AwaitConfirmation,
    Over,
}

/// The plant's side: waits for hello, then exchanges `steps` steps, then the end barrier.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PlantSide {
    state: State,
    first: Step,
    steps: u64,
    against_clock: bool,
    ignored: u64,
}

impl PlantSide {
    /// A side that is to exchange so many steps.
    #[must_use]
    pub const fn new(steps: u64) -> Self {
        Self {
            state: State::AwaitHello,
            first: Step(0),
            steps,
            against_clock: false,
            ignored: 0,
        }
    }

    /// The same against the clock: a command may come late or never.
    #[must_use]
    pub const fn against_clock(mut self) -> Self {
        self.against_clock = true;
        self
    }

    /// The same in a run that goes on from a checkpoint: the steps before this one were exchanged
    /// in another.
    #[must_use]
    pub const fn beginning_at(mut self, first: Step) -> Self {
        self.first = first;
        self
    }

    /// The step that waits to be released, if that is what is awaited.
    #[must_use]
    pub const fn unreleased(&self) -> Option<Step> {
        match self.state {
            State::Between(step) => Some(step),
            _ => None,
        }
    }

    /// Whether hello is still going on.
    #[must_use]
    pub const fn is_greeting(&self) -> bool {
        matches!(self.state, State::AwaitHello | State::AwaitReady { .. })
    }

    /// Whether the run is over, either way.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        matches!(self.state, State::Over)
    }

    /// Frames of steps long past that were passed over.
    #[must_use]
    pub const fn ignored(&self) -> u64 {
        self.ignored
    }

    /// The step in work, for messages.
    #[must_use]
    pub const fn at(&self) -> Step {
        match self.state {
            State::Between(step) | State::AwaitCommand(step) => step,
            State::AwaitHello | State::AwaitReady { .. } => self.first,
            State::AwaitConfirmation | State::Over => Step(self.steps),
        }
    }

    /// Takes an event and says what to do.
    pub fn on(&mut self, event: &PlantEvent<'_>) -> PlantAction {
        match (&self.state, event) {
            (State::Over, _) => PlantAction::Ignore,
            (_, PlantEvent::Stop) => self.abort(Abort::Stopped { at: self.at() }),
            (_, PlantEvent::PeerGone) => self.abort(Abort::Gone {
                peer: PEER,
                at: self.at(),
            }),

            (State::AwaitHello, PlantEvent::Hello(hello, offer)) => match agree(hello, offer) {
                Ok(welcome) => {
                    self.state = State::AwaitReady {
                        epoch: welcome.epoch,
                    };
                    PlantAction::Welcome(Box::new(welcome))
                }
                Err(refused) => {
                    self.state = State::Over;
                    PlantAction::Refuse(refused.to_string())
                }
            },
            (State::AwaitReady { epoch }, PlantEvent::Ready(ready)) if ready == epoch => {
                self.state = State::Between(self.first);
                PlantAction::Ignore
            }

            (State::Between(step), PlantEvent::Release) if step.0 < self.steps => {
                let step = *step;
                self.state = State::AwaitCommand(step);
                PlantAction::SendSample(step)
            }
            (State::Between(_), PlantEvent::Release) => {
                self.state = State::AwaitConfirmation;
                PlantAction::SendEnd(Step(self.steps))
            }

            (State::AwaitCommand(step), PlantEvent::Missed) if self.against_clock => {
                let step = *step;
                self.state = State::Between(step.next());
                PlantAction::Hold(step)
            }

            (_, PlantEvent::Frame(header)) => self.on_frame(header),

            (State::AwaitHello, PlantEvent::Deadline(ms)) => self.late("say hello".into(), *ms),
            (State::AwaitReady { .. }, PlantEvent::Deadline(ms)) => {
                self.late("open its frames".into(), *ms)
            }
            (State::AwaitCommand(step), PlantEvent::Deadline(ms)) => {
                let what = format!("answer step {step}");
                self.late(what, *ms)
            }
            (State::AwaitConfirmation, PlantEvent::Deadline(ms)) => {
                self.late(format!("confirm the end after {} steps", self.steps), *ms)
            }
            // Nothing is awaited from the controller between steps.
            (State::Between(_), PlantEvent::Deadline(_)) => PlantAction::Ignore,

            (
                _,
                PlantEvent::Hello(..)
                | PlantEvent::Ready(_)
                | PlantEvent::Release
                | PlantEvent::Missed,
            ) => self.ignore(),
        }
    }

    fn on_frame(&mut self, header: &Header) -> PlantAction {
        let got = Step(header.step);
        match (&self.state, header.kind()) {
            (_, Some(FrameKind::Abort)) => {
                let code = AbortCode::from_wire(header.directive);
                self.abort(Abort::ByPeer {
                    peer: PEER,
                    at: self.at(),
                    code,
                })
            }
            (State::AwaitCommand(step), Some(FrameKind::Command)) if got == *step => {
                self.state = State::Between(got.next());
                PlantAction::Apply(got)
            }
            (State::AwaitConfirmation, Some(FrameKind::EndConfirmed)) => {
                if got.0 == self.steps {
                    self.state = State::Over;
                    PlantAction::Finish
                } else {
                    let what = format!("it executed {got} steps of {}", self.steps);
                    self.broken(what)
                }
            }
            (State::AwaitCommand(step), Some(FrameKind::Command))
                if self.against_clock && got < *step =>
            {
                PlantAction::Keep
            }
            // A command that was sent before, seen again.
            (_, Some(FrameKind::Command)) if got.0 < self.at().0 => self.ignore(),
            (_, kind) => {
                let name = kind.map_or_else(|| "a frame of no kind".into(), |k| format!("{k:?}"));
                self.broken(format!("unexpected {name} of step {got}"))
            }
        }
    }

    fn ignore(&mut self) -> PlantAction {
        self.ignored += 1;
        PlantAction::Ignore
    }

    fn late(&mut self, what: String, limit_ms: u64) -> PlantAction {
        self.abort(Abort::Late {
            peer: PEER,
            what,
            limit_ms,
        })
    }

    fn broken(&mut self, what: String) -> PlantAction {
        self.abort(Abort::Protocol {
            peer: PEER,
            at: self.at(),
            what,
        })
    }

    fn abort(&mut self, abort: Abort) -> PlantAction {
        self.state = State::Over;
        PlantAction::Abort(abort)
    }
}
