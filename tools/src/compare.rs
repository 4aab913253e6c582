//! `hil compare`: whether two recorded runs are the same, and if not, where and by how much.
//!
//! Goes through both recordings step by step. The first difference is one of what the digest
//! covers: a fault event, a validity bit or a signal; sizes of differences are per signal and over
//! the steps that both have. `hil rerun` uses the same comparison.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use shared_types::record::Event;
use shared_types::table::nearest;
use shared_types::time::{Rate, Step};

use crate::cli::recordings::CompareArguments;
use crate::exit::{Exit, Failure};
use crate::live::listed;
use crate::output;
use crate::run_reader::{Column, ReadError, RunReader};

/// Two runs, compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    verdict: Verdict,
    a: Side,
    b: Side,
    /// Signals that only one of them has.
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    /// Null if there is none among what both have.
    first_difference: Option<Difference>,
    /// Each signal that differs somewhere.
    signals: Vec<SignalDifference>,
}

/// What comes out of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing that was looked at differs.
    Same,
    /// Signals differ by no more than was allowed.
    WithinTolerance,
    /// Something differs.
    Different,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Side {
    run: String,
    records: u64,
    digest: String,
    /// Whether the recording was finished; one that was cut off is compared as far as it goes.
    whole: bool,
}

/// The first thing that differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    step: u64,
    time_s: f64,
    /// A signal, the validity of one, `faults`, or `record` where one run has ended.
    signal: String,
    a: Value,
    b: Value,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plain = |value: &Value| match value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let (a, b) = (plain(&self.a), plain(&self.b));
        let Self {
            step,
            time_s,
            signal,
            ..
        } = self;
        write!(
            f,
            "first difference at step {step} ({time_s} s): {signal} is {a} and {b}"
        )
    }
}

/// By how much a signal differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct SignalDifference {
    name: String,
    unit: String,
    max_abs_difference: f64,
    /// Where that is; null if the signal is nowhere a number in both.
    at_step: Option<u64>,
    rms_difference: f64,
    /// Steps at which it is a finite number in at most one of them and not the same in both.
    incomparable_steps: u64,
}

/// Two runs cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// One cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// They have nothing to compare.
    #[error("{0}")]
    NotComparable(String),
}

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Self {
        Self::usage(error)
    }
}

/// Runs the command.
///
/// # Errors
/// If the runs cannot be read or compared.
pub fn command(arguments: &CompareArguments) -> Result<Exit, Failure> {
    let tolerance = arguments.tolerance;
    if tolerance.is_nan() || tolerance < 0.0 {
        return Err(Failure::usage(format!(
            "--tolerance takes a number of at least 0, not {tolerance}"
        )));
    }
    let comparison = compare(&arguments.a, &arguments.b, &arguments.signal, tolerance)?;
    output::write(&if arguments.json {
        let json = serde_json::to_string_pretty(&comparison).map_err(Failure::infrastructure)?;
        json + "\n"
    } else {
        comparison.told()
    })?;
    Ok(match comparison.verdict {
        Verdict::Same | Verdict::WithinTolerance => Exit::Pass,
        Verdict::Different => Exit::Failed,
    })
}

/// Compares two runs; of all signals, or of those that are named.
///
/// # Errors
/// If one cannot be read or they have nothing in common.
pub fn compare(
    a: &Path,
    b: &Path,
    signals: &[String],
    tolerance: f64,
) -> Result<Comparison, CompareError> {
    let (mut reader_a, mut reader_b) = (RunReader::open(a)?, RunReader::open(b)?);
    let (rate, rate_b) = (reader_a.rate()?, reader_b.rate()?);
    if rate != rate_b {
        let (a, b) = (rate.hz(), rate_b.hz());
        let what = format!(
            "the runs have other rates, {a} Hz and {b} Hz: their steps are not the same times"
        );
        return Err(CompareError::NotComparable(what));
    }
    let mut work = Work::new(&reader_a, &reader_b, rate, signals)?;
    loop {
        let (in_a, in_b) = (reader_a.advance()?, reader_b.advance()?);
        if in_a && in_b {
            work.step(&reader_a, &reader_b)?;
            continue;
        }
        if in_a || in_b {
            work.ended(if in_a { &reader_a } else { &reader_b }, in_a);
        }
        // To their ends: their digests are those of all they have.
        while reader_a.advance()? {}
        while reader_b.advance()? {}
        return Ok(work.finish(&reader_a, &reader_b, (a, b), tolerance));
    }
}

