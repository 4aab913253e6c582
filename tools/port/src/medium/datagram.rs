//! Datagrams: UDP and sockets of this machine, one frame in each.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hil_codec::frame::CanId;
use nix::sys::socket::sockopt::{Ipv4RecvErr, Ipv6RecvErr};
use nix::sys::socket::{MsgFlags, recv, setsockopt};

use super::socket_path::{SocketPath, is_same};
use super::{Arrival, LONGEST, Medium, Outlet, Tally, To};

/// Silence of the peer after which another sender may take its place.
const SILENCE: Duration = Duration::from_secs(1);
/// Most datagrams of others that are read before one of the peer. More are read on at the next step.
const MOST_STRANGERS: usize = 256;
/// Most datagrams that are known to have reached nobody in one step.
const MOST_LOST: usize = 64;

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
    /// Datagrams of this step that reached nobody, as far as the network gives their bytes back: a host of this machine
    /// all, a distant one the beginning, or nothing.
    lost: Vec<Vec<u8>>,
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
            lost: Vec::new(),
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
            lost: Vec::new(),
            counts: Tally::default(),
        }
    }

    /// Empties the queue of errors, which shares the receive buffer and would keep the socket awake, and keeps the
    /// datagrams in it; returns `true` if there was one.
    fn collect_lost(&mut self) -> bool {
        let flags = MsgFlags::MSG_ERRQUEUE | MsgFlags::MSG_DONTWAIT;
        let mut datagram = [0; LONGEST];
        let mut is_known = false;
        while let Ok(length) = recv(self.socket.as_raw_fd(), &mut datagram, flags) {
            self.note_lost(&datagram[..length]);
            is_known = true;
        }
        is_known
    }

    /// Notes a datagram that reached nobody; without bytes it may be any.
    fn note_lost(&mut self, datagram: &[u8]) {
        self.counts.unsent += 1;
        if self.lost.len() < MOST_LOST {
            self.lost.push(datagram.to_vec());
        }
    }

    /// Returns `true` if a datagram of these bytes is known to have reached nobody in this step; the bytes before a place
    /// are not compared.
    pub(crate) fn has_lost(&self, datagram: &[u8], from: usize) -> bool {
        let end = datagram.get(from..).unwrap_or_default();
        let mut lost = self.lost.iter();
        lost.any(|lost| end.starts_with(lost.get(from..).unwrap_or_default()))
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
        let Some(to) = self.to else {
            self.counts.unsent += 1;
            return Ok(false);
        };
        let mut result = self.socket.send_to(bytes, to);
        // The answer to an earlier datagram: this one was not sent.
        if result.as_ref().is_err_and(is_absence) {
            let is_known = self.collect_lost();
            result = self.socket.send_to(bytes, to);
            if !is_known && result.is_ok() {
                // The queue has no room for an error while the buffer is full.
                self.note_lost(&[]);
            }
        }
        let is_absent = absent_peer(result, &mut self.counts)?;
        Ok(!is_absent)
    }

    fn has_reached_nobody(&self, _: Option<CanId>, bytes: &[u8]) -> bool {
        self.has_lost(bytes, 0)
    }

    fn forget_lost(&mut self) {
        self.lost.clear();
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
                    if !self.collect_lost() {
                        self.note_lost(&[]);
                    }
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
    own: SocketPath,
    socket: UnixDatagram,
    /// Path of the peer, if known.
    to: Option<PathBuf>,
    counts: Tally,
}

impl Unix {
    pub(crate) fn open(path: &Path, listens: bool) -> io::Result<Self> {
        // A peer can only answer a socket that has a path.
        let path_of_own = match listens {
            true => path.to_owned(),
            false => PathBuf::from(format!("{}.hil-{}", path.display(), std::process::id())),
        };
        let (own, socket) = SocketPath::bind(&path_of_own, |path| UnixDatagram::bind(path))?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            own,
            socket,
            to: (!listens).then(|| path.to_owned()),
            counts: Tally::default(),
        })
    }

    /// Makes a medium that sends on an open socket.
    pub(super) fn adopt(socket: UnixDatagram, to: PathBuf) -> Self {
        Self {
            own: SocketPath::of_another(),
            socket,
            to: Some(to),
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
        Ok(!is_absent)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        for _ in 0..MOST_STRANGERS {
            let (length, from) = match self.socket.recv_from(buffer) {
                Ok(arrival) => arrival,
                Err(error) => return nothing(error),
            };
            if let Some(name) = from.as_pathname() {
                // Its name is what it was bound with, which may be relative, or lead over another folder.
                let path = self.own.resolve(name);
                if !is_same(self.to.get_or_insert_with(|| path.clone()), &path) {
                    self.counts.strangers += 1;
                    continue;
                }
            }
            return Ok(Some(Arrival { length, id: None }));
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
        assert!(udp.has_reached_nobody(None, &[0; 256]));
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

    #[test]
    fn a_datagram_that_reached_nobody_is_known_by_its_bytes() {
        let absent = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let to = absent.local_addr().expect("an address");
        drop(absent);
        let mut udp = Udp::open(Some(to), None).expect("a socket");
        assert!(udp.send(None, b"first").expect("not known yet"));
        let peer = UdpSocket::bind(to).expect("a socket");
        assert!(udp.send(None, b"second").expect("sent"));
        let mut buffer = [0; 8];
        assert_eq!(peer.recv(&mut buffer).expect("received"), 6);
        assert_eq!(udp.receive(&mut buffer).expect("nothing"), None);
        assert!(udp.has_reached_nobody(None, b"first"));
        assert!(!udp.has_reached_nobody(None, b"second"));
        assert_eq!(udp.counts().unsent, 1);
    }

    #[test]
    fn the_path_of_a_socket_stays_if_another_program_has_bound_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("shared");
        let own = Unix::open(&path, true).expect("bound");
        std::fs::remove_file(&path).expect("removed");
        let _other = UnixDatagram::bind(&path).expect("bound by another program");
        drop(own);
        assert!(path.exists());
    }

    #[test]
    fn a_peer_is_the_same_under_another_path_of_its_socket() {
        let folder = tempfile::tempdir().expect("a folder");
        let [real, link] = ["real", "link"].map(|name| folder.path().join(name));
        std::fs::create_dir(&real).expect("a folder");
        std::os::unix::fs::symlink(&real, &link).expect("a link");
        let peer = UnixDatagram::bind(real.join("peer")).expect("bound");
        let mut own = Unix::open(&link.join("peer"), false).expect("bound");
        let other = UnixDatagram::bind(real.join("other")).expect("bound");
        own.send(None, b"sample").expect("sent");
        let mut buffer = [0; 8];
        let (_, from) = peer.recv_from(&mut buffer).expect("received");
        let path = from.as_pathname().expect("a path");
        other.send_to(b"stranger", path).expect("sent");
        peer.send_to(b"command", path).expect("sent");
        let arrival = own.receive(&mut buffer).expect("received");
        assert_eq!(arrival.map(|one| one.length), Some(7));
        assert_eq!(own.counts().strangers, 1);
    }
}
