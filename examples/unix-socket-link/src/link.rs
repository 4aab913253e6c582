//! The link: a socket for the control messages of each controller, and one for its frames.
//!
//! The plant listens and a controller connects, by the number of its epoch, in a folder that belongs to nobody else.
//! A frame is its header and its values in memory layout, because both sides are on one machine. There is no checksum,
//! because nothing here can corrupt a frame; a link over a wire would send one.

use std::path::{Path, PathBuf};

use shared_types::frame::{FrameError, FrameIdentity, Header, MAX_SIGNALS};
use shared_types::ignored::Ignored;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::table::canonical;
use shared_types::zerocopy::{FromBytes, IntoBytes};

use crate::socket::Socket;

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Plant,
    Controller,
}

/// End of a link over UNIX sockets.
pub struct UnixSocketLink {
    side: Side,
    folder: PathBuf,
    control: Socket,
    /// Control messages of the controller whose frames are in use, while another controller is expected.
    active: Option<Socket>,
    frames: Option<Frames>,
    /// Frames opened last, while older ones are in use.
    next: Option<Frames>,
    rejected: Ignored,
}

struct Frames {
    socket: Socket,
    identity: FrameIdentity,
    sequence: u64,
}

impl UnixSocketLink {
    /// Creates the plant's end, in a folder without sockets.
    ///
    /// # Errors
    /// If the folder cannot be used, or already has a plant.
    pub fn create(folder: &Path) -> Result<Self, LinkError> {
        Self::new(folder, Side::Plant, 1)
    }

    /// Creates the end of the controller of an epoch.
    ///
    /// # Errors
    /// [`LinkError::Absent`] while the plant does not expect the controller.
    pub fn open(folder: &Path, epoch: u32) -> Result<Self, LinkError> {
        Self::new(folder, Side::Controller, epoch)
    }

    fn new(folder: &Path, side: Side, epoch: u32) -> Result<Self, LinkError> {
        Ok(Self {
            side,
            folder: folder.into(),
            control: socket(folder, side, "control", epoch)?,
            active: None,
            frames: None,
            next: None,
            rejected: Ignored::default(),
        })
    }
}

fn socket(folder: &Path, side: Side, name: &str, epoch: u32) -> Result<Socket, LinkError> {
    let path = folder.join(format!("{name}-{epoch}"));
    match side {
        Side::Plant => Socket::listen(&path),
        Side::Controller => Socket::connect(&path),
    }
}

impl Link for UnixSocketLink {
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.control.queue(message)
    }

    fn tell(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.active.as_mut().unwrap_or(&mut self.control).queue(message)
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        self.control.next()
    }

    fn expect(&mut self, epoch: u32) -> Result<(), LinkError> {
        let next = socket(&self.folder, self.side, "control", epoch)?;
        let before = std::mem::replace(&mut self.control, next);
        // An earlier controller may have been expected in vain.
        if self.active.is_none() && self.frames.is_some() {
            self.active = Some(before);
        }
        Ok(())
    }

    fn peer(&self) -> Result<Peer, LinkError> {
        Ok(Peer::Launched) // nobody else can enter the folder
    }

    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError> {
        let most = spec.outgoing.max(spec.incoming);
        if most > MAX_SIGNALS {
            return Err(LinkError::TooManySignals(most));
        }
        self.next = Some(Frames {
            socket: socket(&self.folder, self.side, "frames", spec.identity.epoch)?,
            identity: spec.identity,
            sequence: 0,
        });
        if self.frames.is_none() {
            self.take_over();
        }
        Ok(())
    }

    fn take_over(&mut self) {
        if self.next.is_some() {
            self.frames = self.next.take();
            self.active = None;
        }
    }

    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError> {
        let frames = self.frames.as_mut().ok_or(LinkError::NotOpen)?;
        frames.sequence += 1;
        let header = Header {
            session: frames.identity.session,
            layout: frames.identity.layout,
            epoch: frames.identity.epoch,
            sequence: frames.sequence,
            count: values.len() as u16,
            ..*header
        };
        let mut message = header.as_bytes().to_vec();
        message.extend(
            values
                .iter()
                .flat_map(|value| canonical(*value).to_ne_bytes()),
        );
        frames.socket.replace(&message)
    }

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let frames = self.frames.as_mut().ok_or(LinkError::NotOpen)?;
        let mut newest = None;
        while let Some(message) = frames.socket.next()? {
            newest = Some(message);
        }
        let Some(message) = newest else {
            return Ok(None);
        };
        match opened(&message, frames.identity, values) {
            Ok(header) => Ok(Some(header)),
            Err(error) => {
                self.rejected.count(error);
                Ok(None)
            }
        }
    }

    fn rejected(&self) -> Ignored {
        self.rejected
    }
}

/// Checks a frame and copies its values out.
fn opened(
    message: &[u8],
    identity: FrameIdentity,
    values: &mut [f64],
) -> Result<Header, FrameError> {
    let (header, carried) = Header::read_from_prefix(message).map_err(|_| FrameError::Corrupt)?;
    identity.check(&header, values.len())?;
    if carried.len() != 8 * usize::from(header.count) {
        return Err(FrameError::Corrupt);
    }
    for (value, bytes) in values.iter_mut().zip(carried.chunks_exact(8)) {
        *value = f64::read_from_bytes(bytes).map_err(|_| FrameError::Corrupt)?;
    }
    Ok(header)
}
