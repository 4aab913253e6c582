//! Sleeping until shared memory or the wire has something: on whichever is awaited, looking at the other at short
//! intervals.

use std::cell::Cell;
use std::net::UdpSocket;
use std::rc::Rc;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use hil_session::link::bell::Bell;
use hil_session::waiter::Waiter;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use shared_types::wait::{Sleeper, WaitLimit, WaitStrategy};

use crate::path::DatagramPath;

/// Longest sleep on one of them while the other may have news too.
const SLICE_NS: u64 = 200_000;
/// Longest sleep otherwise: a sleep on the wire hears no bell, and some looks are due by time.
const LONGEST_NS: u64 = 5_000_000;

/// Makes the waiter of one end, whose limit is looked at elsewhere, and what tells it where to sleep. With fewer cores than
/// loops it polls nothing: that would be the others' time.
pub(crate) fn waiter(
    both_here: bool,
    bell: Bell,
    path: Option<&DatagramPath>,
) -> (Waiter, Awaited) {
    let loops = if both_here { 4 } else { 2 };
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let limit = WaitLimit::from_seconds(f64::INFINITY);
    let mut waiter = Waiter::with(limit, WaitStrategy::Hybrid, cores < loops);
    if cores > 1 {
        waiter = waiter.with_several_cores();
    }
    let awaited = Awaited::default();
    waiter.sleep_on(Some(Box::new(Either {
        bell,
        socket: path.map(DatagramPath::socket),
        awaited: awaited.clone(),
    })));
    (waiter, awaited)
}

/// A bell that is made later than those who will ring it.
#[derive(Clone, Default)]
pub(crate) struct LateBell(Arc<OnceLock<Bell>>);

impl LateBell {
    /// Rings this bell from now on.
    pub(crate) fn is(&self, bell: Bell) {
        let _ = self.0.set(bell); // a process has one link in its life
    }

    /// Rings it, if it is there.
    pub(crate) fn ring(&self) {
        if let Some(bell) = self.0.get() {
            bell.ring();
        }
    }
}

/// Source of the next news.
#[derive(Clone, Debug, Default)]
pub(crate) struct Awaited {
    wire: Rc<Cell<bool>>,
    both: Rc<Cell<bool>>,
}

impl Awaited {
    /// Notes that the wire has the next news, or else the shared memory; `both` if either may.
    pub(crate) fn set(&self, wire: bool, both: bool) {
        self.wire.set(wire);
        self.both.set(both);
    }
}

/// The place to sleep.
#[derive(Debug)]
struct Either {
    bell: Bell,
    socket: Option<Arc<UdpSocket>>,
    awaited: Awaited,
}

impl Sleeper for Either {
    fn announce(&self) -> u32 {
        self.bell.announce()
    }

    fn sleep(&self, announced: u32, ns: u64) {
        let ns = ns.min(match self.awaited.both.get() {
            true => SLICE_NS,
            false => LONGEST_NS,
        });
        match &self.socket {
            Some(socket) if self.awaited.wire.get() => {
                let limit = Timespec::try_from(Duration::from_nanos(ns)).unwrap_or_default();
                // Readable, the end of the time and a signal all mean the same: look again.
                let _ = poll(&mut [PollFd::new(&**socket, PollFlags::IN)], Some(&limit));
            }
            _ => self.bell.sleep(announced, ns),
        }
    }

    fn retire(&self) {
        self.bell.retire();
    }
}
