//! Newest records of a session, whole, for [searches](super::live_search) by formulas.
//!
//! Filled by the thread that watches the session; a search copies records out of it, so it never delays that thread
//! for longer than a copy. Memory is fixed; the oldest records are overwritten.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hil_config::plan::Plan;
use hil_facts::session::observer::Seen;
use shared_types::record::RecordLayout;

use crate::monitor::watch::Audience;
use crate::report::occurrences::Search;

/// Memory for records in bytes.
const BYTES: usize = 32 << 20;
/// Minimum number of records kept, however long they are.
const LEAST: usize = 4096;

/// Newest records of a session.
#[derive(Clone)]
pub(crate) struct KeptRecords(Arc<Mutex<Records>>);

struct Records {
    plan: Plan,
    /// Search of the session, or the reason why there is none; `None` until the layout is known.
    search: Option<Result<Arc<Search>, String>>,
    /// Words of a record.
    width: usize,
    /// Maximum number of records kept.
    most: usize,
    /// Records, each at its place modulo `most`.
    words: Vec<u64>,
    /// Number of all records so far.
    count: u64,
    /// Step of the newest record.
    newest: Option<u64>,
}

impl KeptRecords {
    /// Creates the records of a session of which nothing has been observed yet.
    pub(super) fn new(plan: Plan) -> Self {
        Self(Arc::new(Mutex::new(Records {
            plan,
            search: None,
            width: 0,
            most: 0,
            words: Vec::new(),
            count: 0,
            newest: None,
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Records> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the search of the session, or the reason why there is none, with the first step kept; `None` before the
    /// first record.
    pub(super) fn search(&self) -> Option<(Result<Arc<Search>, String>, u64)> {
        let records = self.lock();
        let first = records.record(records.oldest())?[0];
        Some((records.search.clone()?, first))
    }

    /// Returns the number of words of a record.
    pub(super) fn width(&self) -> usize {
        self.lock().width
    }

    /// Appends records from a place on, at most so many; returns the place behind them. Records that were overwritten
    /// are left out.
    pub(super) fn copy(&self, place: u64, most: usize, into: &mut Vec<u64>) -> u64 {
        let records = self.lock();
        let first = place.max(records.oldest());
        let mut next = first;
        while let Some(words) = records.record(next).filter(|_| next < first + most as u64) {
            into.extend_from_slice(words);
            next += 1;
        }
        next
    }

    /// Adds a record; ignores one that is not newer than the others.
    pub(super) fn keep(&self, words: &[u64]) {
        let mut records = self.lock();
        let records = &mut *records;
        if records.newest.is_some_and(|newest| words[0] <= newest) || words.len() != records.width {
            return;
        }
        let at = (records.count % records.most as u64) as usize * records.width;
        records.words[at..at + records.width].copy_from_slice(words);
        records.newest = Some(words[0]);
        records.count += 1;
    }
}

impl Records {
    /// Returns the place of the oldest record kept.
    const fn oldest(&self) -> u64 {
        self.count.saturating_sub(self.most as u64)
    }

    /// Returns the record at a place, if it is kept.
    fn record(&self, place: u64) -> Option<&[u64]> {
        if place >= self.count || place < self.oldest() {
            return None;
        }
        let at = (place % self.most as u64) as usize * self.width;
        self.words.get(at..at + self.width)
    }
}

impl Audience for KeptRecords {
    fn attach(&mut self, layout: &RecordLayout) {
        let mut records = self.lock();
        let search = Search::of_layout(&records.plan, layout);
        records.search = Some(search.map(Arc::new).map_err(|error| error.to_string()));
        records.width = layout.words();
        records.most = (BYTES / (8 * layout.words())).max(LEAST);
        // Not zeros, whose memory the system would add only during the run.
        records.words = vec![u64::MAX; records.most * records.width];
    }

    fn take(&mut self, seen: &Seen<'_>) {
        if let Seen::Record(_, words) = seen {
            self.keep(words);
        }
    }

    fn end(&mut self, _last_word: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn records(width: usize, most: usize) -> KeptRecords {
        let plan = crate::monitor::model::tests::plan();
        let kept = KeptRecords::new(plan);
        {
            let mut records = kept.lock();
            (records.width, records.most) = (width, most);
            records.words = vec![u64::MAX; width * most];
        }
        kept
    }

    #[test]
    fn the_newest_records_are_kept_and_copied_in_order() {
        let kept = records(2, 5);
        for step in 0..12 {
            kept.keep(&[step, 100 + step]);
            kept.keep(&[step, 0]); // again, as the answer to a question may be
        }
        let mut words = Vec::new();
        // The first seven were overwritten.
        assert_eq!(kept.copy(3, 2, &mut words), 9);
        assert_eq!(words, [7, 107, 8, 108]);
        assert_eq!(kept.copy(9, 100, &mut words), 12);
        assert_eq!(words[4..], [9, 109, 10, 110, 11, 111]);
        assert_eq!(kept.copy(12, 100, &mut words), 12);
        assert_eq!(words.len(), 10);
    }
}
