//! Publishing of records, and the watch over the recorder that takes them.
//!
//! The recorder's buffer holds thousands of records, seconds of a slow run, before one has to wait for
//! it, and in real time none ever does. So the publisher looks now and then if it still takes any.

use shared_types::link::LinkError;
use shared_types::stream::RecordSink;
use shared_types::wait::WaitLimit;

/// Looks in each wait limit.
const LOOKS: u64 = 8;

/// Stream of records and events to the recorder.
pub(super) struct Publisher<S> {
    pub sink: S,
    limit: WaitLimit,
    /// Tells if the last record was not published yet.
    pending: bool,
    /// Time of the next look at the recorder.
    again_ns: u64,
    /// Number of items that the recorder had taken, of those that there were, and since when it has
    /// taken no other; `None` where there were no others.
    owing: Option<(u64, u64)>,
}

impl<S: RecordSink> Publisher<S> {
    /// Makes the stream to a recorder that may take nothing for the wait limit at most.
    pub(super) const fn new(sink: S, limit: WaitLimit) -> Self {
        Self {
            sink,
            limit,
            pending: false,
            again_ns: 0,
            owing: None,
        }
    }

    /// Notes that there is a record to publish.
    pub(super) const fn note(&mut self) {
        self.pending = true;
    }

    /// Publishes the record if it is not yet; false if the recorder has no room for it now.
    pub(super) fn publish(&mut self, record: &[u64]) -> Result<bool, LinkError> {
        if self.pending {
            if !self.sink.has_room()? {
                return Ok(false);
            }
            self.flush(record)?;
        }
        Ok(true)
    }

    /// Publishes the record if it is not yet, room or not.
    pub(super) fn flush(&mut self, record: &[u64]) -> Result<(), LinkError> {
        if std::mem::take(&mut self.pending) {
            self.sink.record(record)?;
        }
        Ok(())
    }

    /// Tells if the recorder took nothing of what there is for the wait limit. Most calls compare two
    /// numbers.
    pub(super) fn is_stuck(&mut self, now_ns: u64) -> Result<bool, LinkError> {
        if now_ns < self.again_ns {
            return Ok(false);
        }
        self.again_ns = now_ns.saturating_add(self.limit.ns() / LOOKS);
        let (sent, taken) = self.sink.sent_and_taken()?;
        match self.owing {
            Some((before, since_ns)) if before == taken => {
                return Ok(now_ns - since_ns >= self.limit.ns());
            }
            _ => self.owing = (taken < sent).then_some((taken, now_ns)),
        }
        Ok(false)
    }
}

#[cfg(test)]
mod tests {
    use shared_types::lockstep::OnLoss;
    use shared_types::record::{Event, Outcome, RecordLayout};

    use super::super::chatter::{Parrot, Repeats, WAIT_LIMIT_S, engine_with, job_of};
    use super::super::{Clock, Progress};
    use super::*;

    /// A recorder with room for everything that stops, or takes one item between two looks.
    struct Lazy {
        sent: u64,
        taken: u64,
        drips: bool,
        is_full: bool,
    }

    impl RecordSink for Lazy {
        fn open(&mut self, _: &RecordLayout) -> Result<(), LinkError> {
            Ok(())
        }

        fn has_room(&mut self) -> Result<bool, LinkError> {
            Ok(!self.is_full || self.sent < 10)
        }

        fn sent_and_taken(&mut self) -> Result<(u64, u64), LinkError> {
            self.taken += u64::from(self.drips && self.taken < self.sent);
            Ok((self.sent, self.taken))
        }

        fn record(&mut self, _: &[u64]) -> Result<(), LinkError> {
            self.sent += 1;
            Ok(())
        }

        fn event(&mut self, _: &Event) -> Result<(), LinkError> {
            self.sent += 1;
            Ok(())
        }
    }

    fn lazy(drips: bool, is_full: bool) -> Lazy {
        Lazy {
            sent: 0,
            taken: 0,
            drips,
            is_full,
        }
    }

    #[test]
    fn a_recorder_that_takes_nothing_ends_the_run_whatever_room_it_has() {
        for (is_full, clock) in [
            (false, Clock::Lockstep),
            (true, Clock::Lockstep),
            (false, Clock::Realtime),
        ] {
            let parrot = Parrot::new(u64::MAX, Repeats::Nothing);
            let job = job_of(u64::MAX, OnLoss::Abort, clock);
            let mut engine = engine_with(job, parrot, lazy(false, is_full));
            while engine.poll().expect("polls") != Progress::Over {}
            let end = engine.end().expect("over");
            let told = "the recorder took no record within the wait limit";
            assert_eq!(
                (end.outcome, end.reason.as_deref()),
                (Outcome::Failed, Some(told))
            );
        }
    }

    #[test]
    fn a_recorder_that_takes_one_at_a_time_does_not() {
        let parrot = Parrot::new(u64::MAX, Repeats::Nothing);
        let job = job_of(u64::MAX, OnLoss::Abort, Clock::Lockstep);
        let mut engine = engine_with(job, parrot, lazy(true, false));
        let since_ns = hil_session::clock::monotonic_ns();
        let limits_ns = (3.0 * WAIT_LIMIT_S * 1e9) as u64;
        while hil_session::clock::monotonic_ns() - since_ns < limits_ns {
            assert_ne!(engine.poll().expect("polls"), Progress::Over);
        }
    }
}
