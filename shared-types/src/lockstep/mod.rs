//! The lockstep protocol as two state machines without input or output.
//!
//! Each machine is told what happened (a frame came, time is up, the peer is gone) and answers with
//! the one thing to do. It knows no clock, no link and no number of a model, so every interleaving
//! can be tested without a transport. The plant's engine and the controller's runner drive them.
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
//! A controller that is lost may be replaced while the run goes on ([`OnLoss`]): each has an epoch of
//! its own, a number that every frame carries, so that nothing of the old one is ever taken for the
//! new one's. Another is greeted beside the active one, which goes on until it is ready.
//!
//! In real time the plant does not wait for a command beyond its deadline: it goes on with the
//! newest one that it has, and a controller that comes late finds a later sample.
//!
//! A wait begins anew when the [`Standing`] of a side moves, and not when something comes: what moves
//! nothing is as good as silence, so nobody can talk a wait beyond its limit.

mod controller;
mod loss;
mod plant;

pub use controller::{ControllerAction, ControllerEvent, ControllerSide};
pub use loss::OnLoss;
pub use plant::{PlantAction, PlantEvent, PlantSide};

use crate::time::Step;

/// Progress that a side has made with the other one. If two standings of one side are equal, nothing that
/// came between them got the run on, whatever the side answered: the wait of the first is still the wait of
/// the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing([u64; 5]);

/// Reason for which a side gave up, as it is told to the other side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u64)]
pub enum AbortCode {
    /// Asked to stop.
    Stopped = 1,
    /// The other side did not answer in time.
    Late = 2,
    /// The other side is gone.
    Gone = 3,
    /// The other side broke the protocol.
    Protocol = 4,
    /// The plant left its range of validity.
    Diverged = 5,
    /// A command or sample was not a number.
    NotANumber = 6,
    /// The observer that records the run is stuck or gone.
    Observer = 7,
    /// Something else; the log of the side that gave up tells.
    Other = 8,
    /// A step overran, and the policy is to end the run.
    Overrun = 9,
    /// Another controller took its place.
    Replaced = 10,
}

impl AbortCode {
    /// The code of a number on the wire; unknown ones are [`AbortCode::Other`].
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

/// Reason for which a lockstep run ended before its last step.
#[derive(Clone, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Abort {
    /// Asked to stop.
    #[error("stopped at step {at}")]
    Stopped {
        /// The step in work.
        at: Step,
    },
    /// The other side did not say what was awaited in time.
    #[error("{peer} did not {what} within {} s", *limit_ms as f64 / 1e3)]
    Late {
        /// Name of the other side.
        peer: &'static str,
        /// Action that was awaited.
        what: String,
        /// Time that the other side was given, in ms.
        limit_ms: u64,
    },
    /// The other side is gone.
    #[error("{peer} is gone at step {at}")]
    Gone {
        /// Name of the other side.
        peer: &'static str,
        /// The step in work.
        at: Step,
    },
    /// The other side broke the protocol.
    #[error("{peer} broke the protocol at step {at}: {what}")]
    Protocol {
        /// Name of the other side.
        peer: &'static str,
        /// The step in work.
        at: Step,
        /// Way in which the protocol was broken.
        what: String,
    },
    /// The two sides do not come together.
    #[error("refused: {0}")]
    Refused(String),
    /// Failure of this side, which cannot go on for a reason of its own.
    #[error("{0}")]
    Failed(String),
    /// The other side gave up.
    #[error("{peer} gave up at step {at}: {}", describe(*code))]
    ByPeer {
        /// Name of the other side.
        peer: &'static str,
        /// The step in work.
        at: Step,
        /// Reason that the other side gave.
        code: AbortCode,
    },
}

const fn describe(code: AbortCode) -> &'static str {
    match code {
        AbortCode::Stopped => "it was asked to stop",
        AbortCode::Late => "it found this side late",
        AbortCode::Gone => "it found this side gone",
        AbortCode::Protocol => "it found the protocol broken",
        AbortCode::Diverged => "the plant left its range of validity",
        AbortCode::NotANumber => "a signal was not a number",
        AbortCode::Observer => "the recorder is stuck or gone",
        AbortCode::Overrun => "a step overran",
        AbortCode::Replaced => "another controller took this one's place",
        AbortCode::Other => "see its log",
    }
}

impl Abort {
    /// Returns the reason that the other side is told.
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
