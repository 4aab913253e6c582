//! Streams of bytes: TCP, sockets of this machine and serial lines. Frames are cut out of them.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::mem::take;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hil_codec::frame::{Body, CanId, Content, Frame};

use super::datagram::{nothing, remove_if_left};
use super::{Arrival, LONGEST, Medium, Outlet, Tally, To};

/// Time between two attempts to connect.
const RETRY: Duration = Duration::from_millis(20);
/// Most reads of a stream for one frame; a sender that is faster is read on at the next call.
const MOST_READS: u32 = 16;
/// Time that one attempt to connect may take.
const ATTEMPT: Duration = Duration::from_millis(200);

/// Ends of frames on a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cut {
    /// A frame ends with its line.
    Line,
    /// Frames of fixed lengths, each with the bytes that it begins with.
    Lengths(Vec<(usize, Vec<u8>)>),
}

impl Cut {
    /// Returns the ends of received frames.
    ///
    /// # Errors
    /// If they cannot be told apart in a stream.
    pub fn of<'a>(
        frames: impl Iterator<Item = &'a Frame>,
        is_serial: bool,
    ) -> Result<Self, String> {
        let (mut lines, mut lengths) = (Vec::new(), Vec::new());
        for frame in frames {
            match &frame.body {
                Body::Json(_) => lines.push(&frame.name),
                Body::Bytes { length, .. } => lengths.push((*length, sync(frame))),
            }
        }
        match (lines.as_slice(), lengths.as_slice()) {
            ([], [(_, sync)]) if is_serial && sync.is_empty() => Err("a frame on a serial line must begin with a constant, by which its beginning is found".into()),
            ([], [_] | []) => Ok(Self::Lengths(lengths)),
            ([], _) if are_ambiguous(&lengths) => Err("two frames of different lengths on a stream begin with the same constant; give each its own".into()),
            ([], _) if lengths.iter().all(|(_, sync)| !sync.is_empty()) => Ok(Self::Lengths(lengths)),
            ([], _) => Err("several frames of bytes on a stream must each begin with a constant, by which they are found".into()),
            (_, []) => Ok(Self::Line),
            ([line, ..], _) => Err(format!("frame {line} is a line of JSON and another one on the same stream is bytes; use one format for a stream")),
        }
    }

    /// Returns how many bytes to skip, and the length of the frame behind them if it is complete.
    fn find(&self, bytes: &[u8]) -> (usize, Option<usize>) {
        match self {
            Self::Line => match bytes.iter().position(|byte| *byte == b'\n') {
                Some(end) if end > LONGEST => (end + 1, None),
                Some(end) => (0, Some(end + 1)),
                None => (0, None),
            },
            Self::Lengths(frames) => {
                for skip in 0..bytes.len() {
                    let rest = &bytes[skip..];
                    for (length, sync) in frames {
                        let known = rest.len().min(sync.len());
                        if rest[..known] == sync[..known] {
                            let is_whole = rest.len() >= *length;
                            return (skip, is_whole.then_some(*length));
                        }
                    }
                }
                (bytes.len(), None)
            }
        }
    }
}

/// Returns `true` if the beginning of a frame does not tell its length.
fn are_ambiguous(frames: &[(usize, Vec<u8>)]) -> bool {
    frames.iter().enumerate().any(|(index, (length, sync))| {
        frames[..index].iter().any(|(other_length, other)| {
            length != other_length && (sync.starts_with(other) || other.starts_with(sync))
        })
    })
}

/// Returns the constant bytes that a frame begins with.
fn sync(frame: &Frame) -> Vec<u8> {
    let Body::Bytes { length, fields } = &frame.body else {
        return Vec::new();
    };
    let (mut image, mut is_constant) = (vec![0; *length], vec![0u8; *length]);
    for field in fields {
        if let Content::Constant(raw) = field.content {
            field.bits.write(&mut image, raw);
            for (byte, mask) in is_constant.iter_mut().enumerate() {
                *mask |= field.bits.mask_of(byte);
            }
        }
    }
    let count = is_constant.iter().take_while(|mask| **mask == 0xFF).count();
    image.truncate(count);
    image
}

/// Source of connections.
#[derive(Debug)]
enum Source {
    TcpTo(SocketAddr),
    TcpAt(TcpListener),
    UnixTo(PathBuf),
    UnixAt(UnixListener, PathBuf),
    /// A line that is always open.
    Line,
}

