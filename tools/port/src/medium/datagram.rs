//! Datagrams: UDP and sockets of this machine, one frame in each.

use std::io::{self, ErrorKind};
use std::mem::take;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hil_codec::frame::CanId;
use nix::sys::socket::setsockopt;
use nix::sys::socket::sockopt::{Ipv4RecvErr, Ipv6RecvErr};

use super::{Arrival, Medium, Tally};

/// Silence of the peer after which another sender may take its place.
const SILENCE: Duration = Duration::from_secs(1);
/// Most datagrams of others that are read before one of the peer. More are read on at the next step.
const MOST_STRANGERS: usize = 256;

/// UDP socket.
///
/// The peer is the first sender, if there is no address to send to or the sender has the IP address of that one: many
/// programs answer from another port than they listen at. A sender that is not the peer is counted; after a second
/// without a frame of the peer it takes the peer's place, as a restarted program does.
#[derive(Debug)]
pub(crate) struct Udp {
    socket: UdpSocket,
    /// Address that frames are sent to, if known.
    to: Option<SocketAddr>,
    /// `true` if that address is the peer's own and follows it.
    follows: bool,
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
            peer: None,
            reached_nobody: false,
            counts: Tally::default(),
        })
    }

    /// Returns `true` if a frame of this sender is one of the peer.
    fn admits(&mut self, from: SocketAddr) -> bool {
        let now = Instant::now();
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
    fn send(&mut self, _: Option<CanId>, bytes: &[u8]) -> io::Result<()> {
        let result = match self.to {
            Some(to) => self.socket.send_to(bytes, to),
            None => Err(ErrorKind::NotFound.into()),
        };
        self.reached_nobody |= absent_peer(result, &mut self.counts)?;
        Ok(())
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
                }
                Err(error) => return nothing(error),
            }
        }
        Ok(None)
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
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
    pub(crate) fn open(path: &str, listens: bool) -> io::Result<Self> {
        let path = Path::new(path);
        // A peer can only answer a socket that has a path.
        let own = match listens {
            true => path.to_owned(),
            false => PathBuf::from(format!("{}.hil-{}", path.display(), std::process::id())),
        };
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
}

impl Medium for Unix {
    fn send(&mut self, _: Option<CanId>, bytes: &[u8]) -> io::Result<()> {
        let result = match &self.to {
            Some(to) => self.socket.send_to(bytes, to),
            None => Err(ErrorKind::NotFound.into()),
        };
        self.reached_nobody |= absent_peer(result, &mut self.counts)?;
        Ok(())
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

/// Returns `true` if an error says that nobody listens at the address of an earlier datagram.
fn is_absence(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::ConnectionRefused | ErrorKind::NotFound | ErrorKind::ConnectionReset
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
}
