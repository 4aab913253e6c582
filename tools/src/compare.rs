//! `hil compare`: whether two recorded runs are the same, and if not, where and by how much.
//!
//! Goes through both recordings step by step. The first difference is one of what the digest
//! covers: a fault event, a validity bit or a signal; sizes of differences are per signal and over
//! the steps that both have. `hil rerun` uses the same comparison.

mod deviation;
pub mod tolerance;
mod work;

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use crate::baseline;
use crate::cli::recordings::CompareArguments;
use crate::exit::{Exit, Failure};
use crate::output;
use crate::run_reader::{ReadError, RunReader};
pub use deviation::SignalDifference;
pub(crate) use deviation::{Deviation, is_near, share, write_table};
use tolerance::Tolerances;
use work::Work;

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
    if let Some(name) = &arguments.baseline {
        return baseline::command(arguments, name);
    }
    let Some(b) = &arguments.b else {
        return Err(Failure::usage(
            "two runs are compared, or one with a --baseline",
        ));
    };
    let tolerances = Tolerances::typed(&arguments.tolerance);
    let comparison = compare(&arguments.a, b, &arguments.signal, &tolerances)?;
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
    tolerances: &Tolerances,
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
    let is_excerpt = reader_a.is_excerpt() || reader_b.is_excerpt();
    let mut work = Work::new(&reader_a, &reader_b, rate, signals, tolerances)?;
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
        if in_a && in_b {
            work.step(&reader_a, &reader_b)?;
            continue;
        }
        if (in_a || in_b) && !is_excerpt {
            work.ended(if in_a { &reader_a } else { &reader_b }, in_a);
        }
        // To their ends: their digests are those of all they have.
        while reader_a.advance()? {}
        while reader_b.advance()? {}
        return Ok(work.finish(&reader_a, &reader_b, (a, b)));
    }
}

impl Comparison {
    /// What comes out.
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
                    "  {0} was cut off and is compared as far as it goes; `hil recover {0}` makes a whole file of it",
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
