//! Streams of bytes: TCP, sockets of this machine and serial lines. Frames are cut out of them.

mod end;

use std::io::{self, ErrorKind};
use std::mem::take;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hil_codec::frame::CanId;
use rustix::io::Errno;
use rustix::net::addr::SocketAddrArg;
use rustix::net::sockopt::socket_error;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, getpeername, socket_with,
};

use super::cut::Cut;
use super::datagram::nothing;
use super::notes::{MOST_BYTES, Notes};
use super::socket_path::SocketPath;
use super::{Arrival, LONGEST, Medium, Note, NoteKind, Outlet, Tally, To};
use end::End;

/// Time between two attempts to connect.
const RETRY: Duration = Duration::from_millis(20);
/// Maximum number of reads of a stream per frame; what a faster sender has sent beyond that is read at the next call.
const MOST_READS: u32 = 16;
/// Time after which an attempt to connect is given up and another begins, as a listener that was full needs.
const ATTEMPT: Duration = Duration::from_secs(1);

/// Source of connections.
#[derive(Debug)]
enum Source {
    TcpTo(SocketAddr),
    TcpAt(TcpListener),
    UnixTo(PathBuf),
    UnixAt {
        /// Removed at the end.
        _own: SocketPath,
        listener: UnixListener,
    },
    /// A line that is always open.
    Line,
}

/// Stream of bytes with one peer at a time; a peer that disconnects may come again.
#[derive(Debug)]
pub(super) struct Stream {
    source: Source,
    end: Option<End>,
    /// Client that has connected beside the peer. Its turn comes when the peer is gone, which a peer that starts again
    /// needs: its new connection may be there before the end of the old one.
    next: Option<End>,
    /// First such client.
    first_other: Option<String>,
    /// Attempt to connect that has not ended yet, and when it began.
    attempt: Option<(OwnedFd, Instant)>,
    /// Bytes of the last frame that the peer has not taken yet. Half a frame would spoil the next one.
    rest: Vec<u8>,
    /// Bytes that have arrived and are not read yet.
    arrived: Vec<u8>,
    /// Bytes of the last frame that was cut by its length.
    last: Vec<u8>,
    /// `true` inside of a line that is too long, up to its end.
    is_in_long_line: bool,
    cut: Cut,
    /// Number of the connection on which a frame was sent last.
    sent_on: u64,
    /// Time of the last attempt to connect.
    tried: Option<Instant>,
    was_connected: bool,
    counts: Tally,
    notes: Notes,
}

impl Stream {
    fn new(source: Source, end: Option<End>, cut: Cut) -> Self {
        Self {
            source,
            end,
            next: None,
            first_other: None,
            attempt: None,
            rest: Vec::new(),
            arrived: Vec::with_capacity(4 * LONGEST),
            last: Vec::new(),
            is_in_long_line: false,
            cut,
            sent_on: 0,
            tried: None,
            was_connected: false,
            counts: Tally::default(),
            notes: Notes::default(),
        }
    }

    pub(super) fn tcp(to: SocketAddr, cut: Cut) -> Self {
        Self::new(Source::TcpTo(to), None, cut)
    }

    pub(super) fn tcp_listener(at: SocketAddr, cut: Cut) -> io::Result<Self> {
        let listener = TcpListener::bind(at)?;
        listener.set_nonblocking(true)?;
        Ok(Self::new(Source::TcpAt(listener), None, cut))
    }

    pub(super) fn unix(path: PathBuf, cut: Cut) -> Self {
        Self::new(Source::UnixTo(path), None, cut)
    }

    pub(super) fn unix_listener(path: &Path, cut: Cut) -> io::Result<Self> {
        let (own, listener) = SocketPath::bind(path, |path| UnixListener::bind(path))?;
        listener.set_nonblocking(true)?;
        let source = Source::UnixAt {
            _own: own,
            listener,
        };
        Ok(Self::new(source, None, cut))
    }

    pub(super) fn serial(line: std::fs::File, cut: Cut) -> Self {
        Self::new(Source::Line, Some(End::Line(line)), cut)
    }

    /// Makes a medium that writes to a connected socket.
    pub(super) fn tcp_end(end: TcpStream) -> Self {
        Self::new(Source::Line, Some(End::Tcp(end)), Cut::Lengths(Vec::new()))
    }

    /// Makes a medium that writes to a connected socket of this machine.
    pub(super) fn unix_end(end: UnixStream) -> Self {
        Self::new(Source::Line, Some(End::Unix(end)), Cut::Lengths(Vec::new()))
    }

    /// Accepts a client; `None` if the source is none of clients.
    fn accept(&self) -> Option<io::Result<End>> {
        match &self.source {
            Source::TcpAt(listener) => Some(listener.accept().map(|(stream, _)| End::Tcp(stream))),
            Source::UnixAt { listener, .. } => {
                Some(listener.accept().map(|(stream, _)| End::Unix(stream)))
            }
            Source::Line | Source::TcpTo(_) | Source::UnixTo(_) => None,
        }
    }

