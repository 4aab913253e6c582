//! A bare exchange: a payload there, one back, again and again, with nothing in them but a number.
//!
//! What the loop is compared with. The payloads are as large as the loop's frames, both ends write all
//! of one and copy all of the other out, and both wait as the loop does. The ends are
//! [`raw`](super::raw) and the [`Blackboard`].

use hil_facts::results::latency::times::Times;
use hil_session::clock::monotonic_ns;
use hil_session::link::bare::Blackboard;
use hil_session::waiter::Waiter;
use shared_types::frame;

/// Room for values in the smallest frame.
const SMALLEST: usize = 16;

/// Words of the frame that N signals cross in: the next size class.
#[must_use]
pub(crate) fn frame_words(signals: usize) -> usize {
    frame::words(signals.next_power_of_two().max(SMALLEST))
}

/// End of an exchange.
pub trait End {
    /// Sends a payload full of this number.
    fn send(&mut self, number: u64);
    /// The number of a payload that came and was copied out.
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
    /// Number of round trips before the ones that count.
    pub warm_up: u64,
    /// Number of round trips that count.
    pub measured: u64,
}

impl Trips {
    /// All of them.
    #[must_use]
    pub const fn all(self) -> u64 {
        self.warm_up.saturating_add(self.measured)
    }
}

/// The other end did not answer within the wait limit, or the user wanted no more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no answer at trip {trip} of the bare exchange")]
pub struct NoAnswer {
    /// The trip.
    pub trip: u64,
}

/// Sends and awaits the answer, again and again; how long each counted trip took. One reading of the
/// clock is in each.
///
/// # Errors
/// If an answer did not come, or `stop` said so while it was awaited.
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

/// Answers, again and again.
///
/// # Errors
/// If the next payload did not come, or `stop` said so while it was awaited.
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
        // Asked before the poll: what the other side sent before it ended still counts.
        let stopped = stop();
        // A blackboard shows what was there before the first payload as well.
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
    fn a_payload_is_as_large_as_the_frame_of_so_many_signals() {
        // A check sum, 11 words of header, one of validity bits for each 64 values of the room, and the room.
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

    /// Answers at once, but trip `lost` never.
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
    fn trips_without_end_stay_without_end_after_a_warm_up() {
        let trips = Trips {
            warm_up: 1,
            measured: u64::MAX,
        };
        assert_eq!(trips.all(), u64::MAX);
    }

    #[test]
    fn the_warm_up_does_not_count() {
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
        // An answer that is there counts, even if the other side is gone.
        let stopped = lead(&mut Echo { sent: 0, lost: 7 }, trips, waiter(), || true);
        assert_eq!(stopped.expect_err("stopped").trip, 7);
    }
}
