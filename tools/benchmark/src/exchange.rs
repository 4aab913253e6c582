//! Bare exchange: repeated round trips of a payload that contains only a number.
//!
//! The exchange is the reference for the loop: the payloads have the size of the loop's frames, each end writes and
//! copies them completely, and both ends wait as the loop does. [`raw`](super::raw) and [`Blackboard`] implement the
//! ends.

use hil_facts::results::latency::times::Times;
use hil_session::clock::monotonic_ns;
use hil_session::link::bare::Blackboard;
use hil_session::waiter::Waiter;
use shared_types::frame;

/// Number of values in the smallest frame.
const SMALLEST: usize = 16;

/// Returns the frame size in words for a number of signals, rounded up to a size class.
pub(crate) fn frame_words(signals: usize) -> usize {
    frame::words(signals.next_power_of_two().max(SMALLEST))
}

/// End of an exchange.
pub trait End {
    /// Sends a payload filled with this number.
    fn send(&mut self, number: u64);
    /// Copies a received payload and returns its number, if there is one.
    fn receive(&mut self) -> Option<u64>;
}

impl<E: End + ?Sized> End for Box<E> {
    fn send(&mut self, number: u64) {
        (**self).send(number);
    }

    fn receive(&mut self) -> Option<u64> {
        (**self).receive()
    }
}

impl End for Blackboard {
    fn send(&mut self, number: u64) {
        Self::send(self, number);
    }

    fn receive(&mut self) -> Option<u64> {
        Self::receive(self)
    }
}

/// Numbers of round trips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trips {
    /// Number of uncounted round trips at the start.
    pub warm_up: u64,
    /// Number of counted round trips.
    pub measured: u64,
}

impl Trips {
    /// Returns the total number of round trips.
    #[must_use]
    pub const fn all(self) -> u64 {
        self.warm_up.saturating_add(self.measured)
    }
}

/// Error: the other end did not answer within the wait limit, or the user interrupted the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no answer at trip {trip} of the bare exchange")]
pub struct NoAnswer {
    /// Number of the round trip.
    pub trip: u64,
}

/// Repeatedly sends a payload and waits for the answer; returns the durations of the counted round trips, each of which
/// includes one reading of the clock.
///
/// # Errors
/// If an answer did not arrive, or `stop` returned `true` during a wait.
pub fn lead(
    end: &mut impl End,
    trips: Trips,
    mut waiter: Waiter,
    stop: impl Fn() -> bool,
) -> Result<Times, NoAnswer> {
    let mut trips_ns = Times::default();
    for trip in 1..=trips.all() {
        let since_ns = monotonic_ns();
        end.send(trip);
        receive(end, trip, &mut waiter, &stop)?;
        let took_ns = monotonic_ns() - since_ns;
        if trip > trips.warm_up {
            trips_ns.record(took_ns);
        }
    }
    Ok(trips_ns)
}

/// Repeatedly waits for a payload and answers it.
///
/// # Errors
/// If a payload did not arrive, or `stop` returned `true` during a wait.
pub fn follow(
    end: &mut impl End,
    trips: Trips,
    mut waiter: Waiter,
    stop: impl Fn() -> bool,
) -> Result<(), NoAnswer> {
    for trip in 1..=trips.all() {
        receive(end, trip, &mut waiter, &stop)?;
        end.send(trip);
    }
    Ok(())
}

fn receive(
    end: &mut impl End,
    trip: u64,
    waiter: &mut Waiter,
    stop: &impl Fn() -> bool,
) -> Result<(), NoAnswer> {
    loop {
        // Checked before the poll: a payload that the other side sent before it ended still counts.
        let stopped = stop();
        // A blackboard also returns its initial content.
        if end.receive() == Some(trip) {
            waiter.done();
            return Ok(());
        }
        if stopped || waiter.pause() {
            return Err(NoAnswer { trip });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hil_session::session::Session;
    use shared_types::side::Side;
    use shared_types::wait::WaitLimit;

    #[test]
    fn a_payload_has_the_size_of_the_frame_for_its_signals() {
        // Checksum, 11 header words, one validity word per 64 values, and the values.
        for (signals, words) in [
            (1, 12 + 1 + 16),
            (16, 12 + 1 + 16),
            (17, 12 + 1 + 32),
            (32, 12 + 1 + 32),
            (33, 12 + 1 + 64),
            (128, 12 + 2 + 128),
            (129, 12 + 4 + 256),
            (512, 12 + 8 + 512),
        ] {
            assert_eq!(frame_words(signals), words, "{signals} signals");
        }
    }

    #[test]
    fn every_trip_over_a_blackboard_is_answered() {
        let session = Session::create(None).expect("a session");
        let trips = Trips {
            warm_up: 3,
            measured: 100,
        };
        let waiter = || Waiter::new(WaitLimit::from_seconds(30.0));
        let mut plant = Blackboard::open(session.info(), Side::Plant, 33, 2).expect("creates");
        let trips_ns = std::thread::scope(|scope| {
            scope.spawn(|| {
                let info = session.info();
                let mut end = Blackboard::open(info, Side::Controller, 33, 2).expect("opens");
                follow(&mut end, trips, waiter(), || false).expect("all came");
            });
            lead(&mut plant, trips, waiter(), || false).expect("all answered")
        });
        assert_eq!(trips_ns.len(), 100);
    }

    /// Echo that answers immediately, except for round trip `lost`.
    struct Echo {
        sent: u64,
        lost: u64,
    }

    impl End for Echo {
        fn send(&mut self, number: u64) {
            self.sent = number;
        }

        fn receive(&mut self) -> Option<u64> {
            (self.sent != self.lost).then_some(self.sent)
        }
    }

    #[test]
    fn endless_trips_stay_endless_after_a_warm_up() {
        let trips = Trips {
            warm_up: 1,
            measured: u64::MAX,
        };
        assert_eq!(trips.all(), u64::MAX);
    }

    #[test]
    fn warm_up_trips_are_not_counted() {
        let waiter = || Waiter::new(WaitLimit::from_seconds(0.01));
        let trips = Trips {
            warm_up: 30,
            measured: 12,
        };
        let mut whole = Echo { sent: 0, lost: 0 };
        let trips_ns = lead(&mut whole, trips, waiter(), || false).expect("answered");
        assert_eq!((trips_ns.len(), whole.sent), (12, 42));
        let mut broken = Echo { sent: 0, lost: 35 };
        let error = lead(&mut broken, trips, waiter(), || false).expect_err("lost");
        assert_eq!(error, NoAnswer { trip: 35 });
        // An available answer counts even if the other side is gone.
        let stopped = lead(&mut Echo { sent: 0, lost: 7 }, trips, waiter(), || true);
        assert_eq!(stopped.expect_err("stopped").trip, 7);
    }
}
