//! Turns: one desk at a time has a session, and a few wait for it.

use std::net::SocketAddr;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of waiting desks.
const MOST_WAITING: usize = 4;
/// Time limit of a desk's wait.
const LIMIT: Duration = Duration::from_secs(10);
/// Time limit for a wait during another desk's run, which may take hours: enough for a run that is ending.
const LIMIT_IN_RUN: Duration = Duration::from_millis(500);

/// Turns of one agent.
#[derive(Debug, Default)]
pub(super) struct Turn {
    state: Mutex<State>,
    changes: Condvar,
}

#[derive(Debug, Default)]
struct State {
    served: Served,
    waiting: usize,
}

/// The desk whose turn it is.
#[derive(Clone, Copy, Debug, Default)]
enum Served {
    #[default]
    Nobody,
    /// Before or after the desk's run.
    Desk(SocketAddr),
    /// During the desk's run.
    Run(SocketAddr),
}

/// Turn of one desk, which lasts until this value is dropped.
#[derive(Debug)]
pub(super) struct Taken<'a>(&'a Turn);

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.served = Served::Nobody;
        self.0.changes.notify_one();
    }
}

impl Turn {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Marks the beginning or the end of a run of the desk whose turn it is.
    pub(super) fn runs(&self, is_run: bool) {
        let mut state = self.lock();
        if let Served::Desk(by) | Served::Run(by) = state.served {
            state.served = if is_run {
                Served::Run(by)
            } else {
                Served::Desk(by)
            };
        }
        drop(state);
        self.changes.notify_all();
    }

    /// Waits for the turn.
    ///
    /// # Errors
    /// If another desk has the turn for too long or for a run, or too many desks already wait.
    pub(super) fn take(&self, by: SocketAddr) -> Result<Taken<'_>, String> {
        self.take_within(by, LIMIT)
    }

    fn take_within(&self, by: SocketAddr, limit: Duration) -> Result<Taken<'_>, String> {
        let since = Instant::now();
        let mut state = self.lock();
        if let Served::Desk(other) | Served::Run(other) = state.served
            && state.waiting >= MOST_WAITING
        {
            return Err(busy(other, ", and others are already waiting"));
        }
        state.waiting += 1;
        loop {
            let (other, limit) = match state.served {
                Served::Nobody => break,
                Served::Desk(other) => (other, limit),
                Served::Run(other) => (other, limit.min(LIMIT_IN_RUN)),
            };
            let remaining = limit.saturating_sub(since.elapsed());
            if remaining.is_zero() {
                state.waiting -= 1;
                return Err(busy(other, "; wait for it to end"));
            }
            let result = self.changes.wait_timeout(state, remaining);
            (state, _) = result.unwrap_or_else(PoisonError::into_inner);
        }
        state.waiting -= 1;
        state.served = Served::Desk(by);
        Ok(Taken(self))
    }
}

fn busy(by: SocketAddr, advice: &str) -> String {
    format!("it is serving another session, from {by}{advice}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_desk_is_served_a_few_queue_and_the_rest_are_refused_with_the_session() {
        let address = |port| SocketAddr::from(([192, 0, 2, 7], port));
        let turn = Turn::default();
        let first = turn.take(address(1)).expect("free");
        let reason = turn.take_within(address(2), Duration::ZERO);
        let reason = reason.expect_err("busy");
        assert!(
            reason.contains("another session, from 192.0.2.7:1"),
            "{reason}"
        );
        std::thread::scope(|scope| {
            let (turn, hour) = (&turn, Duration::from_secs(3600));
            let wait = |port| scope.spawn(move || turn.take_within(address(port), hour).map(drop));
            let next: Vec<_> = (0..MOST_WAITING as u16).map(wait).collect();
            while turn.lock().waiting < MOST_WAITING {
                std::thread::yield_now();
            }
            let reason = turn.take(address(9)).expect_err("too many");
            assert!(reason.contains("others are already waiting"), "{reason}");
            drop(first);
            for one in next {
                one.join().expect("ends").expect("its turn");
            }
        });
    }
    #[test]
    fn during_a_run_no_desk_waits_for_its_end() {
        let address = |port| SocketAddr::from(([192, 0, 2, 7], port));
        let hour = Duration::from_secs(3600);
        let turn = Turn::default();
        let first = turn.take(address(1)).expect("free");
        std::thread::scope(|scope| {
            // A desk that is already waiting is notified too.
            let waits = scope.spawn(|| turn.take_within(address(2), hour).map(drop));
            while turn.lock().waiting < 1 {
                std::thread::yield_now();
            }
            turn.runs(true);
            for refused in [
                waits.join().expect("ends"),
                turn.take_within(address(3), hour).map(drop),
            ] {
                let reason = refused.expect_err("busy");
                assert!(reason.contains("from 192.0.2.7:1"), "{reason}");
            }
            // The end of a run that is ending is awaited.
            turn.runs(false);
            let next = scope.spawn(|| turn.take_within(address(4), hour).map(drop));
            while turn.lock().waiting < 1 {
                std::thread::yield_now();
            }
            drop(first);
            next.join().expect("ends").expect("its turn");
        });
    }
}
