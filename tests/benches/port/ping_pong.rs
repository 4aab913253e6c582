//! Bare UDP: the system calls of a port without the port, and a peer that answers.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// End of a bare ping-pong.
pub(crate) struct Bare {
    socket: UdpSocket,
    to: SocketAddr,
}

impl Bare {
    /// Opens an end to a peer.
    pub(crate) fn to(peer: &UdpSocket) -> Self {
        let socket = UdpSocket::bind("0.0.0.0:0").expect("a socket");
        socket.set_nonblocking(true).expect("a socket");
        let to = peer.local_addr().expect("an address");
        Self { socket, to }
    }

    /// Sends a datagram.
    pub(crate) fn send(&self, bytes: &[u8]) {
        self.socket.send_to(bytes, self.to).expect("sent");
    }

    /// Receives a datagram if there is one; returns `true` for one.
    pub(crate) fn receive(&self, buffer: &mut [u8]) -> bool {
        match self.socket.recv_from(buffer) {
            Ok(_) => true,
            Err(error) if error.kind() == ErrorKind::WouldBlock => false,
            Err(error) => panic!("{error}"),
        }
    }

    /// Waits for a datagram.
    pub(crate) fn wait(&self) {
        let limit = Timespec {
            tv_sec: 1,
            tv_nsec: 0,
        };
        let mut ends = [PollFd::new(&self.socket, PollFlags::IN)];
        poll(&mut ends, Some(&limit)).expect("waited");
    }
}

/// Answers so many datagrams with these bytes.
pub(crate) fn answer(peer: &UdpSocket, count: u64, mut bytes: impl FnMut() -> Vec<u8>) {
    let mut buffer = [0; 512];
    for _ in 0..count {
        let (_, from) = peer.recv_from(&mut buffer).expect("a sample");
        peer.send_to(&bytes(), from).expect("answered");
    }
}
