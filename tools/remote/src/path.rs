//! Path of datagrams: a UDP socket and the encryption of the datagrams. Datagrams from anyone else are ignored.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;

use crate::packet::Packet;
use crate::seal::{Datagrams, Seal};

/// Maximum number of datagrams processed in a row: a flood must not keep the loop from its other work.
const MOST_AT_ONCE: u32 = 32;
/// Maximum length of a datagram: a frame of 512 signals with its overhead.
const LONGEST: usize = 8192;

/// End of the datagram path.
pub(crate) struct DatagramPath {
    socket: Arc<UdpSocket>,
    datagrams: Datagrams,
    /// Address of the other end, from the newest authentic datagram.
    peer: Option<SocketAddr>,
    follows_peer: bool,
    buffer: Box<[u8; LONGEST]>,
}

/// Opens the target's socket, on the address through which the desk connected.
///
/// # Errors
/// If the socket cannot be opened.
pub(crate) fn listen(address: IpAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind((address, 0))?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

impl DatagramPath {
    /// Creates the target's end.
    pub(crate) fn target(socket: UdpSocket, seal: Seal) -> Self {
        Self::new(socket, seal, None)
    }

    /// Creates the desk's end.
    ///
    /// # Errors
    /// If no socket can be opened.
    pub(crate) fn desk(to: SocketAddr, seal: Seal) -> io::Result<Self> {
        let any: IpAddr = match to {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let socket = listen(any)?;
        // From then on the kernel discards datagrams from elsewhere.
        socket.connect(to)?;
        Ok(Self::new(socket, seal, Some(to)))
    }

    fn new(socket: UdpSocket, seal: Seal, peer: Option<SocketAddr>) -> Self {
        Self {
            socket: Arc::new(socket),
            datagrams: Datagrams::new(seal),
            follows_peer: peer.is_none(),
            peer,
            buffer: Box::new([0; LONGEST]),
        }
    }

    /// Returns the socket, to wait on.
    pub(crate) fn socket(&self) -> Arc<UdpSocket> {
        Arc::clone(&self.socket)
    }

    /// Sends a packet. A packet that cannot be sent counts as lost in transit.
    pub(crate) fn send(&mut self, packet: &[u8]) {
        let Some(peer) = self.peer else { return };
        let Ok(sealed) = self.datagrams.close(packet) else {
            return;
        };
        let _ = if self.follows_peer {
            self.socket.send_to(sealed, peer)
        } else {
            self.socket.send(sealed)
        };
    }

    /// Returns the next authentic packet, if there is one.
    pub(crate) fn receive(&mut self) -> Option<Packet> {
        for _ in 0..MOST_AT_ONCE {
            let (length, from) = match self.socket.recv_from(&mut self.buffer[..]) {
                Ok(received) => received,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return None,
                Err(_) => continue, // the refusal of a datagram is reported at the next call
            };
            let Ok((content, is_newest)) = self.datagrams.open(&self.buffer[..length]) else {
                continue;
            };
            if is_newest && self.follows_peer {
                self.peer = Some(from);
            }
            if let Some(packet) = Packet::read(content) {
                return Some(packet);
            }
        }
        None
    }
}
