//! Sleep until shared memory or the wire has data: sleeps on whichever is expected, and polls the other at short
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

/// Maximum sleep in ns on one of them while the other may have data too.
const SLICE_NS: u64 = 200_000;
/// Maximum sleep in ns otherwise, because a sleep on the wire does not notice the bell, and some checks are due by
/// time.
const LONGEST_NS: u64 = 5_000_000;

/// Creates the waiter of one end, whose limit is checked elsewhere, and the handle that selects where to sleep. With
/// fewer cores than loops the waiter never spins, because that would take time from the others.
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

/// Bell that is created after its ringers.
#[derive(Clone, Default)]
pub(crate) struct LateBell(Arc<OnceLock<Bell>>);

impl LateBell {
    /// Sets the bell to be rung.
    pub(crate) fn is(&self, bell: Bell) {
        let _ = self.0.set(bell); // a process has a single link
    }

    /// Rings the bell, if it exists.
    pub(crate) fn ring(&self) {
        if let Some(bell) = self.0.get() {
            bell.ring();
        }
    }
}

/// Source of the next data.
#[derive(Clone, Debug, Default)]
pub(crate) struct Awaited {
    wire: Rc<Cell<bool>>,
    both: Rc<Cell<bool>>,
}

impl Awaited {
    /// Selects the wire or the shared memory as the source of the next data; `both` if either is possible.
    pub(crate) fn set(&self, wire: bool, both: bool) {
        self.wire.set(wire);
        self.both.set(both);
    }
}

/// Place to sleep.
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
                // Data, a timeout and a signal are all handled by polling again.
                let _ = poll(&mut [PollFd::new(&**socket, PollFlags::IN)], Some(&limit));
            }
            _ => self.bell.sleep(announced, ns),
        }
    }

    fn retire(&self) {
        self.bell.retire();
    }
}
