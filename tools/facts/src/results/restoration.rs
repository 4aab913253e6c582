//! Result of a checkpoint's check: whether sides started from the saved state repeated the following steps of the run
//! bit by bit. Compares records and starts nothing.

use hil_recording::schema::column_name;
use serde::{Deserialize, Serialize};
use shared_types::number::{exact, exact_in};
use shared_types::record::{Event, GROUPS, HASHED_GROUPS, RecordLayout, RunEnd};
use shared_types::side::Side;
use shared_types::stream::Item;
use shared_types::text;

use crate::results::recorded::{Recorded, Stretch};

/// Groups of a record in the order of computation: the first difference is the cause.
const ORDER: [(&str, Side); HASHED_GROUPS] = [
    ("input", Side::Plant),
    ("measured", Side::Plant),
    ("reference", Side::Plant),
    ("command", Side::Controller),
    ("internal", Side::Controller),
    ("truth", Side::Plant),
    ("applied", Side::Plant),
];

/// Kind of result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// All bits were reproduced.
    Exact,
    /// A signal differed.
    Differs,
    /// A side died by a signal or a panic.
    Crashed,
    /// A side made no progress within the wait limit.
    Stuck,
    /// A side refused its state or ended with an error.
    Failed,
    /// Nothing was compared.
    Unchecked,
}

/// Check of a checkpoint, as stored in its description and in summaries.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Check {
    /// Verdict of the comparison.
    pub verdict: Verdict,
    /// Number of steps reproduced bit for bit.
    pub steps: u64,
    /// Result in words.
    #[serde(deserialize_with = "text::line_of")]
    pub text: String,
}

impl Check {
    /// Creates the check of a checkpoint for which nothing was compared.
    pub fn missing(reason: &str) -> Self {
        Self {
            verdict: Verdict::Unchecked,
            steps: 0,
            text: format!("not checked: {reason}"),
        }
    }

    /// Returns `true` if something was compared.
    pub fn is_made(&self) -> bool {
        self.verdict != Verdict::Unchecked
    }

    /// Returns a warning for runs from this checkpoint, if the state did not restore exactly.
    pub fn warning(&self) -> Option<String> {
        let is_known = self.is_made() && self.verdict != Verdict::Exact;
        is_known.then(|| {
            let text = &self.text;
            format!("its state does not restore exactly: it {text}; a run that continues from it may differ from the uninterrupted run")
        })
    }

    /// Describes a check, or its absence.
    pub(crate) fn words(check: Option<&Self>) -> &str {
        check.map_or("not checked", |check| &check.text)
    }
}

/// Comparison of a check's records with those of the run.
pub struct Comparison<'a> {
    layout: &'a RecordLayout,
    expected: &'a [Vec<u64>],
    /// `true` if the live run was changed after these records.
    is_cut: bool,
    /// `true` once the plant has restored its state.
    pub has_begun: bool,
    /// Number of equal records.
    same: usize,
    difference: Option<String>,
    /// End of the check's run as reported by its plant.
    pub end: Option<RunEnd>,
    /// Defect of the stream.
    pub broken: Option<String>,
}

impl<'a> Comparison<'a> {
    /// Starts the comparison with the records of a run.
    pub fn new(layout: &'a RecordLayout, stretch: &'a Stretch, recorded: &Recorded) -> Self {
        let expected = stretch.untouched(recorded);
        Self {
            layout,
            expected,
            is_cut: expected.len() < stretch.records.len(),
            has_begun: false,
            same: 0,
            difference: None,
            end: None,
            broken: None,
        }
    }

    /// Returns `true` if there is at least one complete step to compare.
    pub const fn has_steps(&self) -> bool {
        self.expected.len() > 1
    }

    /// Returns `true` if further items cannot change the result.
    pub const fn is_over(&self) -> bool {
        self.difference.is_some() || self.broken.is_some() || self.same == self.expected.len()
    }

    /// Processes an item of the check's stream.
    pub fn take(&mut self, item: Item<'_>) {
        match item {
            Item::Event(Event::End(end)) => self.end = Some(end),
            _ if self.is_over() => {}
            Item::Event(_) => {}
            Item::Record(words) if words.len() == self.layout.words() => {
                let (record, expected) =
                    (self.layout.view(words).hashed, &self.expected[self.same]);
                if record == expected {
                    self.same += 1;
                } else {
                    self.difference = Some(self.describe(expected, record));
                }
            }
            Item::Record(words) => {
                let (count, agreed) = (words.len(), self.layout.words());
                self.broken = Some(format!("a record of {count} words, not {agreed}"));
            }
            Item::Lost(count) => self.broken = Some(format!("{count} items were lost")),
            Item::Broken(error) => self.broken = Some(error),
        }
    }

    /// Describes the first difference of two records: its step, counted from the checkpoint, and its signal.
    fn describe(&self, expected: &[u64], record: &[u64]) -> String {
        let groups = self.layout.groups();
        let differing = |group: &str| {
            let number = GROUPS.iter().position(|name| *name == group)?;
            let before: usize = groups[..number].iter().map(|group| group.len()).sum();
            let begin = self.layout.values_start() + before;
            let mut places = groups[number].iter().zip(begin..);
            let (field, place) = places.find(|(_, place)| expected[*place] != record[*place])?;
            let [value_then, value] =
                [expected, record].map(|record| f64::from_bits(record[place]));
            let name = column_name(group, &field.name);
            let (value, value_then) = (exact_in(value, &field.unit), exact(value_then));
            Some(format!("{name} is {value}, not {value_then}"))
        };
        let signal = (ORDER.iter()).find_map(|(group, side)| Some((differing(group)?, *side)));
        let (text, side) = signal.unwrap_or_else(|| {
            let answer = 1 + self.layout.sample_validity_words();
            let side = if expected[..answer] == record[..answer] {
                Side::Controller
            } else {
                Side::Plant
            };
            ("the validity of its signals".into(), side)
        });
        // The record of a step contains the plant's state before it, and the controller's answer to that.
        let step = match side {
            Side::Plant => self.same,
            Side::Controller => self.same + 1,
        };
        let at = match step {
            0 => "before step 1".into(),
            step => format!("at step {step}"),
        };
        format!("{at}: {text} ({})", side.name())
    }

