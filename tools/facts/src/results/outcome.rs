//! Outcome of a recorded run, whatever the state of its recording: its readable records, and the facts of the run up to
//! the last of them.
//!
//! Used by `hil recover`, `hil report` and `hil judge`. Reads the file once, in two threads, and returns what the
//! recorder would have returned if the run had ended there.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{channel, sync_channel};

use hil_config::plan::Clock;
use hil_console::terminal::exit::Failure;
use hil_recording::reader::{ReadError, RunReader};
use shared_types::digest::Digest;
use shared_types::record::{Event, Outcome};

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

/// Words of a batch of records: enough to be worth the way to another thread, and few enough for its cache.
const BATCH_WORDS: usize = 1 << 15;
/// Maximum number of batches on their way.
const BATCHES: usize = 4;

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

/// Records and events in the order of the file, on their way from the reader to the collector.
#[derive(Default)]
struct Batch {
    /// Words of the records, one after the other.
    words: Vec<u64>,
    /// Events, each with the number of records in the batch before it.
    events: Vec<(usize, Event)>,
}

/// Reads a recording to its end in this thread, and collects its facts and its digest in another one; returns the
/// number of records and events, and the damage.
fn collect(
    reader: &mut RunReader,
    mut collector: Collector,
    places: &TimingPlaces,
) -> (u64, Option<ReadError>, Digest, Collector) {
    let (width, hashed, first) = (
        reader.columns().len(),
        reader.hashed_words(),
        first_step(reader),
    );
    let (send, batches) = sync_channel::<Batch>(BATCHES);
    let (give_back, empty) = channel::<Batch>();
    let mut digest = Digest::default();
    let take = move || {
        for mut batch in batches {
            let mut events = batch.events.drain(..).peekable();
            let mut hear = |collector: &mut Collector, digest: &mut Digest, number: usize| {
                while let Some((_, event)) = events.next_if(|(before, _)| *before <= number) {
                    digest.event(&event);
                    // A malformed fault event is left out.
                    let _ = collector.event(&event);
                }
            };
            for (number, words) in batch.words.chunks_exact(width).enumerate() {
                hear(&mut collector, &mut digest, number);
                digest.record(&words[..hashed]);
                // Records copied from the continued run took no time of this one.
                collector.is_past = words[0] < first;
                collector.record(words, &places.timing(words));
            }
            hear(&mut collector, &mut digest, usize::MAX);
            drop(events);
            batch.words.clear();
            let _ = give_back.send(batch); // the reader may be at its end
        }
        (digest, collector)
    };
    std::thread::scope(|scope| {
        let taking = scope.spawn(take);
        let (mut messages, mut batch) = (0, Batch::default());
        let damage = loop {
            let number = batch.words.len() / width;
            let advanced = reader.advance_into(&mut batch.words);
            messages += reader.events().len() as u64;
            let events = reader.events().iter().cloned();
            batch.events.extend(events.map(|event| (number, event)));
            match advanced {
                Ok(true) => {}
                Ok(false) => break None,
                Err(error) => break Some(error),
            }
            messages += 1;
            if batch.words.len() >= BATCH_WORDS {
                let next = empty.try_recv().unwrap_or_default();
                // The other thread ends before this one only by a panic, which is passed on below.
                let _ = send.send(std::mem::replace(&mut batch, next));
            }
        };
        let _ = send.send(batch); // as above
        drop(send);
        match taking.join() {
            Ok((digest, collector)) => (messages, damage, digest, collector),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })
}

impl RecordedOutcome {
    /// Reads a recording and judges it by its own scenario or by another one.
    ///
    /// # Errors
    /// If the file is not a recording.
    pub fn of(run: &Path, by: Option<&Path>) -> Result<Self, ReadError> {
        let mut reader = RunReader::open(run)?.patient().without_digest();
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
        let places = TimingPlaces::of(&reader);
        let (messages, damage, digest, mut collector) = collect(&mut reader, collector, &places);
        collector.conclude();
        let number = |name| reader.result(name).and_then(|text| text.parse().ok());
        let (written, is_excerpt) = (reader.records(), reader.is_excerpt());
        let missing = || match is_excerpt {
            false if written > 0 => (reader.step() + 1).saturating_sub(written),
            _ => 0,
        };
        let lost: u64 = number("lost").unwrap_or_else(missing);
        let digest = Some(match is_excerpt {
            true => reader.digest(),
            false => digest.finish(),
        });
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
