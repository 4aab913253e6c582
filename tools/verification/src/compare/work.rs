//! Comparison of two recordings in parallel, one step at a time.

use std::path::Path;

use hil_recording::reader::{Column, RunReader};
use serde_json::Value;
use shared_types::record::{Event, is_on_request};
use shared_types::table::near;
use shared_types::time::{Rate, Step};

use super::{
    CompareError, ComparedRun, Comparison, Deviation, Difference, GONE, RECORD, SignalDifference,
    Verdict, number,
};
use crate::arguments::tolerance::Tolerances;

/// Comparison in progress.
pub(super) struct ComparisonPass {
    rate: Rate,
    /// Set if only selected signals are compared.
    is_selected: bool,
    columns: Vec<CommonWord>,
    /// Column indices in the order in which a step computes the values, so that the first difference points to its
    /// cause.
    causal: Vec<usize>,
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    first: Option<Difference>,
    /// Set if a recording is an excerpt: missing signals or steps then mean nothing.
    is_excerpt: bool,
    /// Set if anything other than the value of a signal differs.
    is_other: bool,
    lengths_differ: bool,
}

/// Words and faults of a run at one step.
#[derive(Default)]
pub(super) struct Row {
    words: Vec<u64>,
    faults: String,
}

impl Row {
    pub(super) fn take(&mut self, reader: &RunReader) {
        self.words.clear();
        self.words.extend(reader.words());
        self.faults = faults(reader);
    }
}

/// Returns the position of a word in the causal order of a step: the sample, the controller's answer, the plant's use
/// of that answer, the true state, and the values that follow from these.
fn rank(column: &str) -> usize {
    let order = [
        "sample_invalid",
        "measured.",
        "reference.",
        "command_invalid",
        "command.",
        "internal.",
        "applied.",
        "truth.",
    ];
    let place = order.iter().position(|prefix| column.starts_with(prefix));
    place.unwrap_or(order.len())
}

/// Returns `true` if a column depends, or may depend, on the controller's answer to a sample. `truth` counts, because
/// an acceleration depends on the command.
fn is_answer(column: &str) -> bool {
    [
        "command_invalid",
        "command.",
        "applied.",
        "internal.",
        "truth.",
    ]
    .iter()
    .any(|prefix| column.starts_with(prefix))
}

/// Word that both runs have.
struct CommonWord {
    column: Column,
    a: usize,
    b: usize,
    deviation: Deviation,
}

impl ComparisonPass {
    pub(super) fn new(
        a: &RunReader,
        b: &RunReader,
        rate: Rate,
        signals: &[String],
        tolerances: &Tolerances,
    ) -> Result<Self, CompareError> {
        let is_selected = !signals.is_empty();
        let is_excerpt = a.is_excerpt() || b.is_excerpt();
        let only = |one: &RunReader, other: &RunReader| -> Vec<String> {
            let present = one.columns().iter().filter(|column| column.is_signal());
            let present = present.filter(|column| other.place(&column.name).is_none());
            let present = present.filter(|column| !is_on_request(&column.name));
            present.map(|column| column.name.clone()).collect()
        };
        for name in signals {
            for reader in [a, b] {
                let known = reader.columns().iter().filter(|column| column.is_signal());
                let names: Vec<&str> = known.map(|column| column.name.as_str()).collect();
                if !names.contains(&name.as_str()) {
                    let path = reader.path().display();
                    let near = near(name, names);
                    return Err(CompareError::NotComparable(format!(
                        "{path} has no signal `{name}`{near}"
                    )));
                }
            }
        }
        let pairs = a
            .columns()
            .iter()
            .enumerate()
            .filter_map(|(index, column)| {
                let in_b = b.place(&column.name)?;
                // Clocks always differ; words outside the digest are compared only if selected.
                let counts = if is_selected {
                    signals.contains(&column.name)
                } else {
                    // The numbering of validity bits depends on the signals of an excerpt.
                    index < a.hashed_words() && (column.is_signal() || !is_excerpt)
                };
                counts.then(|| CommonWord {
                    a: index,
                    b: in_b,
                    deviation: Deviation::new(tolerances.of(&column.name)),
                    column: column.clone(),
                })
            });
        let columns: Vec<CommonWord> = pairs.collect();
        if !columns.iter().any(|pair| pair.column.is_signal()) {
            return Err(CompareError::NotComparable(
                "the runs have no signal in common".into(),
            ));
        }
        let names = columns.iter().map(|pair| pair.column.name.as_str());
        (tolerances.check(names)).map_err(CompareError::NotComparable)?;
        let (only_in_a, only_in_b) = if is_selected || is_excerpt {
            Default::default()
        } else {
            (only(a, b), only(b, a))
        };
        let mut causal: Vec<usize> = (0..columns.len()).collect();
        causal.sort_by_key(|&index| rank(&columns[index].column.name));
        Ok(Self {
            rate,
            is_selected,
            is_excerpt,
            causal,
            columns,
            is_other: !only_in_a.is_empty() || !only_in_b.is_empty(),
            lengths_differ: false,
            only_in_a,
            only_in_b,
            first: None,
        })
    }

    /// Returns `true` if one of the runs has no command at a step, as is the case after its last planned step.
    fn lacks_command(&self, a: &Row, b: &Row) -> bool {
        let commands =
            || (self.columns.iter()).filter(|pair| pair.column.name.starts_with("command."));
        let is_nan = |word: u64| f64::from_bits(word).is_nan();
        commands().all(|pair| is_nan(a.words[pair.a]))
            || commands().all(|pair| is_nan(b.words[pair.b]))
    }

