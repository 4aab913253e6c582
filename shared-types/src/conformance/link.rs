//! Properties of links that the protocol relies on, whatever the transport.

use std::thread::yield_now;
use std::time::{Duration, Instant};

pub use epochs::*;
pub use frames::*;
pub use sleepers::*;

use super::Sentence;
use crate::frame::{FrameIdentity, FrameKind, Header};
use crate::link::{FrameSpec, Link};
use crate::time::Step;

mod epochs;
mod frames;
mod sleepers;

/// Function that opens a controller's end on the calling thread.
pub type Opener<L> = Box<dyn FnOnce() -> L + Send>;

/// Meeting point of both ends of a link: a session, an address or two mailboxes.
pub trait Fixture {
    /// Link under test.
    type Link: Link + 'static;

    /// Time after which an undelivered message counts as lost.
    const PATIENCE: Duration = Duration::from_secs(20);
    /// Longest time that a frame is in transit; tests for silence wait this long.
    const LATENCY: Duration = Duration::ZERO;

    /// Creates the meeting point, which outlives the ends opened in it.
    fn new() -> Self;

    /// Opens the plant's end, once.
    fn plant(&mut self) -> Self::Link;

    /// Opens the controller's end of an epoch that the plant expects: 1, then 2.
    fn controller(&mut self, epoch: u32) -> Self::Link;

    /// Returns a function that opens the first controller's end on another thread; `None` for a link within one thread.
    fn controller_elsewhere(&mut self) -> Option<Opener<Self::Link>> {
        None
    }

    /// Ends a side as if its process had been killed: no message is sent, and only the system cleans up.
    fn kill(&mut self, end: Self::Link) {
        drop(end);
    }
}

/// Lists the properties for one implementation.
#[must_use]
pub fn sentences<F: Fixture>() -> Vec<Sentence> {
    crate::conformance!(@link list F)
}

/// Two connected ends, closed before their meeting point is dropped.
struct Pair<F: Fixture> {
    plant: F::Link,
    controller: F::Link,
    place: F,
}

impl<F: Fixture> Pair<F> {
    fn new() -> Self {
        let mut place = F::new();
        Self {
            plant: place.plant(),
            controller: place.controller(1),
            place,
        }
    }

    /// Creates a pair with open frame channels.
    fn open(samples: usize, commands: usize) -> Self {
        let mut pair = Self::new();
        open(&mut pair.plant, 1, samples, commands);
        open(&mut pair.controller, 1, commands, samples);
        pair
    }
}

const IDENTITY: FrameIdentity = FrameIdentity {
    session: 11,
    layout: 22,
    epoch: 1,
};

fn spec(epoch: u32, outgoing: usize, incoming: usize) -> FrameSpec {
    FrameSpec {
        identity: FrameIdentity { epoch, ..IDENTITY },
        outgoing,
        incoming,
    }
}

fn open(end: &mut impl Link, epoch: u32, outgoing: usize, incoming: usize) {
    let opened = end.open_frames(&spec(epoch, outgoing, incoming));
    opened.expect("the frames open");
}

fn send(end: &mut impl Link, kind: FrameKind, step: u64, values: &[f64]) {
    let result = end.send(&Header::new(kind, Step(step)), values);
    result.expect("a frame is sent");
}

fn sample(plant: &mut impl Link, step: u64, values: &[f64]) {
    send(plant, FrameKind::Sample, step, values);
}

fn command(controller: &mut impl Link, step: u64, values: &[f64]) {
    send(controller, FrameKind::Command, step, values);
}

/// Polls until something arrives.
fn awaited<F: Fixture, T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let since = Instant::now();
    loop {
        if let Some(came) = look() {
            return came;
        }
        let waited = since.elapsed();
        assert!(waited < F::PATIENCE, "no {what} came within {waited:?}");
        yield_now();
    }
}

/// Receives the next frame.
fn frame<F: Fixture>(end: &mut F::Link, values: &mut [f64]) -> Header {
    awaited::<F, _>("frame", || end.receive(values).expect("an end receives"))
}

/// Receives the next control message.
fn message<F: Fixture>(end: &mut F::Link) -> Vec<u8> {
    awaited::<F, _>("message", || {
        end.receive_control().expect("an end receives")
    })
}

/// Checks that nothing arrives for as long as a frame can be in transit.
fn silence<F: Fixture>(end: &mut F::Link, values: &mut [f64], why: &str) {
    let since = Instant::now();
    loop {
        assert_eq!(end.receive(values), Ok(None), "{why}");
        let message = end.receive_control();
        assert_eq!(message, Ok(None), "{why}");
        if since.elapsed() >= F::LATENCY {
            return;
        }
        yield_now();
    }
}