/// A comparison going on.
struct Work {
    rate: Rate,
    /// Whether signals were named; then nothing else counts.
    is_selected: bool,
    columns: Vec<Pair>,
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    first: Option<Difference>,
    /// Anything but the size of a signal differs.
    is_other: bool,
}

/// A word that both have.
struct Pair {
    column: Column,
    a: usize,
    b: usize,
    /// Records at which it was a finite number in both.
    compared: u64,
    differs: bool,
    max: f64,
    at_step: Option<u64>,
    squares: f64,
    incomparable: u64,
}

impl Work {
    fn new(
        a: &RunReader,
        b: &RunReader,
        rate: Rate,
        signals: &[String],
    ) -> Result<Self, CompareError> {
        let is_selected = !signals.is_empty();
        let place = |reader: &RunReader, name: &str| {
            reader
                .columns()
                .iter()
                .position(|column| column.name == name)
        };
        let only = |one: &RunReader, other: &RunReader| -> Vec<String> {
            let own = one.columns().iter().filter(|column| column.is_signal());
            let own = own.filter(|column| place(other, &column.name).is_none());
            own.map(|column| column.name.clone()).collect()
        };
        for name in signals {
            for reader in [a, b] {
                let known = reader.columns().iter().filter(|column| column.is_signal());
                let known: Vec<&str> = known.map(|column| column.name.as_str()).collect();
                if !known.contains(&name.as_str()) {
                    let path = reader.path().display();
                    let near = nearest(name, known);
                    let near = if near.is_empty() {
                        String::new()
                    } else {
                        format!("; nearest: {}", listed(&near))
                    };
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
                let in_b = place(b, &column.name)?;
                // Clocks are never the same; what is left out of the digest is looked at if asked for.
                let counts = if is_selected {
                    signals.contains(&column.name)
                } else {
                    index < a.hashed_words()
                };
                counts.then(|| Pair::new(column.clone(), index, in_b))
            });
        let columns: Vec<Pair> = pairs.collect();
        if !columns.iter().any(|pair| pair.column.is_signal()) {
            return Err(CompareError::NotComparable(
                "the runs have no signal in common".into(),
            ));
        }
        let (only_in_a, only_in_b) = if is_selected {
            Default::default()
        } else {
            (only(a, b), only(b, a))
        };
        Ok(Self {
            rate,
            is_selected,
            columns,
            is_other: !only_in_a.is_empty() || !only_in_b.is_empty(),
            only_in_a,
            only_in_b,
            first: None,
        })
    }

    fn step(&mut self, a: &RunReader, b: &RunReader) -> Result<(), CompareError> {
        let step = a.step();
        if step != b.step() {
            let what = format!(
                "records are missing: step {step} of one comes with step {} of the other",
                b.step()
            );
            return Err(CompareError::NotComparable(what));
        }
        if !self.is_selected {
            let (faults_a, faults_b) = (faults(a), faults(b));
            if faults_a != faults_b {
                self.is_other = true;
                self.note(step, "faults".into(), faults_a.into(), faults_b.into());
            }
        }
        for index in 0..self.columns.len() {
            let pair = &mut self.columns[index];
            let (word_a, word_b) = (a.words()[pair.a], b.words()[pair.b]);
            let is_signal = pair.column.is_signal();
            if is_signal {
                pair.take(step, f64::from_bits(word_a), f64::from_bits(word_b));
            }
            if word_a == word_b {
                continue;
            }
            if is_signal {
                let name = pair.column.name.clone();
                self.note(step, name, number(word_a), number(word_b));
            } else {
                self.is_other = true;
                let (name, bit) = validity(&pair.column.name, word_a ^ word_b, a.columns());
                let told = |word: u64| {
                    if word >> bit & 1 == 0 {
                        "valid"
                    } else {
                        "invalid"
                    }
                };
                self.note(step, name, told(word_a).into(), told(word_b).into());
            }
        }
        Ok(())
    }

    /// One has a record more than the other.
    fn ended(&mut self, longer: &RunReader, is_a: bool) {
        self.is_other = true;
        let (there, not) = (Value::from("there"), Value::from("not there"));
        let (a, b) = if is_a { (there, not) } else { (not, there) };
        self.note(longer.step(), "record".into(), a, b);
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

    fn finish(
        self,
        a: &RunReader,
        b: &RunReader,
        names: (&Path, &Path),
        tolerance: f64,
    ) -> Comparison {
        let side = |reader: &RunReader, run: &Path| Side {
            run: run.display().to_string(),
            records: reader.records(),
            digest: reader.digest(),
            whole: reader.is_whole(),
        };
        let differing = self.columns.iter().filter(|pair| pair.differs);
        let signals: Vec<SignalDifference> = differing.map(Pair::difference).collect();
        let is_small = |signal: &SignalDifference| {
            signal.incomparable_steps == 0 && signal.max_abs_difference <= tolerance
        };
        let verdict = if self.first.is_none() && !self.is_other {
            Verdict::Same
        } else if tolerance > 0.0 && !self.is_other && signals.iter().all(is_small) {
            Verdict::WithinTolerance
        } else {
            Verdict::Different
        };
        Comparison {
            verdict,
            a: side(a, names.0),
            b: side(b, names.1),
            only_in_a: self.only_in_a,
            only_in_b: self.only_in_b,
            first_difference: self.first,
            signals,
        }
    }
}

impl Pair {
    const fn new(column: Column, a: usize, b: usize) -> Self {
        Self {
            column,
            a,
            b,
            compared: 0,
            differs: false,
            max: 0.0,
            at_step: None,
            squares: 0.0,
            incomparable: 0,
        }
    }

    fn take(&mut self, step: u64, a: f64, b: f64) {
        let is_same = a.to_bits() == b.to_bits();
        self.differs |= !is_same;
        if a.is_finite() && b.is_finite() {
            let difference = (a - b).abs();
            self.compared += 1;
            self.squares += difference * difference;
            if difference > self.max || (!is_same && self.at_step.is_none()) {
                (self.max, self.at_step) = (difference, Some(step));
            }
        } else if !is_same {
            self.incomparable += 1;
        }
    }

    fn difference(&self) -> SignalDifference {
        let rms = if self.compared > 0 {
            (self.squares / self.compared as f64).sqrt()
        } else {
            0.0
        };
        SignalDifference {
            name: self.column.name.clone(),
            unit: self.column.unit.clone(),
            max_abs_difference: self.max,
            at_step: self.at_step,
            rms_difference: rms,
            incomparable_steps: self.incomparable,
        }
    }
}

/// The fault events of the digest in front of a record, as text.
fn faults(reader: &RunReader) -> String {
    let taken = reader.events().iter().filter_map(|event| match event {
        Event::Fault(taken) if !taken.wall_only => Some(format!(
            "{} {} {} {}",
            taken.kind, taken.target, taken.parameter, taken.canonical
        )),
        _ => None,
    });
    let taken: Vec<String> = taken.collect();
    if taken.is_empty() {
        "none".into()
    } else {
        taken.join("; ")
    }
}

/// A signal's value; what JSON has no number for, as text.
fn number(word: u64) -> Value {
    let value = f64::from_bits(word);
    serde_json::Number::from_f64(value)
        .map_or_else(|| Value::from(value.to_string()), Value::Number)
}

/// Whose validity the lowest of these bits is, and the bit.
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

impl Comparison {
    /// What comes out.
    #[must_use]
    pub const fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// The first thing that differs.
    #[must_use]
    pub const fn first_difference(&self) -> Option<&Difference> {
        self.first_difference.as_ref()
    }

    /// The comparison as a person reads it.
    #[must_use]
    pub fn told(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let same_digest = self.a.digest == self.b.digest;
        match self.verdict {
            Verdict::Same if same_digest => writeln!(
                text,
                "same digest {}, {} records",
                self.a.digest, self.a.records
            )?,
            Verdict::Same => writeln!(
                text,
                "same in what was looked at, {} records; the digests differ",
                self.a.records
            )?,
            Verdict::WithinTolerance => writeln!(text, "within the tolerance")?,
            Verdict::Different => writeln!(text, "different")?,
        }
        for side in [&self.a, &self.b] {
            if !same_digest {
                writeln!(
                    text,
                    "  digest {}, {} records: {}",
                    side.digest, side.records, side.run
                )?;
            }
            if !side.whole {
                writeln!(
                    text,
                    "  {} was cut off and is compared as far as it goes",
                    side.run
                )?;
            }
        }
        for (side, only) in [(&self.a, &self.only_in_a), (&self.b, &self.only_in_b)] {
            if !only.is_empty() {
                writeln!(text, "  only in {}: {}", side.run, only.join(", "))?;
            }
        }
        if let Some(first) = &self.first_difference {
            writeln!(text, "  {first}")?;
        }
        if self.signals.is_empty() {
            return Ok(());
        }
        let width = self
            .signals
            .iter()
            .map(|signal| signal.name.len())
            .max()
            .unwrap_or(0)
            .max(6);
        writeln!(
            text,
            "\n  {:<width$}  {:>12}  {:>9}  {:>12}",
            "signal", "max |a - b|", "at step", "rms"
        )?;
        for signal in &self.signals {
            let SignalDifference {
                name,
                unit,
                max_abs_difference: max,
                rms_difference: rms,
                incomparable_steps,
                ..
            } = signal;
            let at_step = signal
                .at_step
                .map_or_else(|| "-".into(), |step| step.to_string());
            write!(
                text,
                "  {name:<width$}  {max:>12.5e}  {at_step:>9}  {rms:>12.5e} {unit}"
            )?;
            if *incomparable_steps > 0 {
                write!(text, ", not both numbers at {incomparable_steps} steps")?;
            }
            writeln!(text)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use shared_types::table::Field;

    use super::*;
    use crate::run_reader::tests::{Content, layout, record, recorded, taken};

    /// A run of four records; `change` may spoil one.
    fn run(name: &str, change: impl Fn(u64, &mut Vec<u64>)) -> PathBuf {
        let contents: Vec<Content> = (0..4)
            .map(|step| {
                let mut words = record(step, step as f64, -1.0);
                change(step, &mut words);
                Content::Record(words)
            })
            .collect();
        recorded(name, &layout(), &contents, vec![], true)
    }

    fn first(comparison: &Comparison) -> String {
        comparison
            .first_difference
            .as_ref()
            .map_or_else(String::new, ToString::to_string)
    }

    #[test]
    fn the_first_difference_and_the_size_of_each_are_found() {
        let a = run("compare-a", |_, _| ());
        let same = run("compare-same", |step, words| words[13] = step); // a clock
        // truth.x_m is word 3: off by 3 at step 1 and by 4 at step 2.
        let b = run("compare-b", |step, words| match step {
            1 => words[3] = 4.0_f64.to_bits(),
            2 => words[3] = (-2.0_f64).to_bits(),
            _ => {}
        });
        let nan = run("compare-nan", |step, words| {
            if step == 3 {
                words[5] = f64::NAN.to_bits(); // command.u_n
            }
        });
        let bits = run("compare-bits", |step, words| {
            words[1] = u64::from(step == 2)
        });
        let with = |b: &PathBuf, tolerance| compare(&a, b, &[], tolerance).expect("comparable");

        let comparison = with(&same, 0.0);
        assert_eq!(
            (comparison.verdict, comparison.first_difference),
            (Verdict::Same, None)
        );
        assert_eq!(comparison.a.digest, comparison.b.digest);

        let comparison = with(&b, 0.0);
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(
            first(&comparison),
            "first difference at step 1 (0.001 s): truth.x_m is 1.0 and 4.0"
        );
        let expected = SignalDifference {
            name: "truth.x_m".into(),
            unit: "m".into(),
            max_abs_difference: 4.0,
            at_step: Some(2),
            rms_difference: 2.5, // sqrt((9 + 16) / 4)
            incomparable_steps: 0,
        };
        assert_eq!(comparison.signals, [expected]);
        assert_eq!(with(&b, 4.0).verdict, Verdict::WithinTolerance);
        assert_eq!(with(&b, 3.9).verdict, Verdict::Different);
        let others = compare(&a, &b, &["command.u_n".into()], 0.0).expect("comparable");
        assert_eq!((others.verdict, others.signals.len()), (Verdict::Same, 0));

        let comparison = with(&nan, 10.0);
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(
            first(&comparison),
            "first difference at step 3 (0.003 s): command.u_n is -1.0 and NaN"
        );
        assert_eq!(comparison.signals[0].incomparable_steps, 1);

        let comparison = with(&bits, 10.0);
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(
            first(&comparison),
            "first difference at step 2 (0.002 s): validity of measured.x_m is valid and invalid"
        );
        for folder in [a, same, b, nan, bits] {
            std::fs::remove_dir_all(folder).expect("removed");
        }
    }

    #[test]
    fn faults_and_ends_differ_too() {
        let records = |count| (0..count).map(|step| Content::Record(record(step, 0.0, 0.0)));
        let plain = recorded(
            "compare-plain",
            &layout(),
            &records(3).collect::<Vec<_>>(),
            vec![],
            true,
        );
        let longer = recorded(
            "compare-longer",
            &layout(),
            &records(4).collect::<Vec<_>>(),
            vec![],
            true,
        );
        let mut contents: Vec<Content> = records(3).collect();
        contents.insert(2, Content::Event(taken(2)));
        let faulty = recorded("compare-faulty", &layout(), &contents, vec![], true);
        let comparison = compare(&plain, &faulty, &[], 1.0).expect("comparable");
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(
            first(&comparison),
            "first difference at step 2 (0.002 s): faults is none and bias measured.x_m x_m bias=0 step"
        );
        let comparison = compare(&plain, &longer, &[], 1.0).expect("comparable");
        assert_eq!(comparison.verdict, Verdict::Different);
        assert_eq!(
            first(&comparison),
            "first difference at step 3 (0.003 s): record is not there and there"
        );
        assert_eq!((comparison.a.records, comparison.b.records), (3, 4));
        for folder in [plain, longer, faulty] {
            std::fs::remove_dir_all(folder).expect("removed");
        }
    }

    #[test]
    fn other_layouts_are_told_by_name() {
        let mut other = layout();
        other.internal = vec![Field::signal("gain_1", "1", "Gain.")];
        other.command_signals = 2;
        let words: Vec<u64> = [&record(0, 0.0, 0.0)[..7], &[0], &record(0, 0.0, 0.0)[7..]].concat();
        let a = recorded(
            "layout-a",
            &layout(),
            &[Content::Record(record(0, 0.0, 0.0))],
            vec![],
            true,
        );
        let b = recorded("layout-b", &other, &[Content::Record(words)], vec![], true);
        let comparison = compare(&a, &b, &[], 0.0).expect("comparable");
        assert_eq!(
            (comparison.verdict, comparison.first_difference),
            (Verdict::Different, None)
        );
        assert_eq!(
            (comparison.only_in_a.len(), comparison.only_in_b),
            (0, vec!["internal.gain_1".to_owned()])
        );
        let selected = compare(&a, &b, &["truth.x_m".into()], 0.0).expect("comparable");
        assert_eq!(selected.verdict, Verdict::Same);
        let error = compare(&a, &b, &["truth.x".into()], 0.0)
            .expect_err("no such signal")
            .to_string();
        assert!(
            error.contains("has no signal `truth.x`; nearest: `truth.x_m`"),
            "{error}"
        );
        for folder in [a, b] {
            std::fs::remove_dir_all(folder).expect("removed");
        }
    }
}