    /// Returns the result; `fate` describes the end of the sides if they ended before the comparison was complete.
    pub fn check(&self, fate: Option<(Verdict, String)>) -> Check {
        let steps = self.same.saturating_sub(1) as u64;
        let plural = if steps == 1 { "" } else { "s" };
        // The record of a step in which a side dies is never published.
        let at = match self.has_begun {
            true => format!("at step {}", self.same + 1),
            false => "before step 1".into(),
        };
        let (verdict, text) = if let Some(difference) = &self.difference {
            (Verdict::Differs, format!("differs {difference}"))
        } else if self.broken.is_none() && self.same == self.expected.len() {
            let cut = match self.is_cut {
                true => ", up to a change of the live run",
                false => "",
            };
            (
                Verdict::Exact,
                format!("exact for {steps} step{plural}{cut}"),
            )
        } else {
            let (verdict, cause) = match (&self.broken, fate) {
                (Some(broken), _) => (Verdict::Failed, broken.clone()),
                (None, Some(fate)) => fate,
                (None, None) => (Verdict::Failed, "too few records arrived".into()),
            };
            let text = match verdict {
                Verdict::Crashed => format!("crashed {at}: {cause}"),
                Verdict::Stuck => format!("got stuck {at}: {cause}"),
                // The reason names the step.
                _ if self.has_begun => format!("failed after {steps} exact step{plural}: {cause}"),
                _ => format!("failed {at}: {cause}"),
            };
            (verdict, text)
        };
        Check {
            verdict,
            steps,
            text,
        }
    }
}

#[cfg(test)]
mod tests {
    use shared_types::table::Field;

    use super::*;

    fn layout() -> RecordLayout {
        let field = |name: &str| vec![Field::signal(name, "m", "x")];
        RecordLayout {
            truth: field("y_m"),
            measured: field("y_m"),
            command: field("u_m"),
            command_signals: 1,
            command_places: vec![0],
            ..RecordLayout::default()
        }
    }

    /// Returns a record of a step with these values of truth, measured, command and applied.
    fn record(step: u64, values: [f64; 4]) -> Vec<u64> {
        let layout = layout();
        let mut words = vec![0; layout.words()];
        words[0] = step;
        let begin = layout.values_start();
        for (word, value) in words[begin..].iter_mut().zip(values) {
            *word = value.to_bits();
        }
        words
    }

    fn stretch(layout: &RecordLayout, count: u64) -> Stretch {
        let mut stretch = Stretch::new(50, 0);
        for step in 50..50 + count {
            stretch.take(layout.view(&record(step, [1.0; 4])).hashed);
        }
        stretch
    }

    /// Returns the check of records that are equal except for the last, which has these values.
    fn text_of(count: u64, last: [f64; 4]) -> String {
        let (layout, recorded) = (layout(), Recorded::default());
        let stretch = stretch(&layout, count);
        let mut comparison = Comparison::new(&layout, &stretch, &recorded);
        for step in 50..49 + count {
            comparison.take(Item::Record(&record(step, [1.0; 4])));
        }
        comparison.take(Item::Record(&record(49 + count, last)));
        assert!(comparison.is_over());
        comparison.check(None).text
    }

    #[test]
    fn a_difference_names_its_step_and_the_side_that_computes_it_first() {
        assert_eq!(text_of(101, [1.0; 4]), "exact for 100 steps");
        assert_eq!(text_of(2, [1.0; 4]), "exact for 1 step");
        let plant = text_of(2, [2.0, 2.0, 3.0, 3.0]);
        assert_eq!(
            plant,
            "differs at step 1: measured.y_m is 2 m, not 1 (plant)"
        );
        let law = text_of(41, [2.0, 1.0, 3.0, 3.0]);
        assert_eq!(
            law,
            "differs at step 41: command.u_m is 3 m, not 1 (controller)"
        );
        let text = text_of(1, [1.0, f64::NAN, 1.0, 1.0]);
        assert!(text.starts_with("differs before step 1: "), "{text}");
    }

    #[test]
    fn compared_records_end_after_100_steps_or_at_a_live_change() {
        let layout = layout();
        let long = stretch(&layout, 300);
        assert_eq!(long.records.len(), 101);
        let change = serde_json::json!({"id": 1, "step": 57, "live": true});
        let recorded = Recorded {
            values: vec![serde_json::from_value(change).expect("a change")],
            ..Recorded::default()
        };
        // The record of step 57 already shows the change.
        assert_eq!(long.untouched(&recorded).len(), 7);
        let mut comparison = Comparison::new(&layout, &long, &recorded);
        for step in 50..57 {
            comparison.take(Item::Record(&record(step, [1.0; 4])));
        }
        let text = comparison.check(None).text;
        assert_eq!(text, "exact for 6 steps, up to a change of the live run");
    }
}