    /// Looks for a client beside the peer, which is named and waits for its turn.
    fn look_for_another(&mut self) {
        let is_soon = self.tried.is_some_and(|at| at.elapsed() < RETRY);
        let (Some(end), None, false) = (&self.end, &self.next, is_soon) else {
            return;
        };
        let Some(result) = self.accept() else {
            return;
        };
        self.tried = Some(Instant::now());
        // Without a client nothing is to be done; an error is one of a client that is gone.
        let Ok(another) = result else {
            return;
        };
        self.counts.strangers += 1;
        if self.first_other.is_none() {
            let other = another.other();
            self.notes.add(NoteKind::OtherSender, &[], || {
                let peer = end.other();
                format!("{other} has connected beside the peer, {peer}, and waits until that one is gone")
            });
            self.first_other = Some(other);
        }
        self.next = Some(another);
    }

    /// Returns a connection if there is one now, and never waits for it.
    fn dial(&mut self) -> io::Result<End> {
        if let Some(next) = self.next.take() {
            return Ok(next);
        }
        if let Some(result) = self.accept() {
            return result;
        }
        let is_soon = self.tried.is_some_and(|at| at.elapsed() < RETRY);
        match &self.source {
            Source::Line | Source::TcpAt(_) | Source::UnixAt { .. } => {
                Err(ErrorKind::UnexpectedEof.into())
            }
            Source::TcpTo(_) | Source::UnixTo(_) if self.attempt.is_none() && is_soon => {
                Err(ErrorKind::WouldBlock.into())
            }
            Source::UnixTo(path) => {
                self.tried = Some(Instant::now());
                begin(AddressFamily::UNIX, &SocketAddrUnix::new(path)?)
                    .map(|socket| End::Unix(socket.into()))
            }
            Source::TcpTo(to) => {
                let (socket, began) = match self.attempt.take() {
                    Some(attempt) => attempt,
                    None => {
                        let now = Instant::now();
                        self.tried = Some(now);
                        let family = match to {
                            SocketAddr::V4(_) => AddressFamily::INET,
                            SocketAddr::V6(_) => AddressFamily::INET6,
                        };
                        (begin(family, to)?, now)
                    }
                };
                socket_error(&socket)??;
                match getpeername(&socket) {
                    Ok(_) => Ok(End::Tcp(socket.into())),
                    Err(Errno::NOTCONN) => {
                        if began.elapsed() < ATTEMPT {
                            self.attempt = Some((socket, began));
                        }
                        Err(ErrorKind::WouldBlock.into())
                    }
                    Err(error) => Err(error.into()),
                }
            }
        }
    }

    /// Connects if there is no peer and one can be reached now.
    fn connect(&mut self) -> io::Result<()> {
        if self.end.is_some() {
            return Ok(());
        }
        let end = self.dial();
        match end {
            Ok(end) => {
                if !end.prepare()? {
                    return Ok(());
                }
                if self.was_connected {
                    self.counts.new_peers += 1;
                    let peer = end.other();
                    self.notes.add(NoteKind::NewPeer, &[], || {
                        format!("{peer} is connected after the peer before")
                    });
                }
                self.end = Some(end);
                // Nothing of the peer before is part of a frame of this one.
                self.rest.clear();
                self.arrived.clear();
                self.last.clear();
                self.is_in_long_line = false;
                self.was_connected = true;
                Ok(())
            }
            Err(error) if is_absence(error.kind()) => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn skip(&mut self, count: usize) {
        if count == 0 {
            return;
        }
        let skipped = &self.arrived[..count];
        // More of them may follow, so that their number says nothing.
        let beginning = &skipped[..count.min(MOST_BYTES)];
        (self.notes).add(NoteKind::NoFrame, beginning, || self.cut.describe(skipped));
        self.counts.skipped_bytes += count as u64;
        self.arrived.drain(..count);
    }

    /// Ends the connection. A frame of which a part was written has reached nobody.
    fn disconnect(&mut self) {
        self.end = None;
        self.counts.unsent += u64::from(!self.rest.is_empty());
        self.rest.clear();
    }

    /// Writes as many bytes as the peer takes now, and returns their number.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(end) = &mut self.end else {
            return Ok(0);
        };
        match end.write(bytes) {
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                Ok(0)
            }
            // The peer may come again.
            Err(_) if !matches!(self.source, Source::Line) => {
                self.disconnect();
                Ok(0)
            }
            result => result,
        }
    }

    /// Continues the frame of which a part was written.
    fn continue_frame(&mut self) -> io::Result<()> {
        if self.rest.is_empty() {
            return Ok(());
        }
        let rest = take(&mut self.rest);
        let count = self.write(&rest)?;
        if self.end.is_some() {
            self.rest = rest;
            self.rest.drain(..count);
        } else {
            self.counts.unsent += 1;
        }
        Ok(())
    }

    /// Reads what has arrived; returns `true` if there was something.
    fn read(&mut self) -> io::Result<bool> {
        let Some(end) = &mut self.end else {
            return Ok(false);
        };
        let begin = self.arrived.len();
        self.arrived.resize(begin + LONGEST, 0);
        let count = match end.read(&mut self.arrived[begin..]) {
            Ok(0) => {
                self.disconnect();
                0
            }
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::ConnectionReset => {
                self.disconnect();
                0
            }
            Err(error) => nothing(error)?.unwrap_or(0),
        };
        self.arrived.truncate(begin + count);
        Ok(count > 0)
    }
}

