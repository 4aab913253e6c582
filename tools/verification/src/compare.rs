//! `hil compare`: finds the first difference between two recorded runs, and the size of each signal's deviation.
//!
//! Both recordings are read step by step. The first difference concerns something that the digest covers: a fault
//! event, a validity bit or a signal. The deviation of each signal is computed over the steps that both runs have. `hil
//! rerun` uses the same comparison.

mod deviation;
mod work;

use std::fmt::Write as _;
use std::path::Path;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::results::recorded_run::RecordedRun;
use serde::Serialize;
use serde_json::Value;
use shared_types::number::{exact, exact_in};

use crate::arguments::recordings::CompareArguments;
use crate::arguments::tolerance::Tolerances;
pub(crate) use deviation::SignalDifference;
pub(crate) use deviation::{Deviation, is_near, share, write_table};
use hil_recording::reader::{ReadError, RunReader};
use work::{ComparisonPass, Row};

/// Result of comparing two runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    verdict: Verdict,
    a: ComparedRun,
    b: ComparedRun,
    /// Set if one run has steps that the other lacks; unknown for excerpts.
    lengths_differ: bool,
    /// Signals that occur in one run only.
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    /// First difference; null if the common part is equal.
    first_difference: Option<Difference>,
    /// Signals that differ at some step.
    signals: Vec<SignalDifference>,
}

/// Verdict of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// No compared value differs.
    Same,
    /// Differences are within the tolerances.
    WithinTolerance,
    /// Some difference is not allowed.
    Different,
}

impl Verdict {
    /// Returns the exit code.
    pub const fn exit(self) -> Exit {
        match self {
            Self::Same | Self::WithinTolerance => Exit::Pass,
            Self::Different => Exit::Failed,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct ComparedRun {
    run: String,
    records: u64,
    digest: String,
    /// Set if the recording is complete; a truncated recording is compared as far as it goes.
    whole: bool,
    /// Description of the parts without a checksum; null if there are none.
    unvouched: Option<String>,
}

/// Signal name of the difference at which one run has ended.
const RECORD: &str = "record";
/// Value of that difference in the run that has ended.
const GONE: &str = "not there";

/// First difference between two runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Difference {
    step: u64,
    time_s: f64,
    /// Name of a signal, `validity of` a signal, `faults`, or `record` if one run has ended.
    signal: String,
    a: Value,
    b: Value,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plain = |value: &Value| match value {
            Value::String(text) => text.clone(),
            Value::Number(number) if number.is_f64() => exact(number.as_f64().unwrap_or(f64::NAN)),
            other => other.to_string(),
        };
        let (a, b) = (plain(&self.a), plain(&self.b));
        let Self {
            step,
            time_s,
            signal,
            ..
        } = self;
        write!(f, "first difference at step {step} ({time_s} s): ")?;
        if signal == RECORD {
            let ended = if self.a == GONE { "first" } else { "second" };
            return write!(f, "only the {ended} run has ended");
        }
        write!(f, "{signal} is {a} and {b}")
    }
}

/// Error of a comparison.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The recordings have nothing in common.
    #[error("{0}")]
    NotComparable(String),
}

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Self {
        Self::usage(error)
    }
}

/// Runs the command for two runs.
///
/// # Errors
/// If a run cannot be read, or the runs cannot be compared.
pub fn command(arguments: &CompareArguments) -> Result<Exit, Failure> {
    let Some(b) = &arguments.b else {
        return Err(Failure::usage("name two runs, or one run and a --baseline"));
    };
    let tolerances = Tolerances::typed(&arguments.tolerance);
    let comparison = compare(&arguments.a, b, &arguments.signal, &tolerances)?;
    comparison.refuse_nothing()?;
    output::result(arguments.json, &comparison, || comparison.describe())?;
    Ok(comparison.verdict.exit())
}

