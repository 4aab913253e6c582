//! The figures of a recorded run.

use std::path::Path;

use shared_types::record::Timing;
use shared_types::zerocopy::{FromBytes, IntoBytes};

use super::measurement::{Case, Looped, Sides};
use crate::exit::Failure;
use crate::run_reader::RunReader;

/// Reads a run; its first steps are left out.
///
/// # Errors
/// If it cannot be read, or says nothing of time.
pub fn case(run: &Path, warm_up: u64) -> Result<Case, Failure> {
    let mut reader = RunReader::open(run).map_err(Failure::usage)?;
    reader.refuse_excerpt().map_err(Failure::usage)?;
    let places = TimingPlaces::of(&reader);
    if !(reader.columns().iter()).any(|column| column.name == "round_trip_ns") {
        return Err(Failure::usage(format!(
            "{} does not say how long its steps took",
            run.display()
        )));
    }
    let is_sample = |name: &str| name.starts_with("measured.") || name.starts_with("reference.");
    let signals = (reader.columns().iter())
        .filter(|column| is_sample(&column.name))
        .count();
    let rate = reader.rate().map_err(Failure::usage)?;
    let mut looped = Looped {
        sides: sides(&reader),
        ..Looped::default()
    };
    while reader.advance().map_err(Failure::usage)? {
        let timing = places.timing(reader.words());
        if reader.step() >= warm_up && timing.round_trip_ns > 0 {
            looped.take(reader.step(), &timing, 0);
        }
    }
    if let Some(torn) = reader.caveat() {
        tell!("note: {torn}");
    }
    Ok(Case {
        signals,
        rate: looped.latency.is_paced().then_some(rate),
        warm_up,
        looped,
        limits: None,
    })
}

/// Where the words of a recording's records say how long steps took.
pub(crate) struct TimingPlaces([Option<usize>; Timing::WORDS]);

impl TimingPlaces {
    /// By name: an older recording has fewer words, which are then 0.
    pub(crate) fn of(reader: &RunReader) -> Self {
        let place = |name: &str| (reader.columns().iter()).position(|column| column.name == name);
        Self(Timing::NAMES.map(place))
    }

    /// Whether records say whose command they have, and how old it is.
    pub(crate) fn tell_answers(&self) -> bool {
        let is_there = |name| {
            let place = Timing::NAMES.iter().position(|known| *known == name);
            place.is_some_and(|place| self.0[place].is_some())
        };
        is_there("epoch") && is_there("held_steps")
    }

    /// What a record says.
    pub(crate) fn timing(&self, record: &[u64]) -> Timing {
        let word = |place: Option<usize>| place.map_or(0, |place| record[place]);
        let words = self.0.map(word);
        Timing::read_from_bytes(words.as_bytes()).expect("as many words as names")
    }
}

/// What both sides ran with, as they reported it.
fn sides(reader: &RunReader) -> Option<Sides> {
    let report = |name| serde_json::from_str(reader.fact(name)?).ok();
    Some(Sides {
        plant: report("realtime_plant")?,
        controller: report("realtime_controller")?,
    })
}
