//! The link between plant and controller: a transport for frames and for the few control messages
//! before step 0.
//!
//! A link moves bytes and knows nothing of steps; the [lockstep machines](crate::lockstep) know
//! steps and nothing of links. Two implementations: a pair of mailboxes
//! within one thread, and iceoryx2 shared memory between processes, in `hil-session`. Both pass a public suite, [`conformance`](mod@crate::conformance). Another
//! is an `impl Link` of your own (`docs/own-link.md`, `examples/unix-socket-link`) and must pass it too; a
//! controller on a target needs none.

pub mod in_process;
mod pass_on;

use crate::frame::{FrameIdentity, Header};
use crate::ignored::Ignored;
use crate::wait::Sleeper;

/// End of a link, on one side. No method ever blocks.
///
/// 1. Both sides exchange control messages until they agree on the layout of frames.
/// 2. Both call [`open_frames`](Link::open_frames), the plant first.
/// 3. Frames flow. A newer frame replaces an older one that was not received: the link holds the
///    latest state, not a queue.
/// 4. The plant may [`expect`](Link::expect) another controller: control messages are its from then
///    on, while the frames of the active one go on until the plant calls
///    [`take_over`](Link::take_over). Until then the plant can still [`tell`](Link::tell) the active one.
pub trait Link {
    /// Sends a control message.
    ///
    /// # Errors
    /// If the transport failed.
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError>;

    /// Sends a control message to the controller whose frames are in use, also while another one is
    /// expected. For the plant.
    ///
    /// # Errors
    /// If the transport failed.
    fn tell(&mut self, message: &[u8]) -> Result<(), LinkError>;

    /// The next control message, if there is one.
    ///
    /// # Errors
    /// If the transport failed.
    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError>;

    /// Makes a control channel for the controller of this epoch, in place of the one there is. For the
    /// plant.
    ///
    /// # Errors
    /// If the transport failed.
    fn expect(&mut self, epoch: u32) -> Result<(), LinkError>;

    /// Checks whether the peer on the control channel, and on the frames opened last, is the process that was
    /// launched for the controller. For the plant.
    ///
    /// # Errors
    /// If that cannot be found out.
    fn peer(&self) -> Result<Peer, LinkError>;

    /// Opens the frame channels for N values in each direction. The channels are in use at once if
    /// none are, else from [`take_over`](Link::take_over) on.
    ///
    /// # Errors
    /// If the transport failed or the other side opened another layout.
    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError>;

    /// Uses the frame channels that were opened last, and no others any more.
    fn take_over(&mut self);

    /// Sends a frame; the link fills in session, layout, epoch, sequence and count. Validity bits beyond
    /// the values may be lost.
    ///
    /// # Errors
    /// If the frame channels are not open or the transport failed.
    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError>;

    /// The latest frame not yet received, its values copied into `values`. A frame that fails a
    /// check is not delivered; it is counted in [`rejected`](Link::rejected).
    ///
    /// # Errors
    /// If the frame channels are not open or the transport failed.
    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError>;

    /// Frames that arrived and were refused.
    fn rejected(&self) -> Ignored;

    /// Returns what this side can sleep on until the other sends a frame or a control message. `None` where a
    /// send wakes nobody: then a wait naps.
    fn sleeper(&self) -> Option<Box<dyn Sleeper>> {
        None
    }
}

/// An end that is lent: what borrows it ends before the end does.
impl<L: Link> Link for &mut L {
    crate::pass_on!(self => **self; send_control tell receive_control expect peer open_frames take_over send receive rejected sleeper);
}

/// Process that speaks for the controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Peer {
    /// Process that was launched for the controller.
    Launched,
    /// Process that cannot be judged yet: the one launched for the controller is not known.
    Unknown,
    /// Another process, as told.
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

/// A transport failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// Service that is not there (yet).
    #[error("{service} is not there: {reason}")]
    Absent {
        /// Name of the service.
        service: String,
        /// Reason that the transport gave.
        reason: String,
    },
    /// Service that is there, but not as agreed.
    #[error("{service} is not the one of this session: {reason}")]
    Foreign {
        /// Name of the service.
        service: String,
        /// Difference from what was agreed.
        reason: String,
    },
    /// Another process has the place.
    #[error("the session has its {role} already ({service})")]
    Taken {
        /// Name of the service.
        service: String,
        /// Role that this process wanted.
        role: &'static str,
    },
    /// The operating system or the transport refused.
    #[error("{service}: {reason}")]
    Transport {
        /// Name of the service.
        service: String,
        /// Reason that the operating system or the transport gave.
        reason: String,
    },
    /// More signals in one direction than the largest frame carries.
    #[error("{0} signals in one direction; a frame carries at most 512")]
    TooManySignals(usize),
    /// Frames before [`Link::open_frames`].
    #[error("the frame channels are not open")]
    NotOpen,
}
