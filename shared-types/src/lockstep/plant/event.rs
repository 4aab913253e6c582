//! Events at the plant's side, and the resulting actions.

use super::super::Abort;
use crate::frame::Header;
use crate::hello::{Hello, Offer, Welcome};
use crate::ignored::Reason;
use crate::time::Step;

/// Event at the plant's side.
#[derive(Debug)]
pub enum PlantEvent<'a> {
    /// Announcement of the controller of this epoch by the launcher.
    Expect(u32),
    /// Hello received, with the plant's offer.
    Hello(&'a Hello, &'a Offer<'a>),
    /// Frames of this epoch opened by the controller.
    Ready(u32),
    /// Release of the next step by the clock.
    Release,
    /// Frame received that passed the link's checks.
    Frame(&'a Header),
    /// Ignored frame that contradicts the accepted command of this step.
    Contradiction(Step),
    /// Missing command of this step: in real time it missed its deadline, or there is no controller.
    Missed,
    /// End of the bounded wait of N ms for the active controller.
    Deadline(u64),
    /// End of the same wait for the announced controller.
    CandidateLate(u64),
    /// End of the process of this epoch's controller.
    PeerGone(u32),
    /// Request to stop the run.
    Stop,
}

/// Next action of the plant's side.
#[derive(Debug, PartialEq)]
pub enum PlantAction {
    /// Do nothing.
    Nothing,
    /// Do nothing: a message or frame of the controller is ignored.
    Ignore(Reason),
    /// Create a control channel for the controller of this epoch.
    Expect(u32),
    /// Open the frames, then send this welcome.
    Welcome(Box<Welcome>),
    /// Send a refusal with this reason; the run is over.
    Refuse(String),
    /// Send a refusal with this reason to the announced controller; the run continues without it.
    Dismiss(Abort),
    /// Activate the announced controller: inform the old one, use the new frames, and resend the sample of this step,
    /// if any.
    TakeOver(Option<Step>),
    /// Send the sample of this step.
    SendSample(Step),
    /// Apply the command just received to this step, integrate, publish the record.
    Apply(Step),
    /// Store the command just received, although it belongs to an earlier step: it is now the latest.
    Keep,
    /// Apply the newest available command to this step, integrate, publish the record.
    Hold(Step),
    /// Send the end after N steps.
    SendEnd(Step),
    /// Finish: both sides executed every step, or the plant alone after losing its controller.
    Finish,
    /// Report the loss of the controller to observers; the run continues without it.
    Lose(Abort),
    /// Inform the controller (unless it is gone) and end.
    Abort(Abort),
}
