//! Band of a baseline behind the curves of panel and report: which one it is, whether it suits a run, and what a page
//! says about it.
//!
//! The band is drawn along the baseline's recording or, without one, as the range of its whole run.

use std::path::Path;

use hil_console::terminal::exit::Failure;
use hil_recording::reader::Column;
use hil_verification::baseline::band::{Band, SignalBand};
use shared_types::number::exact_in;

use crate::arguments::baseline::BaselineChoice;
use crate::plots::signal::recorded_name;

/// Reads the band of the chosen baseline; `None` if there is no choice.
///
/// # Errors
/// If the file of baselines cannot be read, or has no such baseline.
pub(crate) fn read(choice: &BaselineChoice) -> Result<Option<Band>, Failure> {
    let name = choice.baseline.as_ref();
    name.map(|name| Band::read(&choice.baselines, name))
        .transpose()
}

/// Returns the band of a signal, given the name that pages have for it.
pub(crate) fn of_signal<'a>(band: &'a Band, name: &str) -> Option<&'a SignalBand> {
    let by_name = band.signals.get(name);
    by_name.or_else(|| band.signals.get(&recorded_name(name)))
}

/// Returns the numbers of a signal's band for a page: its tolerance and, unless there is a recording to follow, the
/// ends of the range of the whole run.
pub(crate) fn numbers(band: &Band, one: &SignalBand) -> Vec<f64> {
    match band.recording {
        Ok(_) => vec![one.tolerance],
        Err(_) => vec![one.tolerance, one.least, one.greatest],
    }
}

/// Describes a band that lacks some of the signals that are drawn.
pub(crate) fn label(band: &Band, missing: &[&str]) -> String {
    let name = &band.name;
    let basis = match &band.recording {
        Ok(_) => "its recording and the tolerance of each signal".into(),
        Err(reason) => format!(
            "the range of each signal over the whole run, wider by its tolerance, because {reason}"
        ),
    };
    let missing = match missing {
        [] => String::new(),
        [one] => format!("; {one} is not in the baseline"),
        [one, more @ ..] => format!("; {one} and {} more are not in the baseline", more.len()),
    };
    format!("band of baseline {name}: {basis}{missing}")
}

/// Refuses a baseline of another rate, without a signal of the run, or with a signal in another unit. `whose` names the
/// run.
pub(crate) fn refuse_unfit(
    band: &Band,
    whose: &str,
    hz: f64,
    columns: &[Column],
) -> Result<(), Failure> {
    let Band {
        name,
        scenario,
        rate_hz,
        ..
    } = band;
    if *rate_hz != hz {
        let (of_baseline, of_run) = (exact_in(*rate_hz, "Hz"), exact_in(hz, "Hz"));
        return Err(Failure::usage(format!(
            "baseline `{name}` was recorded at {of_baseline}, but {whose} has {of_run}, so their steps differ in time"
        )));
    }
    let common = columns
        .iter()
        .filter_map(|column| Some((column, of_signal(band, &column.name)?)));
    let mut is_any = false;
    for (column, one) in common {
        is_any = true;
        if one.unit != column.unit {
            return Err(Failure::usage(format!(
                "baseline `{name}` has {} in `{}`, but {whose} in `{}`",
                column.name, one.unit, column.unit
            )));
        }
    }
    if is_any {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "baseline `{name}`, of scenario `{scenario}`, has no signal of {whose}"
    )))
}

/// Refuses a recording with another digest than that of the baseline.
pub(crate) fn refuse_other(
    band: &Band,
    recording: &Path,
    digest: Option<&str>,
) -> Result<(), Failure> {
    let digest = digest.unwrap_or("missing");
    if digest == band.digest {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{} is not the recording of baseline `{}`, because its digest is {digest}; restore the recording, or remove it to show the range of the whole run only",
        recording.display(),
        band.name
    )))
}