/// Connected end.
#[derive(Debug)]
enum End {
    Tcp(TcpStream),
    Unix(UnixStream),
    Line(File),
}

/// Stream of bytes with one peer at a time; a peer that disconnects may come again.
#[derive(Debug)]
pub(super) struct Stream {
    source: Source,
    end: Option<End>,
    /// Bytes that have arrived and are not read yet.
    arrived: Vec<u8>,
    /// Bytes of the last frame that was cut by its length.
    last: Vec<u8>,
    /// `true` inside of a line that is too long, up to its end.
    is_in_long_line: bool,
    cut: Cut,
    /// Time of the last attempt to connect.
    tried: Option<Instant>,
    was_connected: bool,
    reached_nobody: bool,
    counts: Tally,
}

impl Stream {
    fn new(source: Source, end: Option<End>, cut: Cut) -> Self {
        Self {
            source,
            end,
            arrived: Vec::with_capacity(4 * LONGEST),
            last: Vec::new(),
            is_in_long_line: false,
            cut,
            tried: None,
            was_connected: false,
            reached_nobody: false,
            counts: Tally::default(),
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
        remove_if_left(path);
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        Ok(Self::new(Source::UnixAt(listener, path.into()), None, cut))
    }

    pub(super) fn serial(line: File, cut: Cut) -> Self {
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

    /// Connects if there is no peer and one can be reached now.
    fn connect(&mut self) -> io::Result<()> {
        let is_soon = |at: Instant| at.elapsed() < RETRY;
        let is_client = matches!(self.source, Source::TcpTo(_) | Source::UnixTo(_));
        if self.end.is_some() || (is_client && self.tried.is_some_and(is_soon)) {
            return Ok(());
        }
        let end = match &self.source {
            Source::TcpTo(to) => TcpStream::connect_timeout(to, ATTEMPT).map(End::Tcp),
            Source::TcpAt(listener) => listener.accept().map(|(stream, _)| End::Tcp(stream)),
            Source::UnixTo(path) => UnixStream::connect(path).map(End::Unix),
            Source::UnixAt(listener, _) => listener.accept().map(|(stream, _)| End::Unix(stream)),
            Source::Line => return Err(ErrorKind::UnexpectedEof.into()),
        };
        self.tried = Some(Instant::now());
        match end {
            Ok(end) => {
                match &end {
                    // A frame must not wait for the next one.
                    End::Tcp(stream) => {
                        // Without a listener a port of this machine may connect to itself.
                        if stream.local_addr()? == stream.peer_addr()? {
                            return Ok(());
                        }
                        stream.set_nodelay(true)?;
                        stream.set_nonblocking(true)?;
                    }
                    End::Unix(stream) => stream.set_nonblocking(true)?,
                    End::Line(_) => {}
                }
                self.end = Some(end);
                // Nothing of the peer before is part of a frame of this one.
                self.arrived.clear();
                self.last.clear();
                self.is_in_long_line = false;
                self.counts.new_peers += u64::from(self.was_connected);
                self.was_connected = true;
                Ok(())
            }
            Err(error) if is_absence(error.kind()) => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn skip(&mut self, count: usize) {
        self.counts.skipped_bytes += count as u64;
        self.arrived.drain(..count);
    }

    fn unsent(&mut self) {
        self.counts.unsent += 1;
        self.reached_nobody = true;
    }

    /// Reads what has arrived; returns `true` if there was something.
    fn read(&mut self) -> io::Result<bool> {
        let Some(end) = &mut self.end else {
            return Ok(false);
        };
        let begin = self.arrived.len();
        self.arrived.resize(begin + LONGEST, 0);
        let free = &mut self.arrived[begin..];
        let result = match end {
            End::Tcp(stream) => stream.read(free),
            End::Unix(stream) => stream.read(free),
            End::Line(line) => line.read(free),
        };
        let count = match result {
            Ok(0) => {
                self.end = None;
                0
            }
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::ConnectionReset => {
                self.end = None;
                0
            }
            Err(error) => nothing(error)?.unwrap_or(0),
        };
        self.arrived.truncate(begin + count);
        Ok(count > 0)
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
        let Some(end) = &mut self.end else {
            self.unsent();
            return Ok(false);
        };
        let result = match end {
            End::Tcp(stream) => stream.write(bytes),
            End::Unix(stream) => stream.write(bytes),
            End::Line(line) => line.write(bytes),
        };
        match result {
            Ok(count) if count == bytes.len() => Ok(true),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                self.unsent();
                Ok(false)
            }
            // Half a frame would spoil the next one, so the peer has to come again.
            Ok(_) | Err(_) if !matches!(self.source, Source::Line) => {
                self.unsent();
                self.end = None;
                Ok(false)
            }
            Ok(_) => {
                self.unsent();
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }

    fn has_reached_nobody(&mut self) -> bool {
        take(&mut self.reached_nobody)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        self.connect()?;
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
                    return Ok(Some(Arrival { length, id: None }));
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
        match (&self.end, &self.source) {
            (Some(End::Tcp(stream)), _) => Some(stream.as_fd()),
            (Some(End::Unix(stream)), _) => Some(stream.as_fd()),
            (Some(End::Line(line)), _) => Some(line.as_fd()),
            (None, Source::TcpAt(listener)) => Some(listener.as_fd()),
            (None, Source::UnixAt(listener, _)) => Some(listener.as_fd()),
            (None, _) => None,
        }
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        let fd = match self.end.as_ref()? {
            End::Tcp(stream) => stream.as_fd(),
            End::Unix(stream) => stream.as_fd(),
            End::Line(line) => line.as_fd(),
        };
        Some(Outlet {
            fd,
            to: To::Connected,
            connection: self.counts.new_peers,
        })
    }

    fn counts(&self) -> Tally {
        self.counts
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if let Source::UnixAt(_, path) = &self.source {
            // One that is gone already needs no removal.
            let _ = std::fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_found_behind_garbage_and_across_reads() {
        let cut = Cut::Lengths(vec![(4, vec![0x55, 0xAA])]);
        assert_eq!(cut.find(&[]), (0, None));
        assert_eq!(cut.find(&[1, 2, 3]), (3, None));
        assert_eq!(cut.find(&[1, 0x55]), (1, None));
        assert_eq!(cut.find(&[0x55, 1, 0x55, 0xAA, 1]), (2, None));
        assert_eq!(cut.find(&[9, 0x55, 0xAA, 1, 2, 3]), (1, Some(4)));
        assert_eq!(Cut::Line.find(b"{}\n{"), (0, Some(3)));
        assert_eq!(Cut::Line.find(&[b'x'; LONGEST + 1]), (0, None));
    }

    /// Stream whose peer has written these bytes.
    fn arrived(bytes: &[u8], cut: Cut) -> (UnixStream, Stream) {
        let (mut peer, own) = UnixStream::pair().expect("a pair");
        own.set_nonblocking(true).expect("a socket");
        peer.write_all(bytes).expect("written");
        (peer, Stream::new(Source::Line, Some(End::Unix(own)), cut))
    }

    #[test]
    fn the_end_of_a_line_that_is_too_long_is_no_frame() {
        let text = [&[b'x'; 3 * LONGEST][..], b"{\"f\": 77}\n{\"f\": 1}\n"].concat();
        let (_peer, mut stream) = arrived(&text, Cut::Line);
        let mut buffer = [0; LONGEST + 1];
        let arrival = stream
            .receive(&mut buffer)
            .expect("received")
            .expect("a line");
        assert_eq!(&buffer[..arrival.length], b"{\"f\": 1}");
        assert_eq!(stream.receive(&mut buffer).expect("nothing more"), None);
        assert_eq!(stream.counts().skipped_bytes, 3 * LONGEST as u64 + 10);
    }

    #[test]
    fn a_false_beginning_is_given_back_except_its_first_byte() {
        let cut = Cut::Lengths(vec![(3, vec![0xAA])]);
        let (_peer, mut stream) = arrived(&[0xAA, 1, 0xAA, 2, 3], cut);
        let mut buffer = [0; LONGEST + 1];
        let mut receive = |stream: &mut Stream| {
            let arrival = stream.receive(&mut buffer).expect("received");
            arrival.map(|one| buffer[..one.length].to_vec())
        };
        assert_eq!(receive(&mut stream), Some(vec![0xAA, 1, 0xAA]));
        stream.reject();
        assert_eq!(receive(&mut stream), Some(vec![0xAA, 2, 3]));
        assert_eq!(stream.counts().skipped_bytes, 2);
    }
}
