//! Search of a session by a formula: over the records that its panel has kept, then at every new step.
//!
//! Each page has at most one search, on the thread that serves the page, for a limited time at each turn: neither the
//! loop nor another page waits for it, however costly its formula is. A search sees every step that the panel sees,
//! whichever points its page takes.

use std::time::{Duration, Instant};

use hil_config::monitor::EveryStep;
use hil_facts::results::evaluation::RecordEvaluation;
use serde_json::{Value, json};
use shared_types::time::Step;

use super::kept_records::KeptRecords;
use crate::report::occurrences::{MOST, Occurrences};

/// Time limit for the work of a turn.
const TURN: Duration = Duration::from_millis(4);
/// Number of steps between two looks at the clock.
const STEPS: usize = 32;
/// Maximum number of records copied at a time.
const RECORDS: usize = 128;

/// Search of a session by a formula.
pub(super) struct LiveSearch {
    number: u32,
    formula: String,
    every_step: EveryStep,
    evaluation: RecordEvaluation,
    /// Row of a record that was lost.
    missing: Vec<f64>,
    /// First step kept, which counts as the beginning of the run.
    first: u64,
    /// First step from which on the answer is that of the whole run, or at which unbounded operators of the past begin.
    begin: u64,
    /// Next step.
    next: u64,
    /// Place of the next record among those kept.
    place: u64,
    /// Words of a record.
    width: usize,
    /// Records copied, and the number of words taken.
    words: Vec<u64>,
    at: usize,
    /// Number of steps whose records were lost.
    lost: u64,
    result: Occurrences,
    /// Number of ended intervals that were sent, and of steps judged then.
    sent: Option<(u64, u64)>,
}

impl LiveSearch {
    /// Starts a search from the first record kept; `None` before there is one.
    ///
    /// # Errors
    /// If the formula is invalid.
    pub(super) fn start(
        kept: &KeptRecords,
        number: u32,
        formula: &str,
    ) -> Option<Result<Self, String>> {
        let (search, first) = kept.search()?;
        let started = || -> Result<Self, String> {
            let search = search?;
            let every_step = search.formula(formula, Step(first))?;
            // The run has no steps before its first one, so nothing is unknown there.
            let unknown = if first == 0 {
                0
            } else {
                every_step.past().unwrap_or(0)
            };
            Ok(Self {
                number,
                formula: formula.into(),
                every_step,
                evaluation: search.evaluation(),
                missing: search.missing(),
                first,
                begin: first + unknown,
                next: first,
                place: 0,
                width: kept.width(),
                words: Vec::new(),
                at: 0,
                lost: 0,
                result: Occurrences::newest(),
                sent: None,
            })
        };
        Some(started())
    }

    /// Judges the steps that came, for a limited time.
    pub(super) fn turn(&mut self, kept: &KeptRecords) {
        let begun = Instant::now();
        while begun.elapsed() < TURN {
            for _ in 0..STEPS {
                if self.at == self.words.len() && !self.refill(kept) {
                    return;
                }
                self.judge();
            }
        }
    }

    fn refill(&mut self, kept: &KeptRecords) -> bool {
        self.words.clear();
        self.at = 0;
        self.place = kept.copy(self.place, RECORDS, &mut self.words);
        !self.words.is_empty()
    }

    /// Judges the next step, of the next record or, before it, of one that was lost.
    fn judge(&mut self) {
        let words = &self.words[self.at..];
        let row: &[f64] = if self.next < words[0] {
            self.lost += 1;
            &self.missing
        } else {
            self.evaluation.record(&words[..self.width]);
            self.at += self.width;
            self.evaluation.row()
        };
        let decided = self.every_step.observe(Step(self.next - self.first), row);
        self.next += 1;
        let decided = decided.map(|(step, holds)| (Step(step.0 + self.first), holds));
        self.result
            .take(decided.filter(|(step, _)| step.0 >= self.begin));
    }

    /// Describes what has changed since the last description; `None` if nothing has.
    pub(super) fn news(&mut self) -> Option<Value> {
        let Occurrences {
            intervals,
            count,
            since,
            steps,
            judged,
            last,
            ..
        } = &self.result;
        if self.sent.is_some_and(|(_, before)| before == *judged) {
            return None;
        }
        let (before, _) = self.sent.unwrap_or_default();
        let kept = *count - intervals.len() as u64;
        let from = before.max(kept);
        let mut list: Vec<[u64; 2]> = intervals.range((from - kept) as usize..).copied().collect();
        list.extend(since.map(|begin| [begin, *last]));
        self.sent = Some((*count, *judged));
        Some(json!({
            "tell": "where", "number": self.number, "formula": self.formula,
            "intervals": list, "from": from, "most": MOST, "is_open": since.is_some(),
            "count": count + u64::from(since.is_some()), "steps": steps, "judged": judged,
            "first": self.first, "begin": self.begin, "is_past_open": self.every_step.past().is_none(),
            "delay": self.every_step.delay(), "lost": self.lost,
        }))
    }
}

/// Describes the reason why a formula cannot be searched for.
pub(super) fn refusal(number: u32, formula: &str, error: &str) -> Value {
    json!({ "tell": "where", "number": number, "formula": formula, "error": error })
}
