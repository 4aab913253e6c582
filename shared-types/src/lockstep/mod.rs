//! The lockstep protocol as two state machines without input or output.
//!
//! Each machine receives an event (a frame arrived, time is up, the peer is gone) and returns a single action. It has
//! no access to a clock, a link or a signal value, so every interleaving can be tested without a transport. The plant's
//! engine and the controller's runner drive the machines.
//!
//! ```text
//! controller            plant
//!   hello      ------>
//!              <------  welcome (or refusal)
//!   ready      ------>
//!              <------  sample 0
//!   command 0  ------>            integrate to 1, publish record 0
//!              <------  sample 1
//!   ...
//!              <------  end N     both have executed steps 0 to N - 1
//!   confirmed N ----->
//! ```
//!
//! A lost controller may be replaced during the run ([`OnLoss`]). Each controller has its own epoch, a number that
//! every frame carries, so that no message of the old controller is mistaken for one of the new. A candidate is greeted
//! while the active controller continues, and takes over once it is ready.
//!
//! In real time the plant does not wait for a command beyond its deadline: it continues with the newest command it has,
//! and a late controller receives a later sample.
//!
//! A wait restarts when the [`Standing`] of a side changes, not whenever a message arrives: a message without effect
//! counts as silence, so no peer can extend a wait beyond its limit.

mod controller;
mod loss;
mod plant;

pub use controller::{ControllerAction, ControllerEvent, ControllerSide};
pub use loss::OnLoss;
pub use plant::{PlantAction, PlantEvent, PlantSide};

use crate::time::Step;

/// Progress that a side has made with the other side. If a side has the same standing at two times, nothing that
/// arrived in between advanced the run, whatever the side answered: the wait has not restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing([u64; 5]);

/// Reason why a side aborted, as sent to the other side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u64)]
pub enum AbortCode {
    /// Stop request.
    Stopped = 1,
    /// Timeout of the other side.
    Late = 2,
    /// Other side is gone.
    Gone = 3,
    /// Protocol violation by the other side.
    Protocol = 4,
    /// The plant left its range of validity.
    Diverged = 5,
    /// Command or sample that is not a number.
    NotANumber = 6,
    /// Recorder of the run that is stuck or gone.
    Observer = 7,
    /// Another reason, given in the log of the side that aborted.
    Other = 8,
    /// Step overran, and the policy is to end the run.
    Overrun = 9,
    /// Another controller took over.
    Replaced = 10,
}

impl AbortCode {
    /// Decodes a wire number; unknown ones are [`AbortCode::Other`].
    #[must_use]
    #[inline]
    pub const fn from_wire(number: u64) -> Self {
        match number {
            1 => Self::Stopped,
            2 => Self::Late,
            3 => Self::Gone,
            4 => Self::Protocol,
            5 => Self::Diverged,
            6 => Self::NotANumber,
            7 => Self::Observer,
            9 => Self::Overrun,
            10 => Self::Replaced,
            _ => Self::Other,
        }
    }
}

/// Reason why a lockstep run ended before its last step.
#[derive(Clone, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Abort {
    /// Stop request.
    #[error("stopped at step {at}")]
    Stopped {
        /// Current step.
        at: Step,
    },
    /// Timeout of the other side.
    #[error("{peer} did not {what} within {} s", *limit_ms as f64 / 1e3)]
    Late {
        /// Name of the other side.
        peer: &'static str,
        /// Awaited action.
        what: String,
        /// Time limit, in ms.
        limit_ms: u64,
    },
    /// Other side is gone.
    #[error("{peer} is gone at step {at}")]
    Gone {
        /// Name of the other side.
        peer: &'static str,
        /// Current step.
        at: Step,
    },
    /// Protocol violation by the other side.
    #[error("{peer} broke the protocol at step {at}: {what}")]
    Protocol {
        /// Name of the other side.
        peer: &'static str,
        /// Current step.
        at: Step,
        /// Description of the violation.
        what: String,
    },
    /// Refusal at hello.
    #[error("refused: {0}")]
    Refused(String),
    /// Internal failure of this side.
    #[error("{0}")]
    Failed(String),
    /// Abort by the other side.
    #[error("{peer} gave up at step {at}: {}", describe(*code))]
    ByPeer {
        /// Name of the other side.
        peer: &'static str,
        /// Current step.
        at: Step,
        /// Reason given by the other side.
        code: AbortCode,
    },
}

const fn describe(code: AbortCode) -> &'static str {
    match code {
        AbortCode::Stopped => "it was asked to stop",
        AbortCode::Late => "it waited too long for this side",
        AbortCode::Gone => "this side was gone",
        AbortCode::Protocol => "this side broke the protocol",
        AbortCode::Diverged => "the plant left its range of validity",
        AbortCode::NotANumber => "a signal was not a number",
        AbortCode::Observer => "the recorder is stuck or gone",
        AbortCode::Overrun => "a step overran",
        AbortCode::Replaced => "another controller took this one's place",
        AbortCode::Other => "see its log",
    }
}

impl Abort {
    /// Returns the reason code sent to the other side.
    #[must_use]
    pub const fn code(&self) -> AbortCode {
        match self {
            Self::Stopped { .. } => AbortCode::Stopped,
            Self::Late { .. } => AbortCode::Late,
            Self::Gone { .. } => AbortCode::Gone,
            Self::Protocol { .. } => AbortCode::Protocol,
            Self::Refused(_) | Self::Failed(_) | Self::ByPeer { .. } => AbortCode::Other,
        }
    }
}

#[cfg(test)]
mod chatter;
#[cfg(test)]
mod explorer;
#[cfg(test)]
mod tests;
