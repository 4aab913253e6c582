//! Sentences about links: what the protocol, which knows no link, relies on.

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

/// Opens a controller's end on the thread that calls it.
pub type Opener<L> = Box<dyn FnOnce() -> L + Send>;

/// A place where ends of a link meet: a session, an address, two mailboxes.
pub trait Fixture {
    /// The link.
    type Link: Link + 'static;

    /// Time after which what was sent and did not come counts as lost.
    const PATIENCE: Duration = Duration::from_secs(20);
    /// Longest time that a frame is under way; so long nothing must come where nothing may.
    const LATENCY: Duration = Duration::ZERO;

    /// Makes the place, which outlives the ends that meet there.
    fn new() -> Self;

    /// Opens the plant's end, once.
    fn plant(&mut self) -> Self::Link;

    /// Opens the end of the controller of an epoch, which the plant expects: 1, then 2.
    fn controller(&mut self, epoch: u32) -> Self::Link;

    /// Lets another thread open the end of the first controller; `None` for a link within one thread.
    fn controller_elsewhere(&mut self) -> Option<Opener<Self::Link>> {
        None
    }

    /// Ends a side as its killed process would: without a word, with what the system does for it.
    fn kill(&mut self, end: Self::Link) {
        drop(end);
    }
}

/// Lists the sentences for an implementation.
#[must_use]
pub fn sentences<F: Fixture>() -> Vec<Sentence> {
    crate::conformance!(@link list F)
}

/// Two connected ends, which close before their place goes.
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

    /// A pair whose frames are open.
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
    let sent = end.send(&Header::new(kind, Step(step)), values);
    sent.expect("a frame is sent");
}

fn sample(plant: &mut impl Link, step: u64, values: &[f64]) {
    send(plant, FrameKind::Sample, step, values);
}

fn command(controller: &mut impl Link, step: u64, values: &[f64]) {
    send(controller, FrameKind::Command, step, values);
}

/// Looks until something comes.
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

/// Checks that nothing comes for as long as anything can be under way.
fn silence<F: Fixture>(end: &mut F::Link, values: &mut [f64], why: &str) {
    let since = Instant::now();
    loop {
        assert_eq!(end.receive(values), Ok(None), "{why}");
        let heard = end.receive_control();
        assert_eq!(heard, Ok(None), "{why}");
        if since.elapsed() >= F::LATENCY {
            return;
        }
        yield_now();
    }
}
