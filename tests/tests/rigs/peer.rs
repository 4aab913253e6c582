//! Far end of a port, written from the book's page alone: a mass on a spring in real time, and the independent receiver
//! of what is on the wire.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::unix::net::{UnixDatagram, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::pty::ptsname;
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::can::{self, CanLine};
use crate::pseudo_terminal::open_terminal;
use crate::support::harness::{Rig, text, until};

/// Safe force in N, which no controller of these tests commands.
pub(super) const SAFE_N: f64 = -0.25;
/// Number of times that the safe frame is sent.
pub(super) const REPEATS: usize = 5;
/// First byte of every frame.
pub(super) const SYNC: u8 = 0xA5;
/// Bytes of a command: first byte, counter and force.
pub(super) const COMMAND: usize = 10;

/// Command on the wire.
#[derive(Clone, Copy, Debug)]
pub(super) struct Received {
    pub(super) at: Instant,
    pub(super) counter: u8,
    pub(super) force_n: f64,
}

/// Own end of a wire; nothing blocks.
pub(super) enum Line {
    Udp(UdpSocket, String),
    Tcp(TcpListener, Option<TcpStream>),
    Can(CanLine),
    Unix(PathBuf, Option<UnixStream>),
    /// Socket with a path, and that of the port once it has sent something.
    Datagrams(UnixDatagram, Option<PathBuf>),
    /// Holder of a pseudo-terminal, and its other end, which keeps what the port wrote after the port's end.
    Serial {
        holder: File,
        _other: File,
    },
}

impl Line {
    fn read(&mut self, buffer: &mut [u8]) -> usize {
        let result = match self {
            Self::Udp(socket, _) => socket.recv(buffer),
            Self::Tcp(listener, end) => {
                if let Ok((stream, _)) = listener.accept() {
                    stream.set_nonblocking(true).expect("a socket");
                    *end = Some(stream);
                }
                (end.as_mut()).map_or(Err(ErrorKind::WouldBlock.into()), |end| end.read(buffer))
            }
            Self::Unix(path, end) => {
                if end.is_none() {
                    *end = UnixStream::connect(path).ok();
                    if let Some(stream) = end {
                        stream.set_nonblocking(true).expect("a socket");
                    }
                }
                (end.as_mut()).map_or(Err(ErrorKind::WouldBlock.into()), |end| end.read(buffer))
            }
            Self::Datagrams(socket, port) => socket.recv_from(buffer).map(|(count, from)| {
                *port = from.as_pathname().map(Path::to_owned);
                count
            }),
            Self::Can(line) => line.read(buffer),
            Self::Serial { holder, .. } => holder.read(buffer),
        };
        // A refused connection or a closed line is nothing to end for.
        result.unwrap_or(0)
    }

    fn write(&mut self, bytes: &[u8]) {
        let _ = match self {
            Self::Udp(socket, to) => socket.send_to(bytes, &*to).map(|_| ()),
            Self::Tcp(_, end) => end.as_mut().map_or(Ok(()), |end| end.write_all(bytes)),
            Self::Unix(_, end) => end.as_mut().map_or(Ok(()), |end| end.write_all(bytes)),
            Self::Datagrams(socket, port) => port
                .as_ref()
                .map_or(Ok(()), |port| socket.send_to(bytes, port).map(|_| ())),
            Self::Can(line) => line.write(bytes),
            Self::Serial { holder, .. } => holder.write_all(bytes),
        };
    }
}

/// Returns an address of this machine that is free.
pub(super) fn free() -> String {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("an address").to_string()
}

/// Rig of the tests.
pub(super) struct Peer {
    ends: Arc<AtomicBool>,
    /// `true` if the rig sends nothing.
    pub(super) is_silent: Arc<AtomicBool>,
    received: Arc<Mutex<Vec<Received>>>,
    thread: Option<JoinHandle<()>>,
    /// Keys of the medium in the port file.
    pub(super) medium: String,
}

