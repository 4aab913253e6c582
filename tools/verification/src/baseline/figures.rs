//! The figures of a recorded run, which a reviewer reads instead of the samples.
//!
//! Stored in baselines. One pass over the recording computes the digest, the identity of the run, several statistics of
//! each signal that the digest covers, and the scenario's metrics.

use std::path::Path;

use hil_console::terminal::exit::Failure;
use hil_facts::results::recorded_run::RecordedRun;
use hil_recording::reader::{Column, RunReader};
use shared_types::record::Outcome;
use toml_edit::{DocumentMut, Item};

/// Facts and figures of a run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Figures {
    pub(super) scenario: String,
    pub(super) digest: String,
    pub(super) records: u64,
    pub(super) rate_hz: f64,
    /// Hash of the scenario in effect.
    pub(super) scenario_blake3: String,
    pub(super) hil_version: String,
    pub(super) plant_blake3: String,
    pub(super) controller_blake3: String,
    pub(super) metrics: Vec<Metric>,
    pub(super) signals: Vec<Signal>,
}

/// Metric over a window.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Metric {
    /// Name and window.
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) value: f64,
}

/// Statistics of a signal, over the steps at which it is finite.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Signal {
    pub(super) name: String,
    pub(super) unit: String,
    /// Values in the order of [`STATISTICS`].
    pub(super) values: [f64; STATISTICS.len()],
}

/// Statistics of a signal. If two signals never differ by more than a tolerance, neither do these statistics.
pub(super) const STATISTICS: [&str; 4] = ["min", "max", "rms", "final"];

/// Accumulator of statistics.
#[derive(Clone, Copy, Debug)]
struct Running {
    min: f64,
    max: f64,
    squares: f64,
    count: u64,
    last: f64,
}

impl Running {
    const NONE: Self = Self {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        squares: 0.0,
        count: 0,
        last: f64::NAN,
    };

    fn take(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        if value < self.min {
            self.min = value;
        }
        if value > self.max {
            self.max = value;
        }
        self.squares += value * value;
        self.count += 1;
        self.last = value;
    }

    fn values(&self) -> [f64; STATISTICS.len()] {
        if self.count == 0 {
            return [f64::NAN; STATISTICS.len()];
        }
        let rms = (self.squares / self.count as f64).sqrt();
        [self.min, self.max, rms, self.last]
    }
}

impl Figures {
    /// Computes the figures of a run.
    ///
    /// # Errors
    /// If the recording cannot be read, is truncated or has lost records, or the run did not end by itself.
    pub(super) fn of(run: &Path) -> Result<Self, Failure> {
        let mut reader = RunReader::open(run).map_err(Failure::usage)?;
        reader.refuse_excerpt().map_err(Failure::usage)?;
        let recorded = RecordedRun::of(&reader, run)?;
        let evaluation = recorded.evaluation(&reader, &recorded.plan);
        let mut evaluation = evaluation
            .map_err(|error| Failure::usage(format!("{}: its scenario: {error}", run.display())))?;
        let hashed = reader.hashed_words();
        let signals: Vec<usize> = (reader.columns().iter().enumerate())
            .filter(|(_, column)| column.is_signal())
            .map(|(place, _)| place)
            .collect();
        let count = signals.iter().filter(|place| **place < hashed).count();
        let mut running = vec![Running::NONE; count];
        let mut next = 0;
        while reader.advance().map_err(Failure::usage)? {
            for event in reader.events() {
                evaluation.event(event);
            }
            let (step, words) = (reader.step(), reader.words());
            if step != next {
                return Err(Failure::usage(format!(
                    "{}: found record {step} in place of record {next}; a run with lost records cannot be a baseline",
                    run.display()
                )));
            }
            next += 1;
            evaluation.record(words);
            for (running, place) in running.iter_mut().zip(&signals) {
                running.take(f64::from_bits(words[*place]));
            }
        }
        if let Some(torn) = reader.caveat() {
            return Err(Failure::usage(format!(
                "{torn}, so it cannot be a baseline; compare the existing part with `hil compare A B`"
            )));
        }
        let outcome = reader.result("outcome").and_then(Outcome::named);
        if !outcome.is_some_and(Outcome::is_own_end) {
            return Err(Failure::usage(format!(
                "{} did not end by itself, so it cannot be compared with a baseline",
                run.display()
            )));
        }
        let fact = |name| reader.fact(name).unwrap_or_default().to_owned();
        let scenario = reader.attachment("scenario.toml").map_err(Failure::usage)?;
        Ok(Self {
            scenario: fact("scenario"),
            digest: reader.digest(),
            records: reader.records(),
            rate_hz: reader.rate().map_err(Failure::usage)?.hz(),
            scenario_blake3: scenario_hash(scenario),
            hil_version: fact("hil_version"),
            plant_blake3: fact("plant_blake3"),
            controller_blake3: fact("controller_blake3"),
            metrics: (evaluation.so_far().results().into_iter())
                .map(|metric| Metric {
                    name: {
                        let [start_s, end_s] = metric.window_s;
                        format!("{} {start_s} s to {end_s} s", metric.name)
                    },
                    unit: metric.unit,
                    value: metric.value,
                })
                .collect(),
            signals: (signals.iter().zip(&running))
                .map(|(place, running)| {
                    let Column { name, unit } = &reader.columns()[*place];
                    Signal {
                        name: name.clone(),
                        unit: unit.clone(),
                        values: running.values(),
                    }
                })
                .collect(),
        })
    }
}

/// Hashes a scenario without the paths of its programs.
fn scenario_hash(text: &str) -> String {
    let without_programs = text.parse().ok().and_then(|mut scenario: DocumentMut| {
        let sides = ["plant", "controller"].map(|side| {
            let table = scenario.get_mut(side).and_then(Item::as_table_like_mut);
            table.and_then(|table| table.remove("program"))
        });
        (sides.iter().any(Option::is_some)).then(|| scenario.to_string())
    });
    let text = without_programs.as_deref().unwrap_or(text);
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_of_a_scenario_does_not_depend_on_program_paths() {
        let text = "schema = 1 # a comment\n\n[plant] # one\nmodel = \"a\"\nsubsteps = 1\n\n[controller]\nlaw = \"b\"\n";
        let named = text
            .replace("model = \"a\"\n", "model = \"a\"\nprogram = \"/x/plant\"\n")
            .replace(
                "law = \"b\"\n",
                "law = \"b\"\nprogram.x86_64 = \"/x/law\"\n",
            );
        let plain = blake3::hash(text.as_bytes()).to_hex().to_string();
        assert_eq!(scenario_hash(text), plain);
        assert_eq!(scenario_hash(&named), plain);
        assert_ne!(
            scenario_hash(&text.replace("= 1\n\n[con", "= 2\n\n[con")),
            plain
        );
    }

    #[test]
    fn statistics_cover_the_finite_numbers_only() {
        let mut running = Running::NONE;
        for value in [1.0, f64::NAN, -7.0, f64::INFINITY, 5.0, 5.0] {
            running.take(value);
        }
        // rms: sqrt((1 + 49 + 25 + 25) / 4)
        assert_eq!(running.values(), [-7.0, 5.0, 5.0, 5.0]);
        assert!(Running::NONE.values().iter().all(|value| value.is_nan()));
    }
}
