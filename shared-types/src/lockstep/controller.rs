//! The controller's side of lockstep.

use super::{Abort, AbortCode, Standing};
use crate::frame::{FrameKind, Header};
use crate::hello::{Control, Hello, Welcome};
use crate::time::Step;

const PEER: &str = "plant";

/// Event at the controller's side.
#[derive(Debug)]
pub enum ControllerEvent<'a> {
    /// The link is there; begin with this hello.
    Begin(&'a Hello),
    /// A control message came.
    Control(&'a Control),
    /// The frames are open on this side.
    Opened,
    /// A frame came that passed the link's checks.
    Frame(&'a Header),
    /// The bounded wait, N ms long, is over.
    Deadline(u64),
    /// The plant's process ended.
    PeerGone,
    /// Somebody wants the run to end.
    Stop,
}

/// Next action of the controller's side.
#[derive(Debug, PartialEq)]
pub enum ControllerAction {
    /// Nothing; the event changes nothing.
    Ignore,
    /// Send the hello.
    SendHello,
    /// Open the frames as welcomed.
    OpenFrames(Box<Welcome>),
    /// Say ready for this epoch.
    SendReady(u32),
    /// Compute the command that answers the sample of this step and send it.
    Answer(Step),
    /// Confirm the end after N steps; the run is over.
    ConfirmEnd(Step),
    /// Tell the plant (unless it is gone) and end.
    Abort(Abort),
}

#[derive(Clone, Debug, PartialEq)]
enum State {
    Start,
    AwaitWelcome(Box<Hello>),
    Opening {
        epoch: u32,
        first: Step,
    },
    /// Nothing was exchanged yet. Steps before the first sample belonged to another controller, if
    /// there was one.
    AwaitFirst(Step),
    AwaitSample(Step),
    Over,
}

impl State {
    /// A number of its own for each but the step.
    const fn number(&self) -> u64 {
        match self {
            Self::Start => 0,
            Self::AwaitWelcome(_) => 1,
            Self::Opening { .. } => 2,
            Self::AwaitFirst(_) => 3,
            Self::AwaitSample(_) => 4,
            Self::Over => 5,
        }
    }
}

/// The controller's side: says hello, answers every sample, confirms the end.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerSide {
    state: State,
    against_clock: bool,
    /// There was another controller before.
    takes_over: bool,
    ignored: u64,
}

impl Default for ControllerSide {
    fn default() -> Self {
        Self::new()
    }
}

impl ControllerSide {
    /// A side at its start.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Start,
            against_clock: false,
            takes_over: false,
            ignored: 0,
        }
    }

    /// Checks whether frames are not flowing yet.
    #[must_use]
    pub const fn is_greeting(&self) -> bool {
        !matches!(
            self.state,
            State::AwaitFirst(_) | State::AwaitSample(_) | State::Over
        )
    }

    /// Checks whether the run is over, either way.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        matches!(self.state, State::Over)
    }

    /// Checks whether frames may flow and none came yet.
    #[must_use]
    pub const fn awaits_first(&self) -> bool {
        matches!(self.state, State::AwaitFirst(_))
    }

    /// Frames of steps long past that were passed over.
    #[must_use]
    pub const fn ignored(&self) -> u64 {
        self.ignored
    }

    /// Returns how far this side has come with the plant.
    #[must_use]
    pub const fn standing(&self) -> Standing {
        Standing([self.state.number(), self.at().0, 0, 0, 0])
    }

    /// The step awaited, for messages.
    #[must_use]
    pub const fn at(&self) -> Step {
        match self.state {
            State::AwaitFirst(step) | State::AwaitSample(step) => step,
            _ => Step(0),
        }
    }

    /// Takes an event and says what to do.
    pub fn on(&mut self, event: &ControllerEvent<'_>) -> ControllerAction {
        match (&self.state, event) {
            (State::Over, _) => ControllerAction::Ignore,
            (_, ControllerEvent::Stop) => self.abort(Abort::Stopped { at: self.at() }),
            (_, ControllerEvent::PeerGone) => self.abort(Abort::Gone {
                peer: PEER,
                at: self.at(),
            }),

            (State::Start, ControllerEvent::Begin(hello)) => {
                self.state = State::AwaitWelcome(Box::new((*hello).clone()));
                ControllerAction::SendHello
            }
            (State::AwaitWelcome(hello), ControllerEvent::Control(Control::Welcome(welcome))) => {
                match welcome.check(hello) {
                    Ok(()) => {
                        self.against_clock = welcome.against_clock;
                        self.takes_over = welcome.epoch > 1;
                        self.state = State::Opening {
                            epoch: welcome.epoch,
                            first: welcome.first,
                        };
                        ControllerAction::OpenFrames(welcome.clone())
                    }
                    Err(refused) => self.abort(Abort::Refused(refused.to_string())),
                }
            }
            (State::AwaitWelcome(_), ControllerEvent::Control(Control::Refusal { reason })) => {
                self.abort(Abort::Refused(reason.clone()))
            }
            (State::Opening { epoch, first }, ControllerEvent::Opened) => {
                let (epoch, first) = (*epoch, *first);
                self.state = State::AwaitFirst(first);
                ControllerAction::SendReady(epoch)
            }

            (_, ControllerEvent::Frame(header)) => self.on_frame(header),

            (State::AwaitFirst(step) | State::AwaitSample(step), ControllerEvent::Deadline(ms)) => {
                let what = format!("send step {step}");
                self.late(what, *ms)
            }
            (State::Start, ControllerEvent::Deadline(ms)) => {
                self.late("create the session's link".into(), *ms)
            }
            (State::AwaitWelcome(_), ControllerEvent::Deadline(ms)) => {
                self.late("answer hello".into(), *ms)
            }
            // Opening is this side's own work.
            (State::Opening { .. }, ControllerEvent::Deadline(_)) => ControllerAction::Ignore,

            (
                _,
                ControllerEvent::Begin(_) | ControllerEvent::Control(_) | ControllerEvent::Opened,
            ) => self.ignore(),
        }
    }

    fn on_frame(&mut self, header: &Header) -> ControllerAction {
        let got = Step(header.step);
        let may_be_later = self.against_clock || (self.awaits_first() && self.takes_over);
        match (&self.state, header.kind()) {
            (_, Some(FrameKind::Abort)) => {
                let code = AbortCode::from_wire(header.directive);
                self.abort(Abort::ByPeer {
                    peer: PEER,
                    at: self.at(),
                    code,
                })
            }
            (State::AwaitFirst(step) | State::AwaitSample(step), Some(FrameKind::Sample))
                if got == *step || (may_be_later && got > *step) =>
            {
                self.state = State::AwaitSample(got.next());
                ControllerAction::Answer(got)
            }
            (State::AwaitFirst(step) | State::AwaitSample(step), Some(FrameKind::End)) => {
                if got == *step || (may_be_later && got > *step) {
                    self.state = State::Over;
                    ControllerAction::ConfirmEnd(got)
                } else {
                    let what = format!("it ends after {got} steps, {step} were executed here");
                    self.broken(what)
                }
            }
            // The run is paused: the wait for the same sample begins anew.
            (_, Some(FrameKind::Hold)) if got.0 <= self.at().0 || may_be_later => {
                ControllerAction::Ignore
            }
            // A sample that was answered already, seen again.
            (_, Some(FrameKind::Sample)) if got.0 < self.at().0 => self.ignore(),
            (_, kind) => {
                let name = kind.map_or_else(|| "a frame of no kind".into(), |k| format!("{k:?}"));
                self.broken(format!("unexpected {name} of step {got}"))
            }
        }
    }

    fn ignore(&mut self) -> ControllerAction {
        self.ignored += 1;
        ControllerAction::Ignore
    }

    fn late(&mut self, what: String, limit_ms: u64) -> ControllerAction {
        self.abort(Abort::Late {
            peer: PEER,
            what,
            limit_ms,
        })
    }

    fn broken(&mut self, what: String) -> ControllerAction {
        self.abort(Abort::Protocol {
            peer: PEER,
            at: self.at(),
            what,
        })
    }

    fn abort(&mut self, abort: Abort) -> ControllerAction {
        self.state = State::Over;
        ControllerAction::Abort(abort)
    }

    /// All that decides what it does next, of one that says the same hello as the others.
    #[cfg(test)]
    pub(super) fn key(&self) -> [u64; 3] {
        let step = match self.state {
            State::Opening { first, .. } => first,
            _ => self.at(),
        };
        [self.state.number(), step.0, u64::from(self.takes_over)]
    }
}
