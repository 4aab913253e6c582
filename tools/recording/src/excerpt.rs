//! Excerpt of a run: selected signals, every N-th step, and the steps around faults.
//!
//! Used by the [recording](super), which writes the resulting rows. Rows are buffered until they are too old to precede
//! a fault, so that the times of faults need not be known in advance. Processing a row allocates nothing.

use std::collections::VecDeque;
use std::ops::Range;

use glob::Pattern;
use shared_types::number::exact_in;
use shared_types::record::{GROUPS, RecordLayout, RecordView, Timing};
use shared_types::table::{Field, near};
use shared_types::time::{Rate, Step};

use crate::schema::{column_name, column_of};

/// Selection of the signals and steps to record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// Patterns of signal names; empty for all signals.
    pub signals: Vec<String>,
    /// Stride between recorded steps; `None` for every step or, with `around_s`, only for the first and last step.
    pub every: Option<u64>,
    /// Times before and after every fault event that are recorded completely, in s.
    pub around_s: Option<[f64; 2]>,
}

impl Choice {
    /// Returns `true` if every signal of every step is recorded: without a choice, and with the pattern `*` also what
    /// a record has on request only.
    #[must_use]
    pub fn is_all(&self) -> bool {
        let has_all = self.signals.is_empty() || self.signals.iter().any(|pattern| pattern == "*");
        has_all && self.every.is_none() && self.around_s.is_none()
    }

    /// Returns `true` if a pattern names this signal, which a record has on request only.
    #[must_use]
    pub fn asks_for(&self, name: &str) -> bool {
        let recorded = column_of(name);
        let mut patterns = (self.signals.iter()).filter_map(|text| Pattern::new(text).ok());
        patterns.any(|pattern| pattern.matches(name) || pattern.matches(&recorded))
    }

    /// Describes the excerpt, as stored in the recording.
    #[must_use]
    pub fn describe(&self) -> String {
        let mut parts = Vec::new();
        if !self.signals.is_empty() {
            parts.push(format!("signals {}", self.signals.join(" ")));
        }
        if let Some(every) = self.every {
            parts.push(format!("every {every} steps"));
        }
        if let Some([before_s, after_s]) = self.around_s {
            parts.push(format!(
                "{} before and {} after faults",
                exact_in(before_s, "s"),
                exact_in(after_s, "s")
            ));
        }
        parts.join(", ")
    }

    /// Returns `true` for each signal of a record that is recorded. A pattern may match any name of a signal; an exact
    /// name takes precedence over an alias of another signal.
    ///
    /// # Errors
    /// If a pattern is invalid or matches no signal.
    pub fn selected(&self, layout: &RecordLayout) -> Result<Vec<bool>, String> {
        let names = names(layout);
        let mut selected = vec![self.signals.is_empty(); names.len()];
        for text in &self.signals {
            let pattern = Pattern::new(text)
                .map_err(|error| format!("`{text}` is not a valid pattern: {error}"))?;
            let is_exact = names.iter().any(|(name, _)| name == text);
            let mut fits = false;
            for ((name, further), is_selected) in names.iter().zip(&mut selected) {
                let fits_further = || further.iter().any(|name| pattern.matches(name));
                if pattern.matches(name) || (!is_exact && fits_further()) {
                    (*is_selected, fits) = (true, true);
                }
            }
            if !fits {
                let near = near(text, names.iter().map(|(name, _)| name.as_str()));
                return Err(format!("no signal of this run matches `{text}`{near}"));
            }
        }
        Ok(selected)
    }
}

/// Lists the signals of a record in order: the column name in recordings, and all aliases.
fn names(layout: &RecordLayout) -> Vec<(String, Vec<String>)> {
    let of = |group: &str, field: &Field| {
        let further = (field.names())
            .flat_map(|name| [column_name(group, name), format!("{group}.{name}")])
            .skip(1);
        (column_name(group, &field.name), further.collect())
    };
    let groups = GROUPS.iter().zip(layout.groups());
    groups
        .flat_map(|(group, fields)| fields.iter().map(move |field| of(group, field)))
        .collect()
}

