//! Events at the plant's side, and the action that each is answered with.

use super::super::Abort;
use crate::frame::Header;
use crate::hello::{Hello, Offer, Welcome};
use crate::ignored::Reason;
use crate::time::Step;

/// Event at the plant's side.
#[derive(Debug)]
pub enum PlantEvent<'a> {
    /// The launcher announces the controller of this epoch.
    Expect(u32),
    /// A hello came; what the plant offers in return.
    Hello(&'a Hello, &'a Offer<'a>),
    /// The controller opened the frames of this epoch.
    Ready(u32),
    /// The clock releases the next step.
    Release,
    /// A frame came that passed the link's checks.
    Frame(&'a Header),
    /// A frame that was passed over says something else than the command of this step that was taken.
    Contradiction(Step),
    /// No command for this step comes in time: it missed its deadline, in real time, or there
    /// is no controller.
    Missed,
    /// The bounded wait for the active controller, N ms long, is over.
    Deadline(u64),
    /// The same wait for the controller that was announced is over.
    CandidateLate(u64),
    /// The process of the controller of this epoch ended.
    PeerGone(u32),
    /// Somebody wants the run to end.
    Stop,
}

/// Next action of the plant's side.
#[derive(Debug, PartialEq)]
pub enum PlantAction {
    /// Nothing.
    Nothing,
    /// Nothing: a message or frame of the controller is passed over.
    Ignore(Reason),
    /// Make a control channel for the controller of this epoch.
    Expect(u32),
    /// Open the frames, then send this welcome.
    Welcome(Box<Welcome>),
    /// Send a refusal with this reason; the run is over.
    Refuse(String),
    /// Send a refusal with this reason to the controller that was announced; the run goes on
    /// without it.
    Dismiss(Abort),
    /// The controller that was announced is active: tell the old one, use the new frames, and send
    /// the sample of this step once more if there is one.
    TakeOver(Option<Step>),
    /// Send the sample of this step.
    SendSample(Step),
    /// Apply the command that just came to this step, integrate, publish the record.
    Apply(Step),
    /// Keep the command that just came, of an earlier step: it is the newest now.
    Keep,
    /// Apply the newest command there is to this step, integrate, publish the record.
    Hold(Step),
    /// Send the end after N steps.
    SendEnd(Step),
    /// Every step was executed: by both sides, or by the plant alone if its controller was lost.
    Finish,
    /// The controller is lost and the run goes on without it: tell observers.
    Lose(Abort),
    /// Tell the controller (unless it is gone) and end.
    Abort(Abort),
}
