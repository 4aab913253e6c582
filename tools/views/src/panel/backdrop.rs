//! Background of a panel's curves: another recorded run, or the band of a baseline.
//!
//! Opened before the page. The band of a baseline is drawn along its recording or, without one, as the range of its
//! whole run, and the page says which.

use std::collections::BTreeSet;

use hil_console::terminal::exit::Failure;
use hil_recording::reader::Column;
use hil_verification::baseline::band::Band;
use serde_json::{Value, json};
use tungstenite::Message;

use super::archive::Archive;
use super::message::ClientMessage;
use crate::arguments::panel::PanelArguments;
use crate::band;

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
        let (archive, band) = match (&arguments.over, band::read(&arguments.behind)?) {
            (Some(path), _) => {
                let archive = Archive::open(path, &[])?;
                archive.refuse_rate(hz)?;
                (Some(archive), None)
            }
            (None, Some(band)) => {
                band::refuse_unfit(&band, "the run", hz, columns)?;
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
        let signals = names.iter();
        let signals = signals.map(|name| Some(band::numbers(band, band::of_signal(band, name)?)));
        let signals: Vec<Option<Vec<f64>>> = signals.collect();
        let plots = about["plots"].as_array().into_iter().flatten();
        let drawn = plots.flat_map(|plot| plot["signals"].as_array().into_iter().flatten());
        let drawn: BTreeSet<u64> = drawn.filter_map(Value::as_u64).collect();
        let drawn = drawn.into_iter().map(|place| place as usize);
        let missing: Vec<&str> = drawn
            .filter(|place| signals[*place].is_none())
            .map(|place| names[place].as_str())
            .collect();
        about["band"] = json!({ "label": band::label(band, &missing), "signals": signals });
    }

    /// Answers a page about the run behind the other.
    pub(super) fn answer(&self, message: &ClientMessage, names: &[String]) -> Option<Message> {
        self.archive.as_ref()?.answer(message, names)
    }
}

/// Opens the recording of a baseline, if there is one.
fn course(band: &Band) -> Result<Option<Archive>, Failure> {
    let Ok(recording) = &band.recording else {
        return Ok(None);
    };
    let archive = Archive::open(recording, &[])?;
    band::refuse_other(band, recording, archive.digest())?;
    Ok(Some(archive))
}
