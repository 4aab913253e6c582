//! The path of datagrams: a UDP socket and their seals. What is not the other end's is passed over.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;

use crate::packet::Packet;
use crate::seal::{Datagrams, Seal};

/// Most datagrams that are looked at in a row: a flood must not keep the loop from its other work.
const MOST_AT_ONCE: u32 = 32;
/// Longest datagram: a frame of 512 signals, and what is around it.
const LONGEST: usize = 8192;

/// End of the path of datagrams.
pub(crate) struct DatagramPath {
    socket: Arc<UdpSocket>,
    datagrams: Datagrams,
    /// Address of the other end, as the newest authentic datagram had it.
    peer: Option<SocketAddr>,
    follows_peer: bool,
    buffer: Box<[u8; LONGEST]>,
}

/// Opens the target's socket, on the address that the desk reached.
///
/// # Errors
/// If it cannot be opened.
pub(crate) fn listen(address: IpAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind((address, 0))?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

impl DatagramPath {
    /// The target's end.
    pub(crate) fn target(socket: UdpSocket, seal: Seal) -> Self {
        Self::new(socket, seal, None)
    }

    /// The desk's end.
    ///
    /// # Errors
    /// If no socket can be opened.
    pub(crate) fn desk(to: SocketAddr, seal: Seal) -> io::Result<Self> {
        let any: IpAddr = match to {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let socket = listen(any)?;
        // From then on the kernel passes over what comes from elsewhere.
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

    /// The socket, to sleep on.
    pub(crate) fn socket(&self) -> Arc<UdpSocket> {
        Arc::clone(&self.socket)
    }

    /// Sends a packet. One that cannot be sent is lost, as any may be.
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

    /// The next authentic packet, if there is one.
    pub(crate) fn receive(&mut self) -> Option<Packet> {
        for _ in 0..MOST_AT_ONCE {
            let (length, from) = match self.socket.recv_from(&mut self.buffer[..]) {
                Ok(received) => received,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return None,
                Err(_) => continue, // a refused datagram comes back as an error of the next
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
