//! What can be had of a recording in any state: its records as far as they go, and what came of the run
//! up to there.
//!
//! Used by `hil recover`, `hil report` and `hil judge`. Reads the file once and says what the recorder
//! would have said had the run ended there.

use std::collections::BTreeMap;
use std::path::Path;

use hil_config::plan::Plan;
use shared_types::record::{Event, Outcome};
use shared_types::time::Step;

use crate::recording::reader::{ReadError, RunReader};
use crate::results::ended::Ended;
use crate::results::ending::{self, Answers};
use crate::results::evaluation::{self, RecordedEvaluation};
use crate::results::faults::{FaultLog, LiveFault};
use crate::results::latency::legs::Latency;
use crate::results::latency::places::TimingPlaces;
use crate::results::recorded::Recorded;
use crate::results::summary::Summary;
use crate::terminal::exit::Failure;

/// A recording, read as far as it goes.
pub(crate) struct Account {
    pub(crate) reader: RunReader,
    /// Records and events.
    pub(crate) messages: u64,
    /// What keeps it from being read to its end, other than that this is missing.
    pub(crate) damage: Option<ReadError>,
    pub(crate) recorded: Recorded,
    /// How long its steps took.
    pub(crate) latency: Latency,
    /// What judges the run; why not, if its scenario cannot be understood.
    pub(crate) plan: Result<Plan, Failure>,
}

/// The scenario of a run, and what judges its records; an excerpt has too few of them.
fn judge(
    reader: &RunReader,
    run: &Path,
    by: Option<&Path>,
) -> Result<(Plan, Option<RecordedEvaluation>), Failure> {
    let plant = reader.enclosed("plant-description.json");
    let plant = plant.map_err(Failure::usage)?;
    let plan = evaluation::plan(reader, &plant, run, by)?;
    if reader.is_excerpt() {
        return Ok((plan, None));
    }
    let (columns, values) = evaluation::columns(reader, &plant)?;
    let origin = by.unwrap_or(run).display();
    let judge = RecordedEvaluation::new(reader, &plan, &columns, values)
        .map_err(|error| Failure::usage(format!("{origin} does not fit the run: {error}")))?;
    Ok((plan, Some(judge)))
}

impl Account {
    /// Reads a recording; it is judged by its own scenario or by another.
    ///
    /// # Errors
    /// If it is none.
    pub(crate) fn of(run: &Path, by: Option<&Path>) -> Result<Self, ReadError> {
        let mut reader = RunReader::open(run)?.patient();
        let (plan, mut judge) = match judge(&reader, run, by) {
            Ok((plan, judge)) => (Ok(plan), judge),
            Err(failure) => (Err(failure), None),
        };
        let places = TimingPlaces::of(&reader);
        let (mut latency, mut faults) = (Latency::default(), FaultLog::default());
        let (mut messages, mut end, mut published_ns) = (0, None, None);
        let mut changes = Vec::new();
        let mut answers = Answers::default();
        let damage = loop {
            let advanced = reader.advance();
            for event in reader.events() {
                messages += 1;
                match event {
                    Event::Accepted(accepted) => {
                        faults.accepted.extend(LiveFault::try_from(accepted).ok());
                    }
                    Event::Fault(taken) => {
                        if let Some(judge) = &mut judge {
                            (judge.evaluation).fault(taken.id, Step(taken.step));
                        }
                        faults.taken.push(taken.clone());
                    }
                    Event::FaultEnded(ended) => faults.ended.push(ended.clone()),
                    Event::Controller(change) => changes.push(change.clone()),
                    Event::End(ended) => {
                        faults.sizes = Some(ended.effects.clone());
                        end = Some(ended.clone());
                    }
                }
            }
            match advanced {
                Ok(true) => {}
                Ok(false) => break None,
                Err(error) => break Some(error),
            }
            messages += 1;
            let timing = places.timing(reader.words());
            if plan
                .as_ref()
                .is_ok_and(|plan| reader.step() < plan.run.steps)
            {
                answers.take(&timing);
            }
            latency.take(reader.step(), &timing);
            let (first_ns, _) = published_ns.unwrap_or((timing.published_ns, 0));
            published_ns = Some((first_ns, timing.published_ns));
            if let Some(judge) = &mut judge {
                judge.observe(reader.words());
            }
        };
        let number = |name| reader.result(name).and_then(|text| text.parse().ok());
        let written = reader.records();
        let missing = || match reader.is_excerpt() {
            false if written > 0 => (reader.step() + 1).saturating_sub(written),
            _ => 0,
        };
        let lost: u64 = number("lost").unwrap_or_else(missing);
        let digest = Some(reader.digest());
        let (first_ns, last_ns) = published_ns.unwrap_or_default();
        let recorded = Recorded {
            end,
            faults,
            changes,
            records: number("records").unwrap_or(if reader.is_excerpt() && written > 0 {
                reader.step() + 1
            } else {
                written
            }),
            written,
            cut_short: None,
            past_records: 0,
            lost,
            // Older recordings do not say whose commands they have.
            answers: (places.tell_answers() && !reader.is_excerpt()).then_some(answers),
            digest: digest.filter(|digest| lost == 0 && written > 0 && !digest.is_empty()),
            partial_digests: BTreeMap::new(),
            metrics: (judge.as_ref()).map_or_else(Vec::new, |judge| judge.evaluation.results()),
            requirements: (judge.as_ref())
                .map_or_else(Vec::new, |judge| judge.evaluation.requirements()),
            latency: latency.summary(),
            wall_time_s: last_ns.saturating_sub(first_ns) as f64 / 1e9,
            error: None,
        };
        Ok(Self {
            reader,
            messages,
            damage,
            recorded,
            latency,
            plan,
        })
    }

    /// Whether the recorder told how the run ended.
    pub(crate) fn has_result(&self) -> bool {
        self.damage.is_none() && self.reader.result("outcome").is_some()
    }

    /// The result of a run whose recording ends here, for this reason.
    pub(crate) fn result(&self, reason: &str) -> BTreeMap<String, String> {
        let recorded = &self.recorded;
        let facts = [
            ("records", recorded.written.to_string()),
            ("lost", recorded.lost.to_string()),
            ("digest", recorded.digest.clone().unwrap_or_default()),
            ("outcome", "failed".to_owned()),
            ("reason", reason.to_owned()),
        ];
        let owned = facts.map(|(name, value)| (name.to_owned(), value));
        owned.into_iter().collect()
    }

    /// How the run ended, and why if not by itself; `broke_off` is why where the recording does not tell.
    /// What the plant told of its end counts as far as the recorder found nothing wrong with it, and
    /// nothing else is wrong with it.
    pub(crate) fn outcome(&self, broke_off: Option<&str>) -> (Outcome, Option<String>) {
        let result = |name| self.reader.result(name).map(str::to_owned);
        let is_failed = result("outcome").is_some_and(|outcome| outcome == "failed");
        let contradiction = || {
            let plan = self.plan.as_ref().ok()?;
            ending::contradiction(plan, &self.recorded)
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

    /// The summary of the run; `broke_off` is why it ended where the recording does not tell.
    ///
    /// # Errors
    /// If its scenario cannot be understood.
    pub(crate) fn summary(self, broke_off: Option<&str>) -> Result<Summary, Failure> {
        let (outcome, reason) = self.outcome(broke_off);
        let plan = self.plan?;
        let ended = Ended {
            recorded: self.recorded,
            outcome,
            reason,
            controllers: Vec::new(),
        };
        Ok(Summary::of_recording(&plan, &self.reader, &ended))
    }
}

#[cfg(test)]
mod tests;
