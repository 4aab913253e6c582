//! Sockets of the operating system, as PX4, ArduPilot and most simulators use them.
//!
//! A payload is one datagram, or as many bytes of a stream. Spinning means that receiving does not
//! block. The plant's address is known before the controller starts; where it must know the
//! controller's, it is told by a file in the session's folder.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::time::Duration;

use hil_benchmark::exchange::End;
use hil_session::session::SessionInfo;
use shared_types::side::Side;

use super::peer::WAIT_LIMIT_S;
use super::{COMMAND_BYTES, Opened, SAMPLE_BYTES, Wait};

/// Files in the session's folder: addresses, or sockets themselves.
const PLANT: &str = "plant.address";
const CONTROLLER: &str = "controller.address";

/// A connected socket.
trait Socket {
    /// Sets whether receiving waits, but never for longer than the wait limit.
    fn set_wait(&self, wait: Wait) -> io::Result<()>;
    fn put(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Takes what is there, up to N bytes.
    fn take(&mut self, bytes: &mut [u8]) -> io::Result<usize>;
}

macro_rules! socket {
    ($type:ty, $send:ident, $receive:ident) => {
        impl Socket for $type {
            fn set_wait(&self, wait: Wait) -> io::Result<()> {
                self.set_read_timeout(Some(Duration::from_secs_f64(WAIT_LIMIT_S)))?;
                self.set_nonblocking(wait != Wait::Block)
            }

            fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
                // Of a datagram all goes or nothing.
                self.$send(bytes).map(drop)
            }

            fn take(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
                self.$receive(bytes)
            }
        }
    };
}

socket!(UnixStream, write_all, read);
socket!(TcpStream, write_all, read);
socket!(UnixDatagram, send, recv);
socket!(UdpSocket, send, recv);

/// End of a socket.
struct SocketEnd<S> {
    socket: S,
    outgoing: Vec<u8>,
    incoming: Vec<u8>,
    /// Bytes of the next payload that are here: a stream may bring it in parts.
    here: usize,
}

impl<S: Socket + 'static> SocketEnd<S> {
    fn boxed(socket: S, side: Side, wait: Wait) -> Box<dyn End> {
        let (outgoing, incoming) = match side {
            Side::Plant => (SAMPLE_BYTES, COMMAND_BYTES),
            Side::Controller => (COMMAND_BYTES, SAMPLE_BYTES),
        };
        socket.set_wait(wait).expect("a socket");
        Box::new(Self {
            socket,
            outgoing: vec![0; outgoing],
            incoming: vec![0; incoming],
            here: 0,
        })
    }
}

impl<S: Socket> End for SocketEnd<S> {
    fn send(&mut self, number: u64) {
        for word in self.outgoing.chunks_exact_mut(8) {
            word.copy_from_slice(&number.to_ne_bytes());
        }
        self.socket.put(&self.outgoing).expect("sends");
    }

    fn receive(&mut self) -> Option<u64> {
        match self.socket.take(&mut self.incoming[self.here..]) {
            Ok(0) => panic!("the other side is gone"),
            Ok(count) => self.here += count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => return None,
            Err(error) => panic!("{error}"),
        }
        if self.here < self.incoming.len() {
            return None;
        }
        self.here = 0;
        let last = std::hint::black_box(&self.incoming).last_chunk();
        last.map(|word| u64::from_ne_bytes(*word))
    }
}

pub(super) fn unix_stream(session: &SessionInfo, side: Side, wait: Wait) -> Opened {
    let path = session.folder.join(PLANT);
    match side {
        Side::Plant => {
            let listener = UnixListener::bind(path).expect("a socket");
            Box::new(move || {
                let (stream, _) = listener.accept().expect("the controller connected");
                SocketEnd::boxed(stream, side, wait)
            })
        }
        Side::Controller => {
            let stream = UnixStream::connect(path).expect("the plant listens");
            Box::new(move || SocketEnd::boxed(stream, side, wait))
        }
    }
}

pub(super) fn unix_datagram(session: &SessionInfo, side: Side, wait: Wait) -> Opened {
    let [plant, controller] = [PLANT, CONTROLLER].map(|name| session.folder.join(name));
    let (own, other) = match side {
        Side::Plant => (plant, controller),
        Side::Controller => (controller, plant),
    };
    let socket = UnixDatagram::bind(own).expect("a socket");
    Box::new(move || {
        socket.connect(other).expect("the other side is there");
        SocketEnd::boxed(socket, side, wait)
    })
}

pub(super) fn udp(session: &SessionInfo, side: Side, wait: Wait) -> Opened {
    let (own, other) = match side {
        Side::Plant => (PLANT, CONTROLLER),
        Side::Controller => (CONTROLLER, PLANT),
    };
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let address = socket.local_addr().expect("an address");
    session.write_file(own, &address).expect("writes");
    let session = session.clone();
    Box::new(move || {
        let address: SocketAddr = session.read_file(other).expect("the other side is there");
        socket.connect(address).expect("an address");
        SocketEnd::boxed(socket, side, wait)
    })
}

pub(super) fn tcp(session: &SessionInfo, side: Side, wait: Wait) -> Opened {
    let without_delay = move |stream: TcpStream| {
        stream.set_nodelay(true).expect("a socket");
        SocketEnd::boxed(stream, side, wait)
    };
    match side {
        Side::Plant => {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
            let address = listener.local_addr().expect("an address");
            session.write_file(PLANT, &address).expect("writes");
            Box::new(move || {
                let (stream, _) = listener.accept().expect("the controller connected");
                without_delay(stream)
            })
        }
        Side::Controller => {
            let address: SocketAddr = session.read_file(PLANT).expect("the plant listens");
            let stream = TcpStream::connect(address).expect("the plant listens");
            Box::new(move || without_delay(stream))
        }
    }
}
