//! Datagrams: UDP and sockets of this machine, one frame in each.

use std::io::{self, ErrorKind};
use std::mem::take;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hil_codec::frame::CanId;
use nix::sys::socket::sockopt::{Ipv4RecvErr, Ipv6RecvErr};
use nix::sys::socket::{MsgFlags, recv, setsockopt};

use super::{Arrival, Medium, Outlet, Tally, To};

/// Silence of the peer after which another sender may take its place.
const SILENCE: Duration = Duration::from_secs(1);
/// Most datagrams of others that are read before one of the peer. More are read on at the next step.
const MOST_STRANGERS: usize = 256;

/// UDP socket.
///
/// The peer is the sender at the address that frames are sent to. Until that one has sent a frame it is the first sender
/// with the same IP address, because many programs answer from another port than they listen at; without an address to
/// send to it is the first sender. A sender that is not the peer is counted; after a second
/// without a frame of the peer it takes the peer's place, as a restarted program does.
#[derive(Debug)]
pub(crate) struct Udp {
    socket: UdpSocket,
    /// Address that frames are sent to, if known.
    to: Option<SocketAddr>,
    /// `true` if that address is the peer's own and follows it.
    follows: bool,
    /// `true` if the address that frames are sent to has sent one itself, and so is the peer.
    is_owned: bool,
    /// Address of the last accepted frame, and when it came.
    peer: Option<(SocketAddr, Instant)>,
    reached_nobody: bool,
    counts: Tally,
}

impl Udp {
    pub(crate) fn open(to: Option<SocketAddr>, listen: Option<SocketAddr>) -> io::Result<Self> {
        let any = |to: SocketAddr| match to {
            SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
            SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
        };
        let own = listen.or(to.map(any)).ok_or(ErrorKind::InvalidInput)?;
        let socket = UdpSocket::bind(own)?;
        socket.set_nonblocking(true)?;
        // Without it Linux does not say that nobody listens at an address.
        match own {
            SocketAddr::V4(_) => setsockopt(&socket, Ipv4RecvErr, &true)?,
            SocketAddr::V6(_) => setsockopt(&socket, Ipv6RecvErr, &true)?,
        }
        Ok(Self {
            socket,
            to,
            follows: to.is_none(),
            is_owned: false,
            peer: None,
            reached_nobody: false,
            counts: Tally::default(),
        })
    }

    /// Makes a medium that sends on an open socket.
    pub(super) fn adopt(socket: UdpSocket, to: SocketAddr) -> Self {
        Self {
            socket,
            to: Some(to),
            follows: false,
            is_owned: false,
            peer: None,
            reached_nobody: false,
            counts: Tally::default(),
        }
    }

    /// Empties the queue of errors, which shares the receive buffer and would keep the socket awake.
    fn forget_errors(&self) {
        let flags = MsgFlags::MSG_ERRQUEUE | MsgFlags::MSG_DONTWAIT;
        while recv(self.socket.as_raw_fd(), &mut [0; 1], flags).is_ok() {}
    }

    /// Returns `true` if a frame of this sender is one of the peer.
    fn admits(&mut self, from: SocketAddr) -> bool {
        let now = Instant::now();
        // The address that frames are sent to is the peer, whoever spoke before.
        if !self.follows && self.to == Some(from) {
            let replaces = self.peer.is_some_and(|(peer, _)| peer != from);
            self.counts.new_peers += u64::from(replaces);
            self.peer = Some((from, now));
            self.is_owned = true;
            return true;
        }
        if self.is_owned {
            return false;
        }
        let is_elsewhere = self
            .to
            .is_some_and(|to| !self.follows && to.ip() != from.ip());
        let is_other = |(peer, at): (SocketAddr, Instant)| {
            (peer != from).then_some(now.duration_since(at) < SILENCE)
        };
        match self.peer.and_then(is_other) {
            _ if is_elsewhere => return false,
            Some(true) => return false,
            Some(false) => self.counts.new_peers += 1,
            None => {}
        }
        self.peer = Some((from, now));
        if self.follows {
            self.to = Some(from);
        }
        true
    }
}

impl Medium for Udp {
    fn send(&mut self, _: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        let result = match self.to {
            Some(to) => self.socket.send_to(bytes, to),
            None => Err(ErrorKind::NotFound.into()),
        };
        let is_absent = absent_peer(result, &mut self.counts)?;
        if is_absent {
            self.reached_nobody = true;
            self.forget_errors();
        }
        Ok(!is_absent)
    }

    fn has_reached_nobody(&mut self) -> bool {
        take(&mut self.reached_nobody)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        for _ in 0..MOST_STRANGERS {
            match self.socket.recv_from(buffer) {
                Ok((length, from)) if self.admits(from) => {
                    return Ok(Some(Arrival { length, id: None }));
                }
                Ok(_) => self.counts.strangers += 1,
                // The answer to an earlier datagram: nobody listens there.
                Err(error) if is_absence(&error) => {
                    self.counts.unsent += 1;
                    self.reached_nobody = true;
                    self.forget_errors();
                }
                Err(error) => return nothing(error),
            }
        }
        Ok(None)
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        Some(Outlet {
            fd: self.socket.as_fd(),
            to: To::Address(self.to?),
            connection: 0,
        })
    }

    fn counts(&self) -> Tally {
        self.counts
    }
}