/// Data that precedes the words of a record.
#[derive(Clone, Copy, Debug)]
pub(super) struct Head {
    pub(super) step: u64,
    pub(super) time_ns: u64,
    pub(super) published_ns: u64,
}

impl Head {
    pub(super) fn of(view: &RecordView<'_>) -> Self {
        Self {
            step: view.step,
            time_ns: view.timing.time_ns,
            published_ns: view.timing.published_ns,
        }
    }
}

/// Selection of rows in progress.
pub(super) struct Excerpt {
    form: Form,
    last: Step,
    every: Option<u64>,
    before: u64,
    after: Option<u64>,
    /// Buffered rows that may turn out to precede a fault, concatenated.
    words: VecDeque<u64>,
    heads: VecDeque<Head>,
    /// Last step up to which every row is recorded.
    whole_until: Option<u64>,
    /// Current row.
    row: Vec<u64>,
}

/// Selection of the words of a record, including the rearrangement of validity bits.
struct Form {
    groups: [Vec<Field>; GROUPS.len()],
    sample: Bits,
    command: Bits,
    /// Indices of signals and times in a record.
    places: Vec<usize>,
}

/// Validity bits of the selected signals.
struct Bits {
    /// Range of the validity words in a record.
    from: Range<usize>,
    /// Numbers of the selected bits, in order.
    places: Vec<usize>,
}

impl Bits {
    fn words(&self) -> usize {
        self.places.len().div_ceil(64).max(1)
    }

    fn push(&self, record: &[u64], row: &mut VecDeque<u64>) {
        let words = &record[self.from.clone()];
        for part in self.places.chunks(64) {
            let bits = part
                .iter()
                .enumerate()
                .map(|(new, old)| (words[old / 64] >> (old % 64) & 1) << new);
            row.push_back(bits.sum());
        }
        if self.places.is_empty() {
            row.push_back(0);
        }
    }
}

impl Form {
    fn new(layout: &RecordLayout, choice: &Choice) -> Result<Self, String> {
        let groups = layout.groups();
        let selected = choice.selected(layout)?;
        let mut places = Vec::new();
        let mut kept_of: [Vec<Field>; GROUPS.len()] = Default::default();
        let mut starts = [0; GROUPS.len()];
        let mut index = 0;
        for ((start, fields), kept_fields) in starts.iter_mut().zip(groups).zip(&mut kept_of) {
            *start = index;
            for field in fields {
                if selected[index] {
                    places.push(layout.values_start() + index);
                    kept_fields.push(field.clone());
                }
                index += 1;
            }
        }
        let times = layout.values_start() + index;
        places.extend(times..times + Timing::WORDS);
        let place_of = |group: &str| GROUPS.iter().position(|one| *one == group).unwrap_or(0);
        // Returns the bit numbers of the selected signals of a group.
        let bits = |group: &str, bits: &mut dyn Iterator<Item = usize>| -> Vec<usize> {
            let place = place_of(group);
            let of_group = &selected[starts[place]..][..groups[place].len()];
            let is_kept = bits.zip(of_group).filter(|(_, is_selected)| **is_selected);
            is_kept.map(|(bit, _)| bit).collect()
        };
        let measured = layout.measured.len();
        let first_internal = layout.command_signals - layout.internal.len();
        // In the order of the frame, which may differ from that of the plant.
        let mut command = bits("command", &mut layout.command_places.iter().copied());
        command.sort_unstable();
        let sample_end = 1 + layout.sample_validity_words();
        Ok(Self {
            sample: Bits {
                from: 1..sample_end,
                places: [
                    bits("measured", &mut (0..)),
                    bits("reference", &mut (measured..)),
                ]
                .concat(),
            },
            command: Bits {
                from: sample_end..layout.values_start(),
                places: [command, bits("internal", &mut (first_internal..))].concat(),
            },
            groups: kept_of,
            places,
        })
    }

