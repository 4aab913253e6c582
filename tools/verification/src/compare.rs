//! `hil compare`: whether two recorded runs are the same, and if not, where and by how much.
//!
//! Goes through both recordings step by step. The first difference is one of what the digest
//! covers: a fault event, a validity bit or a signal; sizes of differences are per signal and over
//! the steps that both have. `hil rerun` uses the same comparison.

mod deviation;
mod work;

use std::fmt::Write as _;
use std::path::Path;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use serde::Serialize;
use serde_json::Value;
use shared_types::number::{exact, exact_in};

use crate::arguments::recordings::CompareArguments;
use crate::arguments::tolerance::Tolerances;
pub(crate) use deviation::SignalDifference;
pub(crate) use deviation::{Deviation, is_near, share, write_table};
use hil_recording::reader::{ReadError, RunReader};
use work::{ComparisonPass, Row};

/// Two runs, compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    verdict: Verdict,
    a: ComparedRun,
    b: ComparedRun,
    /// True if a run has steps that the other has not; of excerpts that is not known.
    lengths_differ: bool,
    /// Signals that only one of them has.
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    /// Null if there is none among what both have.
    first_difference: Option<Difference>,
    /// Each signal that differs somewhere.
    signals: Vec<SignalDifference>,
}

/// Result of a comparison.
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

impl Verdict {
    /// Gives its exit code.
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
    /// The recording was finished; one that was cut off is compared as far as it goes.
    whole: bool,
    /// Description of what no check sum vouches for; null if that is nothing.
    unvouched: Option<String>,
}

/// Name of the difference where one run has ended.
const RECORD: &str = "record";
/// Value of that difference for the run that has ended.
const GONE: &str = "not there";

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

/// Two runs cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// Recording that cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The recordings have nothing to compare.
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
/// If the runs cannot be read or compared.
pub fn command(arguments: &CompareArguments) -> Result<Exit, Failure> {
    let Some(b) = &arguments.b else {
        return Err(Failure::usage(
            "two runs are compared, or one with a --baseline",
        ));
    };
    let tolerances = Tolerances::typed(&arguments.tolerance);
    let comparison = compare(&arguments.a, b, &arguments.signal, &tolerances)?;
    comparison.refuse_nothing()?;
    output::result(arguments.json, &comparison, || comparison.describe())?;
    Ok(comparison.verdict.exit())
}

/// Compares two runs; of all signals, or of those that are named.
///
/// # Errors
/// If one cannot be read or they have nothing in common.
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
            "the runs have other rates, {} and {}: their steps are not the same times",
            exact_in(a, "Hz"),
            exact_in(b, "Hz")
        );
        return Err(CompareError::NotComparable(what));
    }
    let is_excerpt = reader_a.is_excerpt() || reader_b.is_excerpt();
    let mut work = ComparisonPass::new(&reader_a, &reader_b, rate, signals, tolerances)?;
    // A step is compared when it is known whether both runs go on: the last record of a run has no
    // command, which is no difference to one that is longer.
    let mut held: Option<(Row, Row)> = None;
    loop {
        let (mut in_a, mut in_b) = (reader_a.advance()?, reader_b.advance()?);
        // An excerpt has not every step.
        while is_excerpt && in_a && in_b && reader_a.step() != reader_b.step() {
            if reader_a.step() < reader_b.step() {
                in_a = reader_a.advance()?;
            } else {
                in_b = reader_b.advance()?;
            }
        }
        let is_longer = in_a != in_b && !is_excerpt;
        if let Some((a, b)) = &held {
            work.step((a, b), reader_a.columns(), is_longer)?;
        }
        if in_a && in_b {
            let (a, b) = held.get_or_insert_default();
            a.take(&reader_a);
            b.take(&reader_b);
            continue;
        }
        if is_longer {
            work.ended(if in_a { &reader_a } else { &reader_b }, in_a);
        }
        // To their ends: their digests are those of all they have.
        while reader_a.advance()? {}
        while reader_b.advance()? {}
        return Ok(work.finish(&reader_a, &reader_b, (a, b)));
    }
}

impl Comparison {
    /// Refuses two runs without a single record: that they agree says nothing.
    fn refuse_nothing(&self) -> Result<(), CompareError> {
        if self.a.records > 0 || self.b.records > 0 {
            return Ok(());
        }
        let (a, b) = (&self.a.run, &self.b.run);
        let what = format!("neither {a} nor {b} has a record: there is nothing to compare");
        Err(CompareError::NotComparable(what))
    }

    /// Returns the verdict.
    #[must_use]
    pub const fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// The digest of the first of both.
    #[must_use]
    pub fn digest_of_a(&self) -> &str {
        &self.a.digest
    }

    /// The first thing that differs.
    #[must_use]
    pub const fn first_difference(&self) -> Option<&Difference> {
        self.first_difference.as_ref()
    }

    /// The comparison as a person reads it.
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
                    "  {0} was cut off and is compared as far as it goes; `hil recover {0}` makes a whole file of it",
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
                "  lengths differ: {a} records and {b}; what both have is compared"
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

/// A signal's value in JSON; what that has no number for, as text.
pub(crate) fn number(value: f64) -> Value {
    serde_json::Number::from_f64(value)
        .map_or_else(|| Value::from(value.to_string()), Value::Number)
}

#[cfg(test)]
mod tests;
