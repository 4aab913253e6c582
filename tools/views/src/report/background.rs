//! Band of a baseline behind the curves of a report, as the [panel](crate::panel::backdrop) draws it.
//!
//! The baseline's recording is read over the grid of the runs, which is as long as the longest of all.

use std::collections::BTreeMap;

use hil_console::terminal::exit::Failure;
use hil_verification::baseline::band::Band;

use super::data::{BandData, written};
use super::envelope::{Written, runs_of};
use super::plots::Plot;
use super::reading::Signals;
use super::run::{Run, distinct};
use crate::arguments::baseline::BaselineChoice;
use crate::band;

/// Baseline behind the curves.
pub(super) struct Background {
    band: Band,
    /// Run along which the band lies; `None` without a recording.
    pub(super) run: Option<Run>,
}

impl Background {
    /// Opens the baseline that was chosen.
    ///
    /// # Errors
    /// If it cannot be read, or does not suit one of the runs.
    pub(super) fn open(choice: &BaselineChoice, runs: &[Run]) -> Result<Option<Self>, Failure> {
        let Some(band) = band::read(choice)? else {
            return Ok(None);
        };
        for run in runs {
            let whose = match runs.len() {
                1 => "the run",
                _ => &run.label,
            };
            band::refuse_unfit(&band, whose, run.rate.hz(), run.outcome.reader.columns())?;
        }
        let run = match &band.recording {
            Ok(recording) => {
                let run = Run::of(recording, None)?;
                let digest = run.outcome.recorded.digest.as_deref();
                band::refuse_other(&band, recording, digest)?;
                Some(run)
            }
            Err(_) => None,
        };
        Ok(Some(Self { band, run }))
    }

    /// Returns the band of the signals of some runs, along the baseline's own signals.
    pub(super) fn data(
        &self,
        signals: &[Signals],
        course: Option<&Signals>,
        plots: &[Plot],
    ) -> BandData {
        let of_signal = |name: &str| band::of_signal(&self.band, name);
        let names = signals.iter().flat_map(Signals::iter);
        let margins: BTreeMap<String, Vec<f64>> = names
            .filter_map(|(name, ..)| {
                let one = of_signal(name)?;
                Some((name.to_owned(), band::numbers(&self.band, one)))
            })
            .collect();
        let drawn = plots.iter().flat_map(|plot| &plot.chosen.signals);
        let missing = drawn
            .map(String::as_str)
            .filter(|name| of_signal(name).is_none());
        let missing = distinct(missing, |a, b| a == b);
        let courses = course.map(|course| written(course, |name| margins.contains_key(name)));
        let mut courses = courses.unwrap_or_default();
        for one in courses.values_mut() {
            // Means are only those of the runs.
            if let Written::Values { sums, .. } = &mut one.values {
                sums.clear();
            }
        }
        BandData {
            name: self.band.name.clone(),
            label: band::label(&self.band, &missing),
            end_s: self.run.as_ref().map(Run::end_s),
            margins,
            counts: course
                .map(|course| runs_of(course.records()))
                .unwrap_or_default(),
            signals: courses,
        }
    }
}