    fn width(&self) -> usize {
        1 + self.sample.words() + self.command.words() + self.places.len()
    }
}

impl Excerpt {
    /// # Errors
    /// If a pattern is invalid or matches no signal.
    pub(super) fn new(
        layout: &RecordLayout,
        choice: &Choice,
        rate: Rate,
        last: Step,
    ) -> Result<Self, String> {
        let form = Form::new(layout, choice)?;
        let steps = |seconds: f64| rate.step_at_or_after(seconds).0;
        let before = choice.around_s.map_or(0, |[before_s, _]| steps(before_s));
        let rows = before as usize + 1;
        let width = form.width();
        Ok(Self {
            last,
            every: match (choice.every, choice.around_s) {
                (None, None) => Some(1),
                (every, _) => every,
            },
            before,
            after: choice.around_s.map(|[_, after_s]| steps(after_s)),
            words: VecDeque::with_capacity(rows * width),
            heads: VecDeque::with_capacity(rows),
            whole_until: None,
            row: Vec::with_capacity(width),
            form,
        })
    }

    /// Returns the numbers of validity words of sample and command, and the signals of each group.
    pub(super) fn form(&self) -> (usize, usize, [&[Field]; GROUPS.len()]) {
        let Form {
            groups,
            sample,
            command,
            ..
        } = &self.form;
        let groups = std::array::from_fn(|index| groups[index].as_slice());
        (sample.words(), command.words(), groups)
    }

    /// Adds a record.
    pub(super) fn take(&mut self, words: &[u64], view: &RecordView<'_>) {
        self.heads.push_back(Head::of(view));
        let row = &mut self.words;
        row.push_back(view.step);
        self.form.sample.push(words, row);
        self.form.command.push(words, row);
        row.extend(self.form.places.iter().map(|place| words[*place]));
    }

    /// Registers a fault event before the next record: the buffered rows and those that follow are recorded.
    pub(super) fn fault(&mut self, step: u64) {
        if let Some(after) = self.after {
            let until = step + after;
            self.whole_until = Some(self.whole_until.map_or(until, |known| known.max(until)));
        }
    }

