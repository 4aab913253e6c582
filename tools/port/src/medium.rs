//! Media: bytes of frames, sent and received without blocking.

mod adoption;
mod can;
mod cut;
mod datagram;
mod file;
mod notes;
mod serial;
mod socket_path;
mod stream;

use std::io;
use std::net::SocketAddr;
use std::os::fd::BorrowedFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use hil_codec::frame::CanId;
use hil_config::port::{self, MediumKind};

pub use adoption::{adopt, connecting, path_of};
pub use cut::Cut;
pub use notes::{Note, NoteKind, hex};
use socket_path::is_socket_or_free;
pub use socket_path::remove_if_left;
use stream::Stream;

/// Longest frame that any medium carries, in bytes. Of a longer one the beginning is received, one byte more than this,
/// and refused.
pub const LONGEST: usize = 4096;

/// Frame that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Number of bytes at the beginning of the buffer.
    pub length: usize,
    /// Number of bytes that were sent, which may be more than the buffer has room for.
    pub size: usize,
    /// Identifier, on CAN.
    pub id: Option<CanId>,
}

impl Arrival {
    /// Returns a frame that the buffer has whole.
    const fn whole(length: usize, id: Option<CanId>) -> Self {
        let size = length;
        Self { length, size, id }
    }
}

/// Counts of a medium that concern no frame of the port; each is described in [`hil_config::port::counts`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Frames from a sender other than the peer.
    pub strangers: u64,
    /// Times that another sender became the peer after the earlier one was silent.
    pub new_peers: u64,
    /// Bytes of a stream that belong to no frame.
    pub skipped_bytes: u64,
    /// Attempts to send that reached nobody.
    pub unsent: u64,
    /// Error frames, on CAN.
    pub error_frames: u64,
    /// Remote requests, on CAN.
    pub remote_requests: u64,
    /// Reads that failed, of a file.
    pub unreadable: u64,
    /// Frames that the kernel dropped because they were read too late.
    pub dropped: u64,
}

/// End of a medium on which frames are sent now.
#[derive(Clone, Copy, Debug)]
pub struct Outlet<'a> {
    /// Descriptor.
    pub fd: BorrowedFd<'a>,
    /// Receiver of the frames.
    pub to: To<'a>,
    /// Number of the connection: a later one may have the same descriptor.
    pub connection: u64,
}

/// Receiver of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum To<'a> {
    /// The other end of the descriptor.
    Connected,
    /// Address on a network.
    Address(SocketAddr),
    /// Path of a socket.
    Path(&'a Path),
}

impl To<'_> {
    /// Returns the receiver as bytes, empty for a connected descriptor.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Connected => Vec::new(),
            Self::Address(address) => address.to_string().into_bytes(),
            Self::Path(path) => path.as_os_str().as_bytes().to_vec(),
        }
    }
}

/// Opened medium.
pub trait Medium: Send {
    /// Sends the bytes of a frame; returns `false` if nobody is there to read them. A stream that takes only a part
    /// continues with the next calls, and takes no other frame before.
    ///
    /// # Errors
    /// If the medium is gone.
    fn send(&mut self, id: Option<CanId>, bytes: &[u8]) -> io::Result<bool>;

    /// Returns `true` if a sent frame turned out to have reached nobody since [`forget_lost`](Self::forget_lost).
    fn has_reached_nobody(&self, _id: Option<CanId>, _bytes: &[u8]) -> bool {
        false
    }

    /// Forgets the frames that reached nobody, because they are sent again or no longer needed.
    fn forget_lost(&mut self) {}

    /// Receives the next frame into a buffer of more than [`LONGEST`] bytes; `None` if none has arrived.
    ///
    /// # Errors
    /// If the medium is gone.
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>>;

    /// Gives the last frame back, whose bytes are none of a frame: on a stream the search goes on at its second byte.
    fn reject(&mut self) {}

    /// Returns the descriptor that becomes readable when a frame arrives; `None` for a medium that must be read.
    fn readable(&self) -> Option<BorrowedFd<'_>>;

    /// Returns the end on which frames are sent now; `None` if nobody is there to read them.
    fn outlet(&self) -> Option<Outlet<'_>> {
        None
    }

    /// Returns the descriptor that becomes writable when a frame or a connection can be continued; `None` if none is to be.
    fn writable(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Returns the counts so far.
    fn counts(&self) -> Tally;

    /// Returns the first sender other than the peer, as a text.
    fn first_other(&self) -> Option<&str> {
        None
    }

    /// Takes the notes since the last call.
    fn take_notes(&mut self) -> Vec<Note> {
        Vec::new()
    }
}

/// Opens a medium, whose paths are relative to a folder. `cut` says where frames end on it, if it is a stream of bytes.
///
/// # Errors
/// If it does not exist, is in use or belongs to another user.
pub fn open(medium: &port::Medium, cut: Cut, folder: &Path) -> io::Result<Box<dyn Medium>> {
    let path_of = |path: &str| folder.join(path);
    Ok(match &medium.kind {
        MediumKind::Udp { to, listen } => Box::new(datagram::Udp::open(*to, *listen)?),
        MediumKind::Cannelloni { to, listen, .. } => {
            Box::new(can::Cannelloni::new(datagram::Udp::open(*to, *listen)?))
        }
        MediumKind::Unix { path, .. } if !is_socket_or_free(&path_of(path)) => {
            let why =
                "the path is that of something else than a socket; name another one, or remove it";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
        }
        MediumKind::Tcp { address, listens } => match listens {
            true => Box::new(Stream::tcp_listener(*address, cut)?),
            false => Box::new(Stream::tcp(*address, cut)),
        },
        MediumKind::Unix {
            path,
            is_stream: true,
            listens,
        } => match listens {
            true => Box::new(Stream::unix_listener(&path_of(path), cut)?),
            false => Box::new(Stream::unix(path_of(path), cut)),
        },
        MediumKind::Unix { path, listens, .. } => {
            Box::new(datagram::Unix::open(&path_of(path), *listens)?)
        }
        MediumKind::Serial { .. } => Box::new(Stream::serial(serial::open(&medium.kind)?, cut)),
        MediumKind::Can { interface, .. } => Box::new(can::Interface::open(interface)?),
        MediumKind::File { path } => Box::new(file::File::open(&path_of(path), cut == Cut::Line)?),
    })
}

/// Returns a text of a medium for messages: its kind and place.
#[must_use]
pub fn place(kind: &MediumKind) -> String {
    let address = |to: &Option<SocketAddr>, listen: &Option<SocketAddr>| match (to, listen) {
        (Some(to), Some(listen)) => format!("{to} from {listen}"),
        (Some(to), None) => format!("{to}"),
        (None, Some(listen)) => format!("the sender to {listen}"),
        (None, None) => String::new(),
    };
    match kind {
        MediumKind::Udp { to, listen } => format!("UDP, {}", address(to, listen)),
        MediumKind::Cannelloni { to, listen, .. } => {
            format!("cannelloni, {}", address(to, listen))
        }
        MediumKind::Tcp { address, listens } => match listens {
            true => format!("TCP, the client of {address}"),
            false => format!("TCP, {address}"),
        },
        MediumKind::Unix { path, .. } => format!("the socket {path}"),
        MediumKind::Serial { device, baud, .. } => format!("{device} at {baud} baud"),
        MediumKind::Can { interface, .. } => format!("CAN interface {interface}"),
        MediumKind::File { path } => format!("the file {path}"),
    }
}