/// Compares all signals of two runs, or only the given signals.
///
/// # Errors
/// If a run cannot be read, or the runs have nothing in common.
pub fn compare(
    a: &Path,
    b: &Path,
    signals: &[String],
    tolerances: &Tolerances,
) -> Result<Comparison, CompareError> {
    let (mut reader_a, mut reader_b) = (RunReader::open(a)?, RunReader::open(b)?);
    let (rate, rate_b) = (reader_a.rate()?, reader_b.rate()?);
    if rate != rate_b {
        let (a, b) = (rate.hz(), rate_b.hz());
        let what = format!(
            "the runs have different rates, {} and {}, so their steps are at different times",
            exact_in(a, "Hz"),
            exact_in(b, "Hz")
        );
        return Err(CompareError::NotComparable(what));
    }
    let is_excerpt = reader_a.is_excerpt() || reader_b.is_excerpt();
    let own_name = |name: &str| match RecordedRun::own_name(&reader_a, name) {
        own if own == name => RecordedRun::own_name(&reader_b, name),
        own => own,
    };
    let signals: Vec<String> = signals.iter().map(|name| own_name(name)).collect();
    let tolerances = tolerances.renamed(own_name);
    let mut work = ComparisonPass::new(&reader_a, &reader_b, rate, &signals, &tolerances)?;
    // A step is compared once it is known that both runs continue: the last record of a run has no command, which
    // must not count as a difference from a longer run.
    let mut previous: Option<(Row, Row)> = None;
    loop {
        let (mut in_a, mut in_b) = (reader_a.advance()?, reader_b.advance()?);
        // An excerpt lacks some steps.
        while is_excerpt && in_a && in_b && reader_a.step() != reader_b.step() {
            if reader_a.step() < reader_b.step() {
                in_a = reader_a.advance()?;
            } else {
                in_b = reader_b.advance()?;
            }
        }
        let is_longer = in_a != in_b && !is_excerpt;
        if let Some((a, b)) = &previous {
            work.step((a, b), reader_a.columns(), is_longer)?;
        }
        if in_a && in_b {
            let (a, b) = previous.get_or_insert_default();
            a.take(&reader_a);
            b.take(&reader_b);
            continue;
        }
        if is_longer {
            work.ended(if in_a { &reader_a } else { &reader_b }, in_a);
        }
        // Both are read to the end to complete their digests.
        while reader_a.advance()? {}
        while reader_b.advance()? {}
        return Ok(work.finish(&reader_a, &reader_b, (a, b)));
    }
}

impl Comparison {
    /// Refuses two runs without any records, because their equality would mean nothing.
    fn refuse_nothing(&self) -> Result<(), CompareError> {
        if self.a.records > 0 || self.b.records > 0 {
            return Ok(());
        }
        let (a, b) = (&self.a.run, &self.b.run);
        let what = format!("neither {a} nor {b} has a record, so there is nothing to compare");
        Err(CompareError::NotComparable(what))
    }

    /// Returns the verdict.
    #[must_use]
    pub const fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// Returns the digest of the first run.
    pub(crate) fn digest_of_a(&self) -> &str {
        &self.a.digest
    }

    /// Returns the first difference.
    pub(crate) const fn first_difference(&self) -> Option<&Difference> {
        self.first_difference.as_ref()
    }

    /// Formats the comparison for a person.
    #[must_use]
    pub fn describe(&self) -> String {
        output::text(|text| self.write(text))
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
                "same in all compared signals, {} records; the digests differ",
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
                    "  {0} was cut off and is compared as far as possible; complete it with `hil recover {0}`",
                    side.run
                )?;
            }
            if let Some(unvouched) = &side.unvouched {
                writeln!(text, "  {}: {unvouched}", side.run)?;
            }
        }
        if self.lengths_differ {
            let (a, b) = (self.a.records, self.b.records);
            writeln!(
                text,
                "  lengths differ: {a} records and {b}; the common part is compared"
            )?;
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
        write_table(text, &self.signals, "max |a - b|")
    }
}

/// Converts a signal's value to JSON; NaN and infinities become strings.
pub(crate) fn number(value: f64) -> Value {
    serde_json::Number::from_f64(value)
        .map_or_else(|| Value::from(value.to_string()), Value::Number)
}

#[cfg(test)]
mod tests;