/// Socket of this machine with datagrams.
#[derive(Debug)]
pub(crate) struct Unix {
    socket: UnixDatagram,
    /// Path of the peer, if known.
    to: Option<PathBuf>,
    /// Path of a socket that this port made.
    own: PathBuf,
    reached_nobody: bool,
    counts: Tally,
}

impl Unix {
    pub(crate) fn open(path: &Path, listens: bool) -> io::Result<Self> {
        // A peer can only answer a socket that has a path.
        let own = match listens {
            true => path.to_owned(),
            false => PathBuf::from(format!("{}.hil-{}", path.display(), std::process::id())),
        };
        remove_if_left(&own);
        let socket = UnixDatagram::bind(&own)?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            to: (!listens).then(|| path.to_owned()),
            own,
            reached_nobody: false,
            counts: Tally::default(),
        })
    }

    /// Makes a medium that sends on an open socket, whose own path it removes at its end.
    pub(super) fn adopt(socket: UnixDatagram, to: PathBuf) -> Self {
        let address = socket.local_addr().ok();
        let own = address.and_then(|address| address.as_pathname().map(Path::to_owned));
        Self {
            socket,
            to: Some(to),
            own: own.unwrap_or_default(),
            reached_nobody: false,
            counts: Tally::default(),
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
        self.reached_nobody |= is_absent;
        Ok(!is_absent)
    }

    fn has_reached_nobody(&mut self) -> bool {
        take(&mut self.reached_nobody)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        match self.socket.recv_from(buffer) {
            Ok((length, from)) => {
                if let Some(path) = from.as_pathname() {
                    let is_other = self.to.as_deref().is_some_and(|to| to != path);
                    if is_other {
                        self.counts.strangers += 1;
                        return Ok(None);
                    }
                    self.to.get_or_insert_with(|| path.to_owned());
                }
                Ok(Some(Arrival { length, id: None }))
            }
            Err(error) => nothing(error),
        }
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
}

impl Drop for Unix {
    fn drop(&mut self) {
        // One that is gone already needs no removal.
        let _ = std::fs::remove_file(&self.own);
    }
}

/// Removes the path of a socket that nobody has open, as a killed port leaves it.
pub(super) fn remove_if_left(path: &Path) {
    let is_socket =
        std::fs::symlink_metadata(path).is_ok_and(|of_path| of_path.file_type().is_socket());
    // A socket of either type refuses if nobody has it open; else it accepts, or is of the other type.
    let is_left = || {
        UnixDatagram::unbound()
            .and_then(|socket| socket.connect(path))
            .is_err_and(|error| error.kind() == ErrorKind::ConnectionRefused)
    };
    if is_socket && is_left() {
        // Without it `bind` fails, and says so.
        let _ = std::fs::remove_file(path);
    }
}

/// Returns `true` if an error says that nobody listens at the address of an earlier datagram.
fn is_absence(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::ConnectionRefused
            | ErrorKind::NotFound
            | ErrorKind::ConnectionReset
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
    )
}

/// Counts a frame that a peer does not read, and returns `true` for it.
fn absent_peer(result: io::Result<usize>, counts: &mut Tally) -> io::Result<bool> {
    match result {
        Ok(_) => Ok(false),
        Err(error) if is_absence(&error) || error.kind() == ErrorKind::WouldBlock => {
            counts.unsent += 1;
            Ok(true)
        }
        Err(error) => Err(error),
    }
}

/// Returns `None` where nothing has arrived.
pub(super) fn nothing<T>(error: io::Error) -> io::Result<Option<T>> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(None),
        _ => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_of_the_peer_is_found_behind_those_of_another_sender() {
        let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let other = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let mut udp = Udp::open(peer.local_addr().ok(), None).expect("a socket");
        let own = udp.socket.local_addr().expect("an address").port();
        let to = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
        let mut buffer = [0; 8];
        peer.send_to(b"first", to).expect("sent");
        let arrival = udp.receive(&mut buffer).expect("received");
        assert_eq!(arrival.map(|one| one.length), Some(5));
        for _ in 0..3 {
            other.send_to(b"other", to).expect("sent");
        }
        peer.send_to(b"next", to).expect("sent");
        let arrival = udp.receive(&mut buffer).expect("received");
        assert_eq!(arrival.map(|one| one.length), Some(4));
        assert_eq!(&buffer[..4], b"next");
        assert_eq!(udp.counts().strangers, 3);
    }

    #[test]
    fn datagrams_arrive_after_many_that_reached_nobody() {
        let absent = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let to = absent.local_addr().expect("an address");
        drop(absent);
        let mut udp = Udp::open(Some(to), None).expect("a socket");
        let own = udp.socket.local_addr().expect("an address").port();
        let mut buffer = [0; 512];
        for _ in 0..2000 {
            udp.send(None, &[0; 256]).expect("absence is no error");
            assert_eq!(udp.receive(&mut buffer).expect("no error"), None);
        }
        assert!(udp.has_reached_nobody());
        let peer = UdpSocket::bind(to).expect("a socket");
        let own = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
        for _ in 0..2 {
            peer.send_to(&[1; 256], own).expect("sent");
        }
        for _ in 0..2 {
            let arrival = udp.receive(&mut buffer).expect("received");
            assert_eq!(arrival.map(|one| one.length), Some(256));
        }
    }
}