    /// Compares a step. At the last step of a shorter run, which has no command, values that depend on the
    /// controller's answer are skipped.
    pub(super) fn step(
        &mut self,
        (a, b): (&Row, &Row),
        columns: &[Column],
        is_last_of_one: bool,
    ) -> Result<(), CompareError> {
        let (step, step_b) = (a.words[0], b.words[0]);
        if step != step_b {
            let what = format!(
                "records are missing: step {step} of one run coincides with step {step_b} of the other"
            );
            return Err(CompareError::NotComparable(what));
        }
        if !self.is_selected && !self.is_excerpt && a.faults != b.faults {
            self.is_other = true;
            let (a, b) = (a.faults.as_str(), b.faults.as_str());
            self.note(step, "faults".into(), a.into(), b.into());
        }
        let lacks_answer = is_last_of_one && self.lacks_command(a, b);
        for place in 0..self.causal.len() {
            let pair = &mut self.columns[self.causal[place]];
            if lacks_answer && is_answer(&pair.column.name) {
                continue;
            }
            let (word_a, word_b) = (a.words[pair.a], b.words[pair.b]);
            let is_signal = pair.column.is_signal();
            if is_signal {
                let (a, b) = (f64::from_bits(word_a), f64::from_bits(word_b));
                pair.deviation.take(step, a, b);
            }
            if word_a == word_b {
                continue;
            }
            if is_signal {
                let name = pair.column.name.clone();
                self.note(
                    step,
                    name,
                    number(f64::from_bits(word_a)),
                    number(f64::from_bits(word_b)),
                );
            } else {
                self.is_other = true;
                let (name, bit) = validity(&pair.column.name, word_a ^ word_b, columns);
                let validity_text = |word: u64| {
                    if word >> bit & 1 == 0 {
                        "valid"
                    } else {
                        "invalid"
                    }
                };
                self.note(
                    step,
                    name,
                    validity_text(word_a).into(),
                    validity_text(word_b).into(),
                );
            }
        }
        Ok(())
    }

    /// Records that one recording is longer than the other.
    pub(super) fn ended(&mut self, longer: &RunReader, is_a: bool) {
        self.is_other = true;
        self.lengths_differ = true;
        let (present, absent) = (Value::from("there"), Value::from(GONE));
        let (a, b) = if is_a {
            (present, absent)
        } else {
            (absent, present)
        };
        self.note(longer.step(), RECORD.into(), a, b);
    }

    fn note(&mut self, step: u64, signal: String, a: Value, b: Value) {
        if self.first.is_none() {
            let time_s = self.rate.seconds(Step(step));
            self.first = Some(Difference {
                step,
                time_s,
                signal,
                a,
                b,
            });
        }
    }

    pub(super) fn finish(self, a: &RunReader, b: &RunReader, names: (&Path, &Path)) -> Comparison {
        let side = |reader: &RunReader, run: &Path| ComparedRun {
            run: run.display().to_string(),
            records: reader.records(),
            digest: reader.digest(),
            whole: reader.is_whole(),
            unvouched: reader.unvouched().map(|unvouched| unvouched.text),
        };
        let is_near = |pair: &CommonWord| pair.deviation.is_within();
        let are_near = self.columns.iter().all(is_near);
        let differing = self.columns.iter().filter(|pair| pair.deviation.is_any());
        let signals: Vec<SignalDifference> = differing.map(CommonWord::difference).collect();
        let verdict = if self.first.is_none() && !self.is_other {
            Verdict::Same
        } else if !self.is_other && are_near {
            Verdict::WithinTolerance
        } else {
            Verdict::Different
        };
        Comparison {
            verdict,
            a: side(a, names.0),
            b: side(b, names.1),
            lengths_differ: self.lengths_differ,
            only_in_a: self.only_in_a,
            only_in_b: self.only_in_b,
            first_difference: self.first,
            signals,
        }
    }
}

impl CommonWord {
    fn difference(&self) -> SignalDifference {
        let Column { name, unit } = &self.column;
        self.deviation.of(name, unit)
    }
}

/// Formats the faults and value changes before a record, as far as the digest covers them.
fn faults(reader: &RunReader) -> String {
    let texts = reader.events().iter().filter_map(|event| match event {
        Event::Fault(fault) if !fault.wall_only => Some(format!(
            "{} {} {} {}",
            fault.kind, fault.target, fault.parameter, fault.canonical
        )),
        Event::Change(change) => Some(format!(
            "change over {} steps of {}",
            change.ramp_steps,
            change.described()
        )),
        _ => None,
    });
    let texts: Vec<String> = texts.collect();
    if texts.is_empty() {
        "none".into()
    } else {
        texts.join("; ")
    }
}

/// Returns the lowest of these validity bits and the name of its signal.
fn validity(column: &str, bits: u64, columns: &[Column]) -> (String, u32) {
    let bit = bits.trailing_zeros();
    let word = column.split_once('[').and_then(|(name, index)| {
        let index: usize = index.trim_end_matches(']').parse().ok()?;
        Some((name, index))
    });
    let groups: &[&str] = match word {
        Some(("sample_invalid", _)) => &["measured.", "reference."],
        Some(("command_invalid", _)) => &["command.", "internal."],
        _ => &[],
    };
    let number = word.map_or(0, |(_, index)| 64 * index) + bit as usize;
    let mut of_groups = columns
        .iter()
        .filter(|column| groups.iter().any(|group| column.name.starts_with(group)));
    let name = of_groups.nth(number).map_or(column, |column| &column.name);
    (format!("validity of {name}"), bit)
}
