//! Background of a panel's curves: another recorded run, or the band of a baseline.
//!
//! Opened before the page. The band of a baseline is drawn along its recording or, without one, as the range of its
//! whole run, and the page says which.

use std::collections::BTreeSet;

use hil_console::terminal::exit::Failure;
use hil_recording::reader::Column;
use hil_verification::baseline::band::{Band, SignalBand};
use serde_json::{Value, json};
use shared_types::number::exact_in;
use tungstenite::Message;

use super::archive::Archive;
use super::message::ClientMessage;
use crate::arguments::panel::PanelArguments;
use crate::plots::signal::recorded_name;

/// Background of the curves.
pub(crate) struct Backdrop {
    /// Run whose curves are drawn, or between which and the tolerances a band lies.
    archive: Option<Archive>,
    band: Option<Band>,
}

impl Backdrop {
    /// Opens what the arguments ask for, behind a run of this rate with these signals.
    ///
    /// # Errors
    /// If run or baseline cannot be read, or does not fit rate, signals or units.
    pub(super) fn open(
        arguments: &PanelArguments,
        hz: f64,
        columns: &[Column],
    ) -> Result<Option<Self>, Failure> {
        let (archive, band) = match (&arguments.over, &arguments.baseline) {
            (Some(path), _) => {
                let archive = Archive::open(path, &[])?;
                archive.refuse_rate(hz)?;
                (Some(archive), None)
            }
            (None, Some(name)) => {
                let band = Band::read(&arguments.baselines, name)?;
                refuse_unfit(&band, hz, columns)?;
                (course(&band)?, Some(band))
            }
            (None, None) => return Ok(None),
        };
        Ok(Some(Self { archive, band }))
    }

    /// Adds the background to the description of a run whose signals have these names.
    pub(super) fn describe(&self, names: &[String], about: &mut Value) {
        about["over"] = self.archive.as_ref().map(Archive::label).into();
        let Some(band) = &self.band else { return };
        let signals = names.iter().map(|name| {
            let one = of_signal(band, name)?;
            Some(match &self.archive {
                Some(_) => json!([one.tolerance]),
                None => json!([one.tolerance, one.least, one.greatest]),
            })
        });
        let signals: Vec<Option<Value>> = signals.collect();
        let plots = about["plots"].as_array().into_iter().flatten();
        let drawn = plots.flat_map(|plot| plot["signals"].as_array().into_iter().flatten());
        let drawn: BTreeSet<u64> = drawn.filter_map(Value::as_u64).collect();
        let drawn = drawn.into_iter().map(|place| place as usize);
        let missing: Vec<&str> = drawn
            .filter(|place| signals[*place].is_none())
            .map(|place| names[place].as_str())
            .collect();
        about["band"] = json!({ "label": label(band, &missing), "signals": signals });
    }

    /// Answers a page about the run behind the other.
    pub(super) fn answer(&self, message: &ClientMessage, names: &[String]) -> Option<Message> {
        self.archive.as_ref()?.answer(message, names)
    }
}

/// Describes a band that lacks some of the signals that are drawn.
fn label(band: &Band, missing: &[&str]) -> String {
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

fn of_signal<'a>(band: &'a Band, name: &str) -> Option<&'a SignalBand> {
    let by_name = band.signals.get(name);
    by_name.or_else(|| band.signals.get(&recorded_name(name)))
}

/// Refuses a baseline of another rate, without a signal of the run, or with a signal in another unit.
fn refuse_unfit(band: &Band, hz: f64, columns: &[Column]) -> Result<(), Failure> {
    let Band {
        name,
        scenario,
        rate_hz,
        ..
    } = band;
    if *rate_hz != hz {
        let (of_baseline, of_run) = (exact_in(*rate_hz, "Hz"), exact_in(hz, "Hz"));
        return Err(Failure::usage(format!(
            "baseline `{name}` was recorded at {of_baseline}, but the run has {of_run}, so their steps differ in time"
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
                "baseline `{name}` has {} in `{}`, but the run in `{}`",
                column.name, one.unit, column.unit
            )));
        }
    }
    if is_any {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "baseline `{name}`, of scenario `{scenario}`, has no signal of the run"
    )))
}

/// Opens the recording of a baseline, if there is one.
fn course(band: &Band) -> Result<Option<Archive>, Failure> {
    let Ok(recording) = &band.recording else {
        return Ok(None);
    };
    let archive = Archive::open(recording, &[])?;
    let digest = archive.digest().unwrap_or("missing");
    if digest == band.digest {
        return Ok(Some(archive));
    }
    Err(Failure::usage(format!(
        "{} is not the recording of baseline `{}`, because its digest is {digest}; restore the recording, or remove it to show the range of the whole run only",
        recording.display(),
        band.name
    )))
}
