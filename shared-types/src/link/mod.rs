//! The link between plant and controller: a transport for frames and for the few control messages before step 0.
//!
//! A link moves bytes and has no notion of steps; the [lockstep machines](crate::lockstep) handle steps and have no
//! notion of links. Two implementations exist: iceoryx2 shared memory between processes, and a pair of mailboxes within
//! one thread. Both pass a public suite, [`conformance`](mod@crate::conformance). Your own `impl Link`
//! (`docs/own-link.md`, `examples/unix-socket-link`) must pass it too; a controller on a target needs none.

pub mod in_process;
mod pass_on;

use crate::frame::{FrameIdentity, Header};
use crate::hello::Control;
use crate::ignored::Ignored;
use crate::wait::Sleeper;

/// End of a link, on one side. No method ever blocks.
///
/// 1. Both sides exchange control messages until they agree on the layout of frames.
/// 2. Both call [`open_frames`](Link::open_frames), the plant first.
/// 3. Frames flow. A newer frame replaces an older one that was not received: the link holds the latest state, not a
///    queue.
/// 4. The plant may [`expect`](Link::expect) another controller: from then on control messages go to and come from that
///    one, while the frames of the active controller continue until the plant calls [`take_over`](Link::take_over).
///    Until then the plant can still [`tell`](Link::tell) the active one.
pub trait Link {
    /// Sends a control message.
    ///
    /// # Errors
    /// If the transport failed.
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError>;

    /// Sends a control message as [`send_control`](Link::send_control) does, which it calls by default; a link within
    /// one thread need not write it out.
    ///
    /// # Errors
    /// As of [`send_control`](Link::send_control).
    fn send_message(&mut self, message: Control) -> Result<(), LinkError> {
        self.send_control(&message.to_bytes())
    }

    /// Sends a control message to the controller whose frames are in use, even while another controller is expected.
    /// For the plant.
    ///
    /// # Errors
    /// If the transport failed.
    fn tell(&mut self, message: &[u8]) -> Result<(), LinkError>;

    /// Receives the next control message, if any.
    ///
    /// # Errors
    /// If the transport failed.
    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError>;

    /// Receives the next control message as [`receive_control`](Link::receive_control) does, which it calls by default;
    /// `None` in place of a message that cannot be read.
    ///
    /// # Errors
    /// As of [`receive_control`](Link::receive_control).
    fn receive_message(&mut self) -> Result<Option<Option<Control>>, LinkError> {
        let bytes = self.receive_control()?;
        Ok(bytes.map(|bytes| Control::from_bytes(&bytes).ok()))
    }

    /// Creates a control channel for the controller of this epoch, replacing the current channel. For the plant.
    ///
    /// # Errors
    /// If the transport failed.
    fn expect(&mut self, epoch: u32) -> Result<(), LinkError>;

    /// Identifies the peer on the control channel and on the frames opened last: the process launched as the
    /// controller, or another process. For the plant.
    ///
    /// # Errors
    /// If the peer cannot be determined.
    fn peer(&self) -> Result<Peer, LinkError>;

    /// Opens the frame channels for N values in each direction. They are used immediately if no others are in use,
    /// otherwise from [`take_over`](Link::take_over) on.
    ///
    /// # Errors
    /// If the transport failed or the other side opened another layout.
    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError>;

    /// Switches to the frame channels that were opened last and drops the old ones.
    fn take_over(&mut self);

    /// Sends a frame; the link fills in session, layout, epoch, sequence and count. Validity bits beyond
    /// the values may be lost.
    ///
    /// # Errors
    /// If the frame channels are not open or the transport failed.
    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError>;

    /// Receives the latest unread frame and copies its values into `values`. A frame that fails a check is not
    /// delivered; it is counted in [`rejected`](Link::rejected).
    ///
    /// # Errors
    /// If the frame channels are not open or the transport failed.
    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError>;

    /// Returns the counts of received frames that were rejected.
    fn rejected(&self) -> Ignored;

    /// Returns a sleeper that wakes when the other side sends a frame or a control message; `None` if sends wake
    /// nobody, so that waits must poll with short sleeps.
    fn sleeper(&self) -> Option<Box<dyn Sleeper>> {
        None
    }
}

/// Mutable reference to an end, usable by a shorter-lived owner.
impl<L: Link> Link for &mut L {
    crate::pass_on!(self => **self; send_control send_message tell receive_control receive_message expect peer open_frames take_over send receive rejected sleeper);
}

/// Process at the controller's end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Peer {
    /// The process that was launched as the controller.
    Launched,
    /// Unknown: the process launched as the controller is not recorded yet.
    Unknown,
    /// Another process, with a description.
    Stranger(String),
}

/// Specification with which the frame channels are opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSpec {
    /// Header fields that every frame carries.
    pub identity: FrameIdentity,
    /// Values in a frame that this side sends.
    pub outgoing: usize,
    /// Values in a frame that this side receives.
    pub incoming: usize,
}

/// Failure of a transport.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// Service that does not exist (yet).
    #[error("{service} does not exist: {reason}")]
    Absent {
        /// Name of the service.
        service: String,
        /// Reason that the transport gave.
        reason: String,
    },
    /// Service that exists, but with other properties than agreed.
    #[error("{service} does not belong to this session: {reason}")]
    Foreign {
        /// Name of the service.
        service: String,
        /// Difference from what was agreed.
        reason: String,
    },
    /// Role that another process already occupies.
    #[error("the session already has its {role} ({service})")]
    Taken {
        /// Name of the service.
        service: String,
        /// Occupied role.
        role: &'static str,
    },
    /// Refusal by the operating system or the transport.
    #[error("{service}: {reason}")]
    Transport {
        /// Name of the service.
        service: String,
        /// Reason given by the operating system or the transport.
        reason: String,
    },
    /// More signals in one direction than the largest frame carries.
    #[error("{0} signals in one direction; a frame carries at most 512")]
    TooManySignals(usize),
    /// Frames used before [`Link::open_frames`].
    #[error("the frame channels are not open")]
    NotOpen,
}