/// Begins to connect a socket, which may be connected at once or later.
fn begin(family: AddressFamily, to: &impl SocketAddrArg) -> io::Result<OwnedFd> {
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(family, SocketType::STREAM, flags, None)?;
    match connect(&socket, to) {
        Ok(()) | Err(Errno::INPROGRESS) => Ok(socket),
        Err(error) => Err(error.into()),
    }
}

fn is_absence(kind: ErrorKind) -> bool {
    use ErrorKind::{
        ConnectionAborted, ConnectionRefused, ConnectionReset, HostUnreachable, Interrupted,
        NetworkUnreachable, NotFound, TimedOut, WouldBlock,
    };
    matches!(
        kind,
        ConnectionAborted
            | ConnectionRefused
            | ConnectionReset
            | HostUnreachable
            | Interrupted
            | NetworkUnreachable
            | NotFound
            | TimedOut
            | WouldBlock
    )
}

impl Medium for Stream {
    fn send(&mut self, _: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        self.connect()?;
        self.continue_frame()?;
        let count = match self.rest.is_empty() {
            true => self.write(bytes)?,
            false => 0,
        };
        if count == 0 {
            self.counts.unsent += 1;
            return Ok(false);
        }
        self.rest.extend_from_slice(&bytes[count..]);
        self.sent_on = self.counts.new_peers;
        Ok(true)
    }

    /// Returns `true` if another peer is connected than the one that got the last frame, which that one cannot answer any
    /// more.
    fn has_reached_nobody(&self, _: Option<CanId>, _: &[u8]) -> bool {
        self.end.is_some() && self.sent_on != self.counts.new_peers
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        self.connect()?;
        self.look_for_another();
        self.continue_frame()?;
        for _ in 0..MOST_READS {
            let is_line = self.cut == Cut::Line;
            if is_line && self.is_in_long_line {
                let end = self.arrived.iter().position(|byte| *byte == b'\n');
                self.is_in_long_line = end.is_none();
                self.skip(end.map_or(self.arrived.len(), |end| end + 1));
            }
            let (skip, length) = self.cut.find(&self.arrived);
            self.skip(skip);
            if let Some(length) = length {
                let kept = if length < buffer.len() {
                    length
                } else {
                    buffer.len()
                };
                buffer[..kept].copy_from_slice(&self.arrived[..kept]);
                self.arrived.drain(..length);
                self.last.clear();
                if !is_line {
                    self.last.extend_from_slice(&buffer[..kept]);
                }
                let length = match is_line {
                    true => buffer[..kept].trim_ascii_end().len(),
                    false => kept,
                };
                if length > 0 {
                    return Ok(Some(Arrival::whole(length, None)));
                }
            } else if skip == 0 {
                if is_line && self.arrived.len() > LONGEST {
                    self.is_in_long_line = true;
                } else if !self.read()? {
                    return Ok(None);
                }
            }
        }
        Ok(None)
    }

    fn reject(&mut self) {
        if !self.last.is_empty() {
            self.arrived.splice(0..0, self.last.drain(..).skip(1));
            self.counts.skipped_bytes += 1;
        }
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        match (self.end.as_ref().or(self.next.as_ref()), &self.source) {
            (Some(end), _) => Some(end.fd()),
            (None, Source::TcpAt(listener)) => Some(listener.as_fd()),
            (None, Source::UnixAt { listener, .. }) => Some(listener.as_fd()),
            (None, _) => None,
        }
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        Some(Outlet {
            fd: self.end.as_ref()?.fd(),
            to: To::Connected,
            connection: self.counts.new_peers,
        })
    }

    fn writable(&self) -> Option<BorrowedFd<'_>> {
        match (&self.end, &self.attempt) {
            (Some(_), _) if !self.rest.is_empty() => self.readable(),
            (None, Some((socket, _))) => Some(socket.as_fd()),
            _ => None,
        }
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

#[cfg(test)]
mod tests;
