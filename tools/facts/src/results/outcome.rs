//! Outcome of a recorded run, whatever the state of its recording: its readable records, and the facts of the run up to
//! the last of them.
//!
//! Used by `hil recover`, `hil report` and `hil judge`. Reads the file once and returns what the recorder would have
//! returned if the run had ended there.

use std::collections::BTreeMap;
use std::path::Path;

use hil_config::plan::Clock;
use hil_console::terminal::exit::Failure;
use hil_recording::reader::{ReadError, RunReader};
use shared_types::record::Outcome;

use crate::results::collector::Collector;
use crate::results::ended::EndedRun;
use crate::results::ending;
use crate::results::evaluation::RecordEvaluation;
use crate::results::latency::legs::Latency;
use crate::results::latency::places::TimingPlaces;
use crate::results::recorded::Recorded;
use crate::results::recorded_run::RecordedRun;
use crate::results::resumed::first_step;
use crate::results::summary::Summary;

/// Recording, read as far as possible.
pub struct RecordedOutcome {
    /// Reader of the recording.
    pub reader: RunReader,
    /// Number of records and events.
    pub messages: u64,
    /// Error that prevents reading the recording to its end, other than a missing end.
    pub damage: Option<ReadError>,
    /// Events and counts of the run.
    pub recorded: Recorded,
    /// Latency of the steps.
    pub latency: Latency,
    /// Run with the plan that judges it, or the error if its scenario is invalid.
    pub run: Result<RecordedRun, Failure>,
}

/// Returns the run of a recording, and starts the evaluation of its records; an excerpt has too few of them.
fn judge(
    reader: &RunReader,
    run: &Path,
    by: Option<&Path>,
) -> Result<(RecordedRun, Option<RecordEvaluation>), Failure> {
    let recorded = RecordedRun::of(reader, run)?;
    let recorded = match by {
        Some(by) => recorded.judged_by(by)?,
        None => recorded,
    };
    if reader.is_excerpt() {
        return Ok((recorded, None));
    }
    let origin = by.unwrap_or(run).display();
    let evaluation = recorded.evaluation(reader, &recorded.plan);
    let evaluation = evaluation
        .map_err(|error| Failure::usage(format!("{origin} does not fit the run: {error}")))?;
    Ok((recorded, Some(evaluation)))
}

impl RecordedOutcome {
    /// Reads a recording and judges it by its own scenario or by another one.
    ///
    /// # Errors
    /// If the file is not a recording.
    pub fn of(run: &Path, by: Option<&Path>) -> Result<Self, ReadError> {
        let mut reader = RunReader::open(run)?.patient();
        let (run, evaluation) = match judge(&reader, run, by) {
            Ok((run, evaluation)) => (Ok(run), evaluation),
            Err(failure) => (Err(failure), None),
        };
        let planned = run.as_ref().ok().map(|run| run.plan.run);
        let is_due = planned.is_some_and(|run| run.clock != Clock::Lockstep);
        let steps = planned.map_or(0, |run| run.steps);
        let mut collector = Collector::new(steps, evaluation, Some(Latency::new(is_due)));
        if let Ok(run) = &run {
            collector.held_commands = run.held_commands(&reader);
        }
        let first = first_step(&reader);
        let places = TimingPlaces::of(&reader);
        let mut messages = 0;
        let damage = loop {
            let advanced = reader.advance();
            for event in reader.events() {
                messages += 1;
                // A malformed fault event is left out.
                let _ = collector.event(event);
            }
            match advanced {
                Ok(true) => {}
                Ok(false) => break None,
                Err(error) => break Some(error),
            }
            messages += 1;
            // Records copied from the continued run took no time of this one.
            collector.is_past = reader.step() < first;
            collector.record(reader.words(), &places.timing(reader.words()));
        };
        collector.conclude();
        let number = |name| reader.result(name).and_then(|text| text.parse().ok());
        let (written, is_excerpt) = (reader.records(), reader.is_excerpt());
        let missing = || match is_excerpt {
            false if written > 0 => (reader.step() + 1).saturating_sub(written),
            _ => 0,
        };
        let lost: u64 = number("lost").unwrap_or_else(missing);
        let digest = Some(reader.digest());
        let recorded = Recorded {
            records: number("records").unwrap_or(if is_excerpt && written > 0 {
                reader.step() + 1
            } else {
                written
            }),
            written,
            lost,
            // Older recordings do not state whose commands they have.
            answers: (collector.recorded.answers).filter(|_| places.tell_answers() && !is_excerpt),
            digest: digest.filter(|digest| lost == 0 && written > 0 && !digest.is_empty()),
            ..collector.recorded
        };
        Ok(Self {
            reader,
            messages,
            damage,
            recorded,
            latency: collector.latency.unwrap_or_default(),
            run,
        })
    }

    /// Returns `true` if the recorder stored the end of the run.
    pub fn has_result(&self) -> bool {
        self.damage.is_none() && self.reader.result("outcome").is_some()
    }

    /// Returns the result of a run whose recording ends here, for this reason.
    pub fn result(&self, reason: &str) -> BTreeMap<String, String> {
        let recorded = &self.recorded;
        let facts = [
            ("records", recorded.written.to_string()),
            ("lost", recorded.lost.to_string()),
            ("digest", recorded.digest.clone().unwrap_or_default()),
            ("outcome", Outcome::Failed.name().to_owned()),
            ("reason", reason.to_owned()),
        ];
        let owned = facts.map(|(name, value)| (name.to_owned(), value));
        owned.into_iter().collect()
    }

    /// Returns the outcome of the run, and the reason if it did not end by itself; `broke_off` is the reason if the
    /// recording contains none. The plant's report of its end counts if neither the recorder nor the reader found a
    /// contradiction in it.
    pub fn outcome(&self, broke_off: Option<&str>) -> (Outcome, Option<String>) {
        let result = |name| self.reader.result(name).map(str::to_owned);
        let is_failed =
            result("outcome").and_then(|name| Outcome::named(&name)) == Some(Outcome::Failed);
        let contradiction = || {
            let run = self.run.as_ref().ok()?;
            ending::contradiction(&run.plan, &self.recorded)
        };
        match (broke_off, &self.recorded.end) {
            (None, Some(end)) if !is_failed || end.outcome == Outcome::Failed => {
                match contradiction() {
                    Some(what) => (Outcome::Failed, Some(what)),
                    None => (end.outcome, end.reason.clone()),
                }
            }
            (None, _) => (Outcome::Failed, result("reason")),
            (Some(reason), _) => (Outcome::Failed, Some(reason.to_owned())),
        }
    }

    /// Returns the summary of the run; `broke_off` is the reason why it ended if the recording contains none.
    pub fn summary(self, broke_off: Option<&str>) -> Result<Summary, Failure> {
        let (outcome, reason) = self.outcome(broke_off);
        let run = self.run?;
        let ended = EndedRun::new(self.recorded, outcome, reason);
        Ok(Summary::of_recording(&run, &self.reader, &ended))
    }
}

#[cfg(test)]
mod tests;
