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
    // By name: an older recording has fewer words, which are then 0.
    let place = |name: &str| (reader.columns().iter()).position(|column| column.name == name);
    let places = Timing::NAMES.map(place);
    let has = |name| {
        Timing::NAMES
            .iter()
            .position(|n| *n == name)
            .and_then(|i| places[i])
    };
    if has("round_trip_ns").is_none() {
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
        let word = |place: Option<usize>| place.map_or(0, |place| reader.words()[place]);
        let words = places.map(word);
        let timing = Timing::read_from_bytes(words.as_bytes()).expect("as many words as names");
        if reader.step() >= warm_up && timing.round_trip_ns > 0 {
            looped.take(reader.step(), &timing, 0);
        }
    }
    Ok(Case {
        signals,
        rate: looped.latency.is_paced().then_some(rate),
        warm_up,
        looped,
        limits: None,
    })
}

/// What both sides ran with, as they reported it.
fn sides(reader: &RunReader) -> Option<Sides> {
    let report = |name| serde_json::from_str(reader.fact(name)?).ok();
    Some(Sides {
        plant: report("realtime_plant")?,
        controller: report("realtime_controller")?,
    })
}
