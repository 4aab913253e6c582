//! Datagrams: UDP and sockets of this machine, one frame in each.

mod unix;

use std::io::{self, ErrorKind, IoSliceMut};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV6, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::time::{Duration, Instant};

use hil_codec::frame::CanId;
use nix::cmsg_space;
use nix::sys::socket::sockopt::{Ipv4RecvErr, Ipv6RecvErr, RxqOvfl};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recv, recvmsg, setsockopt};
use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_recv_buffer_size_force};

use super::notes::Notes;
use super::{Arrival, LONGEST, Medium, Note, NoteKind, Outlet, Tally, To};

pub(super) use unix::Unix;

/// Silence of the peer after which another sender may take its place.
const SILENCE: Duration = Duration::from_secs(1);
/// Most datagrams of others that are read before one of the peer. More are read on at the next step.
const MOST_STRANGERS: usize = 256;
/// Most datagrams that are known to have reached nobody in one step.
const MOST_LOST: usize = 64;
/// Number of datagrams of others after which the kernel is asked to drop them, so that they take no room from the peer's.
const FLOOD: u64 = 4096;
/// Bytes of the receive buffer, of which the kernel makes twice as many: room for as many short datagrams as one step
/// reads. A larger one would let a step read what is older than the newest.
const RECEIVE_BUFFER: usize = 3 << 19;

/// UDP socket.
///
/// The peer is the sender at the address that frames are sent to. Until that one has sent a frame it is the first sender
/// with the same IP address, because many programs answer from another port than they listen at; without an address to
/// send to it is the first sender. A sender that is not the peer is counted; after a second
/// without a frame of the peer it takes the peer's place, as a restarted program does. The address that frames are sent to
/// loses its place to nobody, so that the kernel can drop the frames of others once they are many.
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
    /// `true` if the kernel drops the frames of others.
    is_closed: bool,
    /// First sender other than the peer.
    first_other: Option<String>,
    /// Room for the count of dropped datagrams, which comes with one that arrives.
    control: Vec<u8>,
    counts: Tally,
    notes: Notes,
}

impl Udp {
    fn new(socket: UdpSocket, to: Option<SocketAddr>) -> Self {
        Self {
            socket,
            to,
            follows: to.is_none(),
            is_owned: false,
            peer: None,
            lost: Vec::new(),
            is_closed: false,
            first_other: None,
            control: cmsg_space!(u32),
            counts: Tally::default(),
            notes: Notes::default(),
        }
    }

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
        setsockopt(&socket, RxqOvfl, &1)?;
        enlarge(&socket);
        Ok(Self::new(socket, to))
    }

    /// Makes a medium that sends on an open socket.
    pub(super) fn adopt(socket: UdpSocket, to: SocketAddr) -> Self {
        Self::new(socket, Some(to))
    }

    /// Receives a datagram; returns its length, which may be more than the buffer's, and its sender.
    fn receive_from(&mut self, buffer: &mut [u8]) -> io::Result<(usize, Option<SocketAddr>)> {
        let flags = MsgFlags::MSG_TRUNC | MsgFlags::MSG_DONTWAIT;
        let mut parts = [IoSliceMut::new(buffer)];
        let fd = self.socket.as_raw_fd();
        let message = recvmsg::<SockaddrStorage>(fd, &mut parts, Some(&mut self.control), flags)?;
        for control in message.cmsgs().into_iter().flatten() {
            if let ControlMessageOwned::RxqOvfl(dropped) = control {
                // The kernel counts in 32 bits.
                let since = dropped.wrapping_sub(self.counts.dropped as u32);
                self.counts.dropped += u64::from(since);
                self.notes.add(NoteKind::Dropped, &[], || {
                    "the receive buffer was full, so that the kernel has dropped frames".into()
                });
            }
        }
        let from = message.address.and_then(|address| {
            let of_v4 = address.as_sockaddr_in().map(|v4| SocketAddr::from(*v4));
            of_v4.or_else(|| Some(SocketAddrV6::from(*address.as_sockaddr_in6()?).into()))
        });
        Ok((message.bytes, from))
    }

    /// Counts a datagram of another sender.
    fn note_other(&mut self, from: Option<SocketAddr>, datagram: &[u8]) {
        self.counts.strangers += 1;
        if self.first_other.is_none() {
            let other = from.map_or_else(|| "an unknown address".into(), |from| from.to_string());
            let peer = self.peer.map(|(peer, _)| peer).or(self.to);
            self.notes
                .add(NoteKind::OtherSender, datagram, || match peer {
                    Some(peer) => format!("a frame of {other}, while the peer is {peer}"),
                    None => format!("a frame of {other}"),
                });
            self.first_other = Some(other);
        }
        // An address that has its place for good.
        if self.is_owned && !self.is_closed && self.counts.strangers >= FLOOD {
            // The frames of others are read and dropped here if the kernel cannot do it.
            self.is_closed = self.to.is_some_and(|to| self.socket.connect(to).is_ok());
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

    fn note_new_peer(&mut self, before: SocketAddr, peer: SocketAddr) {
        self.counts.new_peers += 1;
        self.notes.add(NoteKind::NewPeer, &[], || {
            format!("{peer} takes the place of the peer {before}")
        });
    }

    /// Returns `true` if a frame of this sender is one of the peer.
    fn admits(&mut self, from: SocketAddr) -> bool {
        let now = Instant::now();
        // The address that frames are sent to is the peer, whoever spoke before.
        if !self.follows && self.to == Some(from) {
            if let Some((peer, _)) = self.peer.filter(|(peer, _)| *peer != from) {
                self.note_new_peer(peer, from);
            }
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
            (peer != from).then_some((peer, now.duration_since(at) < SILENCE))
        };
        match self.peer.and_then(is_other) {
            _ if is_elsewhere => return false,
            Some((_, true)) => return false,
            Some((peer, false)) => self.note_new_peer(peer, from),
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
            match self.receive_from(buffer) {
                Ok((size, from)) => {
                    let length = size.min(buffer.len());
                    if from.is_some_and(|from| self.admits(from)) {
                        let id = None;
                        return Ok(Some(Arrival { length, size, id }));
                    }
                    self.note_other(from, &buffer[..length]);
                }
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

    fn first_other(&self) -> Option<&str> {
        self.first_other.as_deref()
    }

    fn take_notes(&mut self) -> Vec<Note> {
        self.notes.take()
    }
}

/// Gives a socket room for the frames of a fast sender: without the right to more, as much as any user may have.
pub(super) fn enlarge(socket: impl AsFd) {
    if set_socket_recv_buffer_size_force(&socket, RECEIVE_BUFFER).is_err() {
        // The kernel's own size is a smaller one.
        let _ = set_socket_recv_buffer_size(&socket, RECEIVE_BUFFER);
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
mod tests;