    /// Returns the next row that is ready to be written; at the end also the remaining ones.
    pub(super) fn next(&mut self, is_over: bool) -> Option<(Head, &[u64])> {
        while let Some(head) = self.heads.front().copied() {
            let is_around = self.whole_until.is_some_and(|until| head.step <= until);
            let is_old = self.heads.len() as u64 > self.before;
            if !(is_around || is_old || is_over) {
                return None;
            }
            self.heads.pop_front();
            let is_end = head.step == self.last.0 || (is_over && self.heads.is_empty());
            let is_picked = self
                .every
                .is_some_and(|every| head.step.is_multiple_of(every));
            let row = self.words.drain(..self.form.width());
            if is_around || is_picked || is_end || head.step == 0 {
                self.row.clear();
                self.row.extend(row);
                return Some((head, &self.row));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> RecordLayout {
        let fields = |n: usize| {
            let field = |i| Field::signal(&format!("s{i}_m"), "m", "x");
            (0..n).map(field).collect::<Vec<_>>()
        };
        RecordLayout {
            truth: fields(2),
            measured: fields(70),
            reference: fields(3),
            command: fields(2),
            internal: fields(1),
            input: Vec::new(),
            command_signals: 3,
            command_places: vec![1, 0],
            parameter: Vec::new(),
            sensor: Vec::new(),
            actuator: Vec::new(),
        }
    }

    /// Returns the recorded steps of a run of 100 steps at 10 Hz, with a fault before step 50.
    fn steps(choice: &Choice) -> Vec<u64> {
        let layout = layout();
        let rate = Rate::new(10.0).expect("a rate");
        let mut excerpt = Excerpt::new(&layout, choice, rate, Step(100)).expect("right");
        let mut words = vec![0; layout.words()];
        let mut steps = Vec::new();
        for step in 0..=100 {
            if step == 50 {
                excerpt.fault(50);
            }
            words[0] = step;
            excerpt.take(&words, &layout.view(&words));
            while let Some((head, row)) = excerpt.next(false) {
                assert_eq!(head.step, row[0]);
                steps.push(head.step);
            }
        }
        while let Some((head, _)) = excerpt.next(true) {
            steps.push(head.step);
        }
        steps
    }

    #[test]
    fn every_nth_step_and_the_last_are_recorded() {
        let choice = Choice {
            every: Some(30),
            ..Choice::default()
        };
        assert_eq!(steps(&choice), [0, 30, 60, 90, 100]);
    }

    #[test]
    fn every_step_around_a_fault_is_recorded() {
        let around = Choice {
            around_s: Some([0.35, 0.2]), // 4 and 2 steps
            ..Choice::default()
        };
        assert_eq!(steps(&around), [0, 46, 47, 48, 49, 50, 51, 52, 100]);
        let both = Choice {
            every: Some(48),
            ..around
        };
        assert_eq!(steps(&both), [0, 46, 47, 48, 49, 50, 51, 52, 96, 100]);
    }

    #[test]
    fn selected_signals_keep_their_values_and_validity() {
        let layout = layout();
        let choice = Choice {
            signals: [
                "measured.s6?_m",
                "reference.s1_m",
                "command.s1_m",
                "internal.*",
            ]
            .map(Into::into)
            .to_vec(),
            ..Choice::default()
        };
        let rate = Rate::new(10.0).expect("a rate");
        let mut excerpt = Excerpt::new(&layout, &choice, rate, Step(9)).expect("right");
        let mut words: Vec<u64> = (0..layout.words() as u64)
            .map(|index| 1000 + index)
            .collect();
        // Step; 73 bits of the sample; 3 of the frame for command 1, command 0 and the internal; then 2 truth, 70
        // measured and 3 reference signals.
        words[..4].copy_from_slice(&[7, 1 << 60 | 1 << 62 | 1, 1 << (71 - 64), 0b101]);
        excerpt.take(&words, &layout.view(&words));
        let (sample_words, command_words, groups) = excerpt.form();
        assert_eq!((sample_words, command_words), (1, 1));
        assert_eq!(
            groups.map(<[Field]>::len),
            [0, 10, 1, 1, 0, 1, 0, 0, 0, 0, 0, 0]
        );
        let (_, row) = excerpt.next(false).expect("a row");
        // Measured 60 to 69 and reference 1; command 1 and internal 0.
        assert_eq!(row[..3], [7, 0b101 | 1 << 10, 0b11]);
        let measured: Vec<u64> = (0..10).map(|i| 1000 + 4 + 2 + 60 + i).collect();
        assert_eq!(row[3..13], measured);
        let reference = 1000 + 4 + 2 + 70 + 1;
        let command = reference - 1 + 3 + 1;
        assert_eq!(row[13..16], [reference, command, command - 1 + 2 + 2]);
        assert_eq!(row.len(), 16 + Timing::WORDS);
        assert_eq!(row[16], words[layout.words() - Timing::WORDS]);
    }

    #[test]
    fn the_error_for_a_pattern_without_match_names_the_nearest_signal() {
        let choice = Choice {
            signals: vec!["truth.s1_n".into()],
            ..Choice::default()
        };
        let rate = Rate::new(10.0).expect("a rate");
        let error = Excerpt::new(&layout(), &choice, rate, Step(9))
            .err()
            .expect("none");
        assert!(error.contains("nearest: `truth.s1_m`"), "{error}");
    }
}
