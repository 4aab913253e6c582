//! Publisher of records, with supervision of the recorder.
//!
//! The recorder's buffer holds thousands of records, which is seconds of a slow run, before the plant has to wait, and
//! in real time the plant never waits. So the publisher checks at intervals that the recorder still takes records.

use shared_types::link::LinkError;
use shared_types::stream::RecordSink;
use shared_types::wait::WaitLimit;

/// Number of checks within a wait limit.
const LOOKS: u64 = 8;

/// Stream of records and events to the recorder.
pub(super) struct Publisher<S> {
    pub sink: S,
    limit: WaitLimit,
    /// `true` if the last record is not published yet.
    pending: bool,
    /// Time of the next check of the recorder.
    again_ns: u64,
    /// Number of items that the recorder had taken while more were pending, and the time since which that number has
    /// not changed; `None` if no items were pending.
    owing: Option<(u64, u64)>,
}

impl<S: RecordSink> Publisher<S> {
    /// Creates the stream to a recorder that must take an item within the wait limit.
    pub(super) const fn new(sink: S, limit: WaitLimit) -> Self {
        Self {
            sink,
            limit,
            pending: false,
            again_ns: 0,
            owing: None,
        }
    }

    /// Marks a record as pending.
    pub(super) const fn note(&mut self) {
        self.pending = true;
    }

    /// Publishes a pending record; returns `false` if the recorder has no room for the record now.
    pub(super) fn publish(&mut self, record: &[u64]) -> Result<bool, LinkError> {
        if self.pending {
            if !self.sink.has_room()? {
                return Ok(false);
            }
            self.flush(record)?;
        }
        Ok(true)
    }

    /// Publishes a pending record, regardless of room.
    pub(super) fn flush(&mut self, record: &[u64]) -> Result<(), LinkError> {
        if std::mem::take(&mut self.pending) {
            self.sink.record(record)?;
        }
        Ok(())
    }

    /// Returns `true` if the recorder took none of the pending items within the wait limit. Most calls only compare two
    /// numbers.
    pub(super) fn is_stuck(&mut self, now_ns: u64) -> Result<bool, LinkError> {
        if now_ns < self.again_ns {
            return Ok(false);
        }
        self.again_ns = now_ns.saturating_add(self.limit.ns() / LOOKS);
        let (sent_items, taken_items) = self.sink.sent_and_taken()?;
        match self.owing {
            Some((before, since_ns)) if before == taken_items => {
                return Ok(now_ns - since_ns >= self.limit.ns());
            }
            _ => self.owing = (taken_items < sent_items).then_some((taken_items, now_ns)),
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

    /// A recorder with room for everything that takes no items, or one item between two checks.
    struct Lazy {
        sent: u64,
        consumed: u64,
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
            self.consumed += u64::from(self.drips && self.consumed < self.sent);
            Ok((self.sent, self.consumed))
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
            consumed: 0,
            drips,
            is_full,
        }
    }

    #[test]
    fn a_recorder_that_takes_nothing_ends_the_run_despite_its_room() {
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
            let reason = "the recorder took no record within the wait limit";
            assert_eq!(
                (end.outcome, end.reason.as_deref()),
                (Outcome::Failed, Some(reason))
            );
        }
    }

    #[test]
    fn a_recorder_that_takes_one_item_at_a_time_does_not_end_the_run() {
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
