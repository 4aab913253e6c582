//! The rejected design: both sides access the wire themselves, without bridge and agent.
//!
//! Frames are sealed, numbered and repeated as between those, by the same code. Plant and law do nothing. With fewer cores
//! than two the sides poll nothing, as bridge and agent do with fewer than their four loops.

use std::net::UdpSocket;
use std::sync::Arc;
use std::time::{Duration, Instant};

use hil_session::clock::monotonic_ns;
use hil_session::waiter::Waiter;
use hil_target::exchange::{BEAT_NS, DeskEnd, TargetEnd};
use hil_target::packet::Packet;
use hil_target::seal::{Datagrams, Key, Seal, answer, begin};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use shared_types::frame::{FrameKind, Header};
use shared_types::time::Step;
use shared_types::wait::{Sleeper, WaitLimit, WaitStrategy};

use super::{BYTES, WATCHDOG};

/// Number of values in a frame, chosen so that a sealed frame is as large as a bare datagram.
const VALUES: usize = 25;

/// Key of both ends; nobody else listens here.
fn key() -> Key {
    Key::from_hex(&"77".repeat(32)).expect("hexadecimal digits")
}

/// End of the wire.
struct End {
    socket: Arc<UdpSocket>,
    datagrams: Datagrams,
    waiter: Waiter,
    bytes: Vec<u8>,
}

#[derive(Debug)]
struct OnSocket(Arc<UdpSocket>);

impl Sleeper for OnSocket {
    fn announce(&self) -> u32 {
        0
    }

    fn sleep(&self, _: u32, ns: u64) {
        let limit = Timespec::try_from(Duration::from_nanos(ns)).unwrap_or_default();
        let _ = poll(&mut [PollFd::new(&*self.0, PollFlags::IN)], Some(&limit)); // whyever it ends, look again
    }

    fn retire(&self) {}
}

impl End {
    fn new(socket: UdpSocket, seal: Seal) -> Self {
        socket.set_nonblocking(true).expect("set");
        let socket = Arc::new(socket);
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let limit = WaitLimit::from_seconds(WATCHDOG.as_secs_f64());
        let mut waiter = Waiter::with(limit, WaitStrategy::Hybrid, cores < 2);
        waiter.sleep_on(Some(Box::new(OnSocket(Arc::clone(&socket)))));
        Self {
            socket,
            datagrams: Datagrams::new(seal),
            waiter,
            bytes: Vec::new(),
        }
    }

    /// Sends the content of `bytes`.
    fn send(&mut self) {
        let sealed = self.datagrams.close(&self.bytes).expect("short");
        let _ = self.socket.send(sealed); // lost, as any may be
    }

    fn receive(&mut self) -> Option<Packet> {
        let mut datagram = [0; 2 * BYTES];
        let length = self.socket.recv(&mut datagram).ok()?;
        let (content, _) = self.datagrams.open(&datagram[..length]).ok()?;
        Packet::read(content)
    }
}

fn header(kind: FrameKind, step: u64) -> Header {
    Header {
        count: VALUES as u16,
        ..Header::new(kind, Step(step))
    }
}

/// Leads on a connected socket after the other end's greeting; returns the times of the trips in us.
pub(super) fn lead(socket: UdpSocket, greeting: &[u8], steps: u32) -> Vec<f64> {
    let (seal, message) = answer(&key(), &[], greeting).expect("the same key");
    socket.send(&message).expect("sent");
    let (mut end, mut desk) = (End::new(socket, seal), DeskEnd::new(false, BEAT_NS));
    let values = [1.0; VALUES];
    let mut trips = Vec::with_capacity(steps as usize);
    for step in 0..u64::from(steps) {
        let since = Instant::now();
        desk.say(&header(FrameKind::Sample, step), &values);
        loop {
            let now_ns = monotonic_ns();
            if desk.due_ns() <= now_ns {
                desk.packet(now_ns, &mut end.bytes);
                end.send();
            }
            if let Some(packet) = end.receive() {
                if desk.take(packet, monotonic_ns()).is_some() {
                    break;
                }
            } else {
                let is_late = end.waiter.pause_until(desk.due_ns());
                assert!(!is_late, "no answer to step {step}");
            }
        }
        end.waiter.done();
        trips.push(since.elapsed().as_secs_f64() * 1e6);
    }
    trips
}

/// Answers on a connected socket until this process is terminated.
pub(super) fn follow(socket: UdpSocket) {
    let (begun, greeting) = begin(&key(), &[]).expect("random numbers");
    socket.send(&greeting).expect("sent");
    socket.set_read_timeout(Some(WATCHDOG)).expect("set");
    let mut message = [0; BYTES];
    let length = socket.recv(&mut message).expect("an answer");
    let seal = begun.end(&message[..length]).expect("the same key");
    let (mut end, mut target) = (End::new(socket, seal), TargetEnd::new(false));
    let values = [1.0; VALUES];
    loop {
        let Some(packet) = end.receive() else {
            if end.waiter.pause() {
                return; // nobody leads any more
            }
            continue;
        };
        end.waiter.done();
        if let Some(frame) = target.take(packet) {
            target.say(&header(FrameKind::Command, frame.header.step), &values);
        }
        target.packet(&mut end.bytes);
        end.send();
    }
}
