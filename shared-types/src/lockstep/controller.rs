//! The controller's side of lockstep.

use super::{Abort, AbortCode, Standing};
use crate::frame::{FrameKind, Header};
use crate::hello::{Control, Hello, Welcome};
use crate::time::Step;

const PEER: &str = "plant";

/// Event at the controller's side.
#[derive(Debug)]
pub enum ControllerEvent<'a> {
    /// Link established; begin with this hello.
    Begin(&'a Hello),
    /// Control message received.
    Control(&'a Control),
    /// Frames opened on this side.
    Opened,
    /// Frame received that passed the link's checks.
    Frame(&'a Header),
    /// End of the bounded wait of N ms.
    Deadline(u64),
    /// End of the plant's process.
    PeerGone,
    /// Request to stop the run.
    Stop,
}

/// Next action of the controller's side.
#[derive(Debug, PartialEq)]
pub enum ControllerAction {
    /// Do nothing; the event is irrelevant.
    Ignore,
    /// Send the hello.
    SendHello,
    /// Open the frames as welcomed.
    OpenFrames(Box<Welcome>),
    /// Send ready for this epoch.
    SendReady(u32),
    /// Compute and send the command that answers the sample of this step.
    Answer(Step),
    /// Confirm the end after N steps; the run is over.
    ConfirmEnd(Step),
    /// Inform the plant (unless it is gone) and end.
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
    /// Nothing exchanged yet. Steps before the first sample belonged to a previous controller, if any.
    AwaitFirst(Step),
    AwaitSample(Step),
    Over,
}

impl State {
    /// Unique number of the state, regardless of its step.
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

/// The controller's side: sends hello, answers every sample, confirms the end.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerSide {
    state: State,
    against_clock: bool,
    /// `true` if this controller replaces a previous one.
    takes_over: bool,
    ignored: u64,
}

impl Default for ControllerSide {
    fn default() -> Self {
        Self::new()
    }
}

impl ControllerSide {
    /// Creates a side in its initial state.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Start,
            against_clock: false,
            takes_over: false,
            ignored: 0,
        }
    }

    /// Returns `true` while frames are not flowing yet.
    #[must_use]
    pub const fn is_greeting(&self) -> bool {
        !matches!(
            self.state,
            State::AwaitFirst(_) | State::AwaitSample(_) | State::Over
        )
    }

    /// Returns `true` if the run is over, completed or not.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        matches!(self.state, State::Over)
    }

    /// Returns `true` if frames may flow but none has arrived yet.
    #[must_use]
    pub const fn awaits_first(&self) -> bool {
        matches!(self.state, State::AwaitFirst(_))
    }

    /// Returns the number of ignored frames of past steps.
    #[must_use]
    pub const fn ignored(&self) -> u64 {
        self.ignored
    }

    /// Returns the progress of this side with the plant.
    #[must_use]
    pub const fn standing(&self) -> Standing {
        Standing([self.state.number(), self.at().0, 0, 0, 0])
    }

    /// Returns the awaited step, for messages.
    #[must_use]
    pub const fn at(&self) -> Step {
        match self.state {
            State::AwaitFirst(step) | State::AwaitSample(step) => step,
            _ => Step(0),
        }
    }

    /// Processes an event and returns the resulting action.
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
        let frame_step = Step(header.step);
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
                if frame_step == *step || (may_be_later && frame_step > *step) =>
            {
                self.state = State::AwaitSample(frame_step.next());
                ControllerAction::Answer(frame_step)
            }
            (State::AwaitFirst(step) | State::AwaitSample(step), Some(FrameKind::End)) => {
                if frame_step == *step || (may_be_later && frame_step > *step) {
                    self.state = State::Over;
                    ControllerAction::ConfirmEnd(frame_step)
                } else {
                    let what =
                        format!("it ends after {frame_step} steps, but {step} were executed here");
                    self.broken(what)
                }
            }
            // The run is paused: restart the wait for the same sample.
            (_, Some(FrameKind::Hold)) if frame_step.0 <= self.at().0 || may_be_later => {
                ControllerAction::Ignore
            }
            // A duplicate of a sample that was answered already.
            (_, Some(FrameKind::Sample)) if frame_step.0 < self.at().0 => self.ignore(),
            (_, kind) => {
                let name =
                    kind.map_or_else(|| "a frame of an unknown kind".into(), |k| format!("{k:?}"));
                self.broken(format!("unexpected {name} of step {frame_step}"))
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

    /// Complete state, which determines further behaviour; comparable between sides that send the same hello.
    #[cfg(test)]
    pub(super) fn key(&self) -> [u64; 3] {
        let step = match self.state {
            State::Opening { first, .. } => first,
            _ => self.at(),
        };
        [self.state.number(), step.0, u64::from(self.takes_over)]
    }
}
