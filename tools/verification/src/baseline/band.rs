//! Band of a baseline: where it lets each signal be, for plots.
//!
//! A baseline stores the least and the greatest value of a signal over its whole run, a tolerance and, unless it was
//! removed, the recording. With the recording the band is the signal at each step, wider by the tolerance on both
//! sides: exactly what `hil compare` lets a sample be. Without it there is no course, and the band is the range of the
//! whole run, wider by the tolerance.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use hil_console::terminal::exit::Failure;

use super::file::BaselineFile;

/// Band of a baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Name of the baseline.
    pub name: String,
    /// Scenario of the baseline's run.
    pub scenario: String,
    /// Rate of the baseline's run in Hz.
    pub rate_hz: f64,
    /// Digest of the baseline's run.
    pub digest: String,
    /// Recording with the course of each signal, or the reason why there is none.
    pub recording: Result<PathBuf, String>,
    /// Signals by name.
    pub signals: BTreeMap<String, SignalBand>,
}

/// Band of a signal.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalBand {
    /// Unit of the numbers.
    pub unit: String,
    /// Largest difference that counts as the same.
    pub tolerance: f64,
    /// Least value of the whole run; NaN if there is none.
    pub least: f64,
    /// Greatest value of the whole run; NaN if there is none.
    pub greatest: f64,
}

impl Band {
    /// Reads the band of a baseline from a file of baselines.
    ///
    /// # Errors
    /// If the file cannot be read, or has no such baseline.
    pub fn read(file: &Path, name: &str) -> Result<Self, Failure> {
        let file = BaselineFile::read(file, false)?;
        let baseline = file.find(name)?;
        let recording = match file.recording(baseline) {
            Some(recording) if recording.exists() => Ok(recording),
            Some(recording) => Err(format!("{} is missing", recording.display())),
            None => Err("the baseline has no recording".into()),
        };
        let signals = baseline.signals.iter().map(|(signal, figures)| {
            let [least, greatest, ..] = figures.values();
            let band = SignalBand {
                unit: figures.unit.clone(),
                tolerance: figures.tolerance,
                least,
                greatest,
            };
            (signal.clone(), band)
        });
        Ok(Self {
            name: name.into(),
            scenario: baseline.scenario.clone(),
            rate_hz: baseline.rate_hz,
            digest: baseline.digest.clone(),
            recording,
            signals: signals.collect(),
        })
    }
}
