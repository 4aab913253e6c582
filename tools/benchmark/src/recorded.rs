//! The figures of a recorded run.

use std::path::Path;

use hil_config::plan::Clock;
use hil_console::terminal::exit::Failure;
use hil_facts::results::latency::legs::Latency;
use hil_facts::results::latency::places::TimingPlaces;
use hil_facts::results::recorded_run::RecordedRun;
use hil_facts::results::resumed::first_step;
use hil_recording::reader::RunReader;

use super::measurement::{Case, Looped, Sides};

/// Reads the figures of a recorded run, without its first `warm_up` steps.
///
/// # Errors
/// If the run cannot be read, or has no timing.
pub fn case(run: &Path, warm_up: u64) -> Result<Case, Failure> {
    let mut reader = RunReader::open(run).map_err(Failure::usage)?;
    reader.refuse_excerpt().map_err(Failure::usage)?;
    let places = TimingPlaces::of(&reader);
    if reader.place("round_trip_ns").is_none() {
        return Err(Failure::usage(format!(
            "{} contains no step timing",
            run.display()
        )));
    }
    let is_sample = |name: &str| name.starts_with("measured.") || name.starts_with("reference.");
    let signals = (reader.columns().iter())
        .filter(|column| is_sample(&column.name))
        .count();
    let rate = reader.rate().map_err(Failure::usage)?;
    let recorded = RecordedRun::of(&reader, run).ok();
    let is_due = recorded.is_some_and(|run| run.plan.run.clock != Clock::Lockstep);
    let mut looped = Looped {
        sides: sides(&reader),
        latency: Latency::new(is_due),
        ..Looped::default()
    };
    let first = warm_up.max(first_step(&reader));
    while reader.advance().map_err(Failure::usage)? {
        if reader.step() >= first {
            looped.take(reader.step(), &places.timing(reader.words()), 0);
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

/// Reads the real-time settings that both sides reported.
fn sides(reader: &RunReader) -> Option<Sides> {
    let report = |name| serde_json::from_str(reader.fact(name)?).ok();
    Some(Sides {
        plant: report("realtime_plant")?,
        controller: report("realtime_controller")?,
    })
}
