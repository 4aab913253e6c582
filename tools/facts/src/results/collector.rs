//! Single pass over the records and events of a run: fed by the recorder during the run and by
//! [`RecordedOutcome`](super::outcome::RecordedOutcome) from a recording, so that both arrive at the same facts.
//! Trusts its input: the recorder validates items first, and digests are computed elsewhere.

use shared_types::record::{Event, Timing};

use crate::results::curves::CurveTaker;
use crate::results::evaluation::RecordEvaluation;
use crate::results::held_commands::HeldCommands;
use crate::results::latency::legs::Latency;
use crate::results::recorded::Recorded;

/// Facts of a run being collected.
#[derive(Clone)]
pub struct Collector {
    /// Steps of the run; 0 if its scenario is invalid.
    steps: u64,
    /// Metrics and requirements; `None` if the scenario is invalid.
    pub evaluation: Option<RecordEvaluation>,
    /// Curve of a case; `None` unless its campaign records curves.
    pub curve: Option<CurveTaker>,
    /// Commands held by the plant.
    pub held_commands: HeldCommands,
    /// Latency figures; `None` where unneeded, because histograms cost more than a short run.
    pub latency: Option<Latency>,
    /// Times at which the first and the last record were published.
    published_ns: Option<(u64, u64)>,
    /// `true` while records belong to the run being continued, which took no time of this run.
    pub is_past: bool,
    /// Events and counts of the run.
    pub recorded: Recorded,
}

impl Collector {
    /// Starts the collection for a run of `steps` steps, optionally with latency.
    pub fn new(steps: u64, evaluation: Option<RecordEvaluation>, latency: Option<Latency>) -> Self {
        Self {
            steps,
            evaluation,
            curve: None,
            held_commands: HeldCommands::default(),
            recorded: Recorded::begun(),
            latency,
            published_ns: None,
            is_past: false,
        }
    }

    /// Adds a record.
    pub fn record(&mut self, words: &[u64], timing: &Timing) {
        let step = words[0];
        let recorded = &mut self.recorded;
        recorded.records += 1;
        if step < self.steps {
            self.held_commands.take(words);
            if let Some(answers) = &mut recorded.answers {
                answers.take(timing);
            }
        }
        let evaluation = self.evaluation.as_mut();
        let derived = evaluation.map_or(&[][..], |evaluation| evaluation.record(words));
        if let Some(curve) = &mut self.curve {
            curve.record(words, derived);
        }
        if self.is_past {
            recorded.past_records += 1;
            return;
        }
        if let Some(latency) = &mut self.latency {
            latency.take(step, timing);
        }
        let (first_ns, _) = self.published_ns.unwrap_or((timing.published_ns, 0));
        self.published_ns = Some((first_ns, timing.published_ns));
    }

    /// Adds an event.
    ///
    /// # Errors
    /// If the event of a live fault is malformed; the event is then left out.
    pub fn event(&mut self, event: &Event) -> Result<(), String> {
        if let Some(evaluation) = &mut self.evaluation {
            evaluation.event(event);
        }
        match event {
            Event::Controller(change) => self.recorded.changes.push(change.clone()),
            Event::Change(change) => self.recorded.values.push(change.clone()),
            Event::Mark(mark) => self.recorded.marks.push(mark.clone()),
            Event::End(end) => self.recorded.end = Some(end.clone()),
            Event::Accepted(_) | Event::Fault(_) | Event::FaultEnded(_) => {}
        }
        self.recorded.faults.take(event)
    }

    /// Computes the figures of everything collected.
    pub fn conclude(&mut self) {
        let recorded = &mut self.recorded;
        recorded.curve = self.curve.take().map(CurveTaker::finish);
        recorded.held_commands = self.held_commands.held();
        recorded.latency = self
            .latency
            .as_ref()
            .map(Latency::summary)
            .unwrap_or_default();
        if let Some(evaluation) = &self.evaluation {
            recorded.metrics = evaluation.so_far().results();
            recorded.requirements = evaluation.so_far().requirements();
        }
        let (first_ns, last_ns) = self.published_ns.unwrap_or_default();
        recorded.wall_time_s = last_ns.saturating_sub(first_ns) as f64 / 1e9;
    }
}