impl Peer {
    /// Starts a rig behind UDP.
    pub(super) fn start() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        socket.set_nonblocking(true).expect("a socket");
        let (own, port) = (socket.local_addr().expect("an address"), free());
        let medium = format!("kind = \"udp\"\nto = \"{own}\"\nlisten = \"{port}\"");
        Self::on(Line::Udp(socket, port), medium)
    }

    /// Starts a rig behind TCP, which listens.
    pub(super) fn on_tcp() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
        listener.set_nonblocking(true).expect("a socket");
        let own = listener.local_addr().expect("an address");
        let medium = format!("kind = \"tcp\"\nconnect = \"{own}\"");
        Self::on(Line::Tcp(listener, None), medium)
    }

    /// Starts a rig on CAN.
    pub(super) fn on_can(line: CanLine, medium: String) -> Self {
        Self::on(Line::Can(line), medium)
    }

    /// Starts a rig behind a socket that the port makes.
    pub(super) fn on_unix(path: PathBuf) -> Self {
        let medium = format!(
            "kind = \"unix\"\npath = {:?}\nsocket = \"stream\"\nlistens = true",
            text(&path)
        );
        Self::on(Line::Unix(path, None), medium)
    }

    /// Starts a rig that has a socket of datagrams.
    pub(super) fn on_datagrams(path: &Path) -> Self {
        let socket = UnixDatagram::bind(path).expect("a socket");
        socket.set_nonblocking(true).expect("a socket");
        let medium = format!("kind = \"unix\"\npath = {:?}", text(path));
        Self::on(Line::Datagrams(socket, None), medium)
    }

    /// Starts a rig behind a serial line.
    pub(super) fn on_serial() -> Self {
        let (holder, other) = open_terminal(80, 24);
        let flags = fcntl_getfl(&holder).expect("a terminal");
        fcntl_setfl(&holder, flags | OFlags::NONBLOCK).expect("a terminal");
        // A line has no echo.
        let mut settings = tcgetattr(&other).expect("a terminal");
        settings.make_raw();
        tcsetattr(&other, OptionalActions::Now, &settings).expect("a terminal");
        let device = ptsname(&holder, Vec::new()).expect("a terminal");
        let medium = format!(
            "kind = \"serial\"\ndevice = {:?}",
            device.to_str().expect("text")
        );
        let line = Line::Serial {
            holder: holder.into(),
            _other: other.into(),
        };
        Self::on(line, medium)
    }

    fn on(mut line: Line, medium: String) -> Self {
        let [ends, is_silent] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let received = Arc::default();
        let flags = (Arc::clone(&ends), Arc::clone(&is_silent));
        let list = Arc::clone(&received);
        let thread = std::thread::spawn(move || swing(&mut line, &flags.0, &flags.1, &list));
        Self {
            ends,
            is_silent,
            received,
            thread: Some(thread),
            medium,
        }
    }

    pub(super) fn received(&self) -> Vec<Received> {
        self.received.lock().expect("a list").clone()
    }

    /// Returns the number of safe frames since the last other one.
    fn safe_frames(&self) -> usize {
        let received = self.received();
        let is_safe = |one: &&Received| one.force_n == SAFE_N;
        received.iter().rev().take_while(is_safe).count()
    }

    /// Waits for a command of the controller.
    pub(super) fn until_commanded(&self) {
        until("a command", || {
            self.received().iter().any(|one| one.force_n != SAFE_N)
        });
    }

    /// Waits for the safe frames that follow the last command; returns the time of the first.
    pub(super) fn until_safe(&self) -> Instant {
        until("safe frames", || self.safe_frames() >= REPEATS);
        let received = self.received();
        received[received.len() - self.safe_frames()].at
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Integrates `x'' = F - 2 x' - 100 x` in real time with steps of 1 ms, and sends the state every 5 ms.
fn swing(line: &mut Line, ends: &AtomicBool, is_silent: &AtomicBool, list: &Mutex<Vec<Received>>) {
    let (mut x_m, mut v_mps, mut force_n) = (0.0, 0.0, 0.0);
    let (begin, mut done_ms, mut counter) = (Instant::now(), 0, 0u8);
    let mut arrived = Vec::new();
    while !ends.load(Ordering::Relaxed) {
        let mut buffer = [0; 512];
        loop {
            let count = line.read(&mut buffer);
            if count == 0 {
                break;
            }
            arrived.extend(&buffer[..count]);
        }
        while arrived.len() >= COMMAND {
            let frame: Vec<u8> = arrived.drain(..COMMAND).collect();
            assert_eq!(frame[0], SYNC);
            force_n = f64::from_le_bytes(frame[2..].try_into().expect("8 bytes"));
            list.lock().expect("a list").push(Received {
                at: Instant::now(),
                counter: frame[1],
                force_n,
            });
        }
        let now_ms = begin.elapsed().as_millis();
        while done_ms < now_ms {
            v_mps += 1e-3 * (force_n - 2.0 * v_mps - 100.0 * x_m);
            x_m += 1e-3 * v_mps;
            done_ms += 1;
            if done_ms % 5 == 0 && done_ms + 5 > now_ms && !is_silent.load(Ordering::Relaxed) {
                let mut state = vec![SYNC, counter];
                state.extend(f64::to_le_bytes(x_m));
                state.extend(f64::to_le_bytes(v_mps));
                counter = counter.wrapping_add(1);
                line.write(&state);
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Writes the port file of a rig, with more keys at its beginning.
pub(super) fn write_port(rig: &Rig, medium: &str, more: &str) {
    let [of_state, of_drive] = can::keys(medium);
    let port_file = format!(
        r#"port = 1
name = "spring-mass"
{more}

[[media]]
{medium}

[[frames]]
name = "state"
carries = "sample"
stale_s = 0.5
{of_state}fields = [
    {{ kind = "constant", type = "u8", value = {SYNC} }},
    {{ kind = "counter", type = "u8", max_jump = 250 }},
    {{ signal = "measured.position_m", type = "f64" }},
    {{ signal = "measured.velocity_mps", type = "f64" }},
]

[[frames]]
name = "drive"
carries = "command"
{of_drive}fields = [
    {{ kind = "constant", type = "u8", value = {SYNC} }},
    {{ kind = "counter", type = "u8" }},
    {{ signal = "command.force_n", type = "f64", safe = {SAFE_N} }},
]
"#
    );
    rig.write("rig.port.toml", &port_file);
}

/// Writes a scenario of the port, and returns its path. The section of the controller is that of an emulated plant.
pub(super) fn scenario(rig: &Rig, duration_s: f64, more: &str) -> String {
    let scenario = format!(
        r#"schema = 1
name = "rig"
[run]
duration_s = {duration_s:?}
rate_hz = 100
clock = "realtime"
[plant]
model = "spring-mass"
program = "rig.port.toml"
[plant.limits]
position_m = [-1.0, 1.0]
[controller]
law = "pid"
[controller.pid]
proportional_n_per_m = 40.0
integral_n_per_m_s = 200.0
derivative_n_s_per_m = 2.0
[[stimuli]]
target = "position_m"
kind = "step"
at_s = 0.1
after = 0.01
{more}"#
    );
    text(&rig.write("rig.toml", &scenario)).to_owned()
}
