//! Sockets of this machine with datagrams.

use std::ffi::OsStr;
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

use hil_codec::frame::CanId;
use rustix::net::{RecvFlags, SocketAddrUnix, recvfrom};
use shared_types::text;

use super::super::notes::Notes;
use super::super::socket_path::{SocketPath, is_same};
use super::super::{Arrival, Medium, Note, NoteKind, Outlet, Tally, To};
use super::{MOST_STRANGERS, absent_peer, nothing};

/// Socket of this machine with datagrams.
#[derive(Debug)]
pub(in crate::medium) struct Unix {
    own: SocketPath,
    socket: UnixDatagram,
    /// Path of the peer, if known.
    to: Option<PathBuf>,
    /// First sender other than the peer.
    first_other: Option<String>,
    counts: Tally,
    notes: Notes,
}

impl Unix {
    pub(in crate::medium) fn open(path: &Path, listens: bool) -> io::Result<Self> {
        // A peer can only answer a socket that has a path.
        let path_of_own = match listens {
            true => path.to_owned(),
            false => PathBuf::from(format!("{}.hil-{}", path.display(), std::process::id())),
        };
        let (own, socket) = SocketPath::bind(&path_of_own, |path| UnixDatagram::bind(path))?;
        socket.set_nonblocking(true)?;
        Ok(Self::new(own, socket, (!listens).then(|| path.to_owned())))
    }

    fn new(own: SocketPath, socket: UnixDatagram, to: Option<PathBuf>) -> Self {
        Self {
            own,
            socket,
            to,
            first_other: None,
            counts: Tally::default(),
            notes: Notes::default(),
        }
    }

    /// Makes a medium that sends on an open socket.
    pub(in crate::medium) fn adopt(socket: UnixDatagram, to: PathBuf) -> Self {
        Self::new(SocketPath::of_another(), socket, Some(to))
    }

    /// Counts a datagram of another sender.
    fn note_other(&mut self, path: &Path, datagram: &[u8]) {
        self.counts.strangers += 1;
        if self.first_other.is_none() {
            let other = text::line(&path.display().to_string());
            self.notes.add(NoteKind::OtherSender, datagram, || {
                format!("a frame of {other}, which is not the peer")
            });
            self.first_other = Some(other);
        }
    }
}

impl Medium for Unix {
    fn send(&mut self, _: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        let result = match &self.to {
            Some(to) => self.socket.send_to(bytes, to),
            None => Err(ErrorKind::NotFound.into()),
        };
        let is_absent = absent_peer(result, &mut self.counts)?;
        Ok(!is_absent)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        for _ in 0..MOST_STRANGERS {
            let flags = RecvFlags::TRUNC | RecvFlags::DONTWAIT;
            let (size, from) = match recvfrom(&self.socket, &mut *buffer, flags) {
                Ok((_, size, from)) => (size, from),
                Err(error) => return nothing(error.into()),
            };
            let length = size.min(buffer.len());
            let from = from.and_then(|from| SocketAddrUnix::try_from(from).ok());
            if let Some(name) = from.as_ref().and_then(SocketAddrUnix::path) {
                // Its name is what it was bound with, which may be relative, or lead over another folder.
                let path = (self.own).resolve(Path::new(OsStr::from_bytes(name.to_bytes())));
                if !is_same(self.to.get_or_insert_with(|| path.clone()), &path) {
                    self.note_other(&path, &buffer[..length]);
                    continue;
                }
            }
            let id = None;
            return Ok(Some(Arrival { length, size, id }));
        }
        Ok(None)
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        Some(Outlet {
            fd: self.socket.as_fd(),
            to: To::Path(self.to.as_deref()?),
            connection: 0,
        })
    }

    fn counts(&self) -> Tally {
        self.counts
    }

    fn first_other(&self) -> Option<&str> {
        self.first_other.as_deref()
    }

    fn take_notes(&mut self) -> Vec<Note> {
        self.notes.take()
    }
}
