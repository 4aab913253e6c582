//! The turn to have a session: one desk at a time, and a few that wait for it.

use std::net::SocketAddr;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Desks that may wait.
const MOST_WAITING: usize = 4;
/// Longest wait of a desk.
const LIMIT: Duration = Duration::from_secs(10);

/// The turn of one agent.
#[derive(Debug, Default)]
pub(super) struct Turn {
    state: Mutex<State>,
    is_free: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// The desk that has its session.
    served: Option<SocketAddr>,
    waiting: usize,
}

/// The turn that one desk has, until it is dropped.
#[derive(Debug)]
pub(super) struct Taken<'a>(&'a Turn);

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        self.0.lock().served = None;
        self.0.is_free.notify_one();
    }
}

impl Turn {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the turn.
    ///
    /// # Errors
    /// If another desk has it for too long, or many wait already.
    pub(super) fn take(&self, by: SocketAddr) -> Result<Taken<'_>, String> {
        self.take_within(by, LIMIT)
    }

    fn take_within(&self, by: SocketAddr, limit: Duration) -> Result<Taken<'_>, String> {
        let end = Instant::now() + limit;
        let mut state = self.lock();
        if state.served.is_some() && state.waiting >= MOST_WAITING {
            return Err(busy(state.served, "and others wait for its end"));
        }
        state.waiting += 1;
        while state.served.is_some() {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                state.waiting -= 1;
                return Err(busy(state.served, "wait for its end"));
            }
            let waited = self.is_free.wait_timeout(state, left);
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
        state.waiting -= 1;
        state.served = Some(by);
        Ok(Taken(self))
    }
}

fn busy(served: Option<SocketAddr>, advice: &str) -> String {
    let of = served.map_or_else(String::new, |address| format!(", of {address}"));
    format!("it serves another session{of}: {advice}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_has_its_turn_few_wait_and_the_others_hear_whose_session_it_is() {
        let address = |port| SocketAddr::from(([192, 0, 2, 7], port));
        let turn = Turn::default();
        let first = turn.take(address(1)).expect("free");
        let reason = turn.take_within(address(2), Duration::ZERO);
        let reason = reason.expect_err("busy");
        assert!(
            reason.contains("another session, of 192.0.2.7:1"),
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
            assert!(reason.contains("others wait"), "{reason}");
            drop(first);
            for one in next {
                one.join().expect("ends").expect("its turn");
            }
        });
    }
}
