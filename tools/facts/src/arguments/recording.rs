//! Flags of `hil run` that select what is recorded.

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use hil_console::terminal::duration::seconds;
use hil_console::terminal::exit::Failure;
use hil_recording::compression::Compression;
use hil_recording::excerpt::Choice;
use shared_types::number::exact_in;

/// Returns the parser of a recording's compression.
pub(super) fn compression() -> impl TypedValueParser<Value = Compression> {
    let value = |name, help| PossibleValue::new(name).help(help);
    let values = [
        value("none", "None"),
        value("lz4", "Fast"),
        value("zstd", "Small"),
    ];
    PossibleValuesParser::new(values).map(|name| match name.as_str() {
        "none" => Compression::None,
        "zstd" => Compression::Zstd,
        _ => Compression::Lz4,
    })
}

/// Selection of the recorded part of a run. Digest, metrics and requirements always cover the whole run.
#[derive(Clone, Debug, Default, Args)]
pub struct ChoiceArguments {
    /// Record only matching signals, for example 'truth.*'; may be given several times. '*' records all, and in
    /// addition what each stage of a sensor or actuator takes in (sensor.*, actuator.*)
    #[arg(long, value_name = "PATTERN", help_heading = "Recording")]
    pub record: Vec<String>,
    /// Record every N-th step, and the last
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Recording")]
    pub record_every: Option<u64>,
    /// Record only the steps around each event of a fault, from BEFORE to AFTER it, besides the first and
    /// last step and the steps of --record-every
    #[arg(long, value_names = ["BEFORE", "AFTER"], num_args = 2, value_parser = seconds, help_heading = "Recording")]
    pub record_around_faults: Option<Vec<f64>>,
}

/// Maximum time for which rows are buffered for a possible fault.
const LONGEST_BEFORE_S: f64 = 60.0;

impl ChoiceArguments {
    /// Reads the choice of the recorded part, for a run with or without a recording and checkpoints.
    ///
    /// # Errors
    /// If the choice contradicts these.
    pub fn choice(&self, is_recorded: bool, has_checkpoints: bool) -> Result<Choice, Failure> {
        let around_s = match self.record_around_faults.as_deref() {
            Some([before_s, _]) if *before_s > LONGEST_BEFORE_S => {
                return Err(Failure::usage(format!(
                    "--record-around-faults keeps at most {LONGEST_BEFORE_S} s before a fault, not {}",
                    exact_in(*before_s, "s")
                )));
            }
            Some([before_s, after_s]) => Some([*before_s, *after_s]),
            _ => None,
        };
        let choice = Choice {
            signals: self.record.clone(),
            every: self.record_every,
            around_s,
        };
        if choice == Choice::default() {
            return Ok(choice);
        }
        if !is_recorded {
            return Err(Failure::usage(
                "--no-record records nothing; omit it, or the flags that select what is recorded",
            ));
        }
        if has_checkpoints && !choice.is_all() {
            return Err(Failure::usage(
                "a checkpoint needs a complete recording; omit --record, --record-every and --record-around-faults",
            ));
        }
        Ok(choice)
    }
}
