//! Processing of stream items by the recorder's thread, until the recording is complete.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use hil_config::plan::{Clock, Plan};
use hil_facts::checkpoint::past::PastRecords;
use hil_facts::results::collector::Collector;
use hil_facts::results::curve::Grid;
use hil_facts::results::curves::CurveTaker;
use hil_facts::results::ending;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_facts::results::held_commands::HeldCommands;
use hil_facts::results::latency::legs::Latency;
use hil_facts::results::recorded::{Recorded, Stretch};
use hil_facts::session::happening::Happening;
use hil_facts::session::standing;
use hil_recording::clean::clean;
use hil_recording::reader::{ReadError, RunReader};
use hil_recording::writer::{Part, Recording};
use hil_session::clock::monotonic_ns;
use shared_types::digest::Digest;
use shared_types::record::{Event, Outcome, RecordLayout};
use shared_types::stream::{Item, RecordSource};
use shared_types::time::Step;

use super::heard::Validator;
use crate::realtime;
use crate::recorder::{NAP, RecordingPlan, Shared};

/// State of the recorder's thread.
pub(super) struct RecorderWork {
    plan: Plan,
    recording_plan: Option<RecordingPlan>,
    /// Numbers of records after which an additional digest is taken.
    marks: Vec<u64>,
    shared: Arc<Shared>,
    /// Grid of the curve, if one is recorded.
    grid: Option<Arc<Grid>>,
    pub(super) layout: RecordLayout,
    validator: Validator,
    recording: Option<Recording>,
    digest: Digest,
    collector: Collector,
}

impl RecorderWork {
    pub(super) fn new(
        plan: Plan,
        recording_plan: Option<RecordingPlan>,
        marks: Vec<u64>,
        shared: Arc<Shared>,
    ) -> Self {
        Self {
            collector: Collector::new(
                plan.run.steps,
                None,
                Some(Latency::new(plan.run.clock != Clock::Lockstep)),
            ),
            plan,
            recording_plan,
            marks,
            shared,
            grid: None,
            layout: RecordLayout::default(),
            validator: Validator::default(),
            recording: None,
            digest: Digest::default(),
        }
    }

    /// Disables latency figures, whose computation takes longer than a short run.
    pub(super) fn without_latency(mut self) -> Self {
        self.collector.latency = None;
        self
    }

    /// Enables the curve of a case.
    pub(super) fn with_curve(mut self, grid: Option<Arc<Grid>>) -> Self {
        self.grid = grid;
        self
    }

    /// Processes the records and events of the continued run.
    pub(super) fn recall(&mut self, past: &PastRecords) {
        self.open(past.layout.clone());
        self.collector.is_past = true;
        let from = past.recording.display();
        if let Err(error) = self.recall_records(past) {
            self.fail(format!("cannot continue from {from}: {error}"));
        } else if self.collector.recorded.records != past.count
            || self.digest.clone().finish() != past.digest
        {
            self.fail(format!(
                "cannot continue from {from}: it has changed since it was checked"
            ));
        }
        self.collector.is_past = false;
    }

    fn recall_records(&mut self, past: &PastRecords) -> Result<(), ReadError> {
        let mut reader = RunReader::open(&past.recording)?;
        while reader.records() < past.count
            && !self.shared.finish.load(Ordering::Acquire)
            && reader.advance()?
        {
            for event in reader.events() {
                self.take(Item::Event(event.clone()));
            }
            self.take(Item::Record(reader.words()));
        }
        Ok(())
    }

    /// Stores the layout of the run's records and the settings of both sides.
    pub(super) fn attach(&mut self, layout: RecordLayout) {
        let facts: BTreeMap<String, String> = match &self.recording_plan {
            Some(plan) => realtime::facts(&plan.session).collect(),
            None => BTreeMap::new(),
        };
        if self.collector.recorded.records == 0 {
            if let Some(plan) = &mut self.recording_plan {
                plan.provenance.facts.extend(facts);
            }
            self.open(layout);
            return;
        }
        if layout != self.layout {
            self.fail("the signals differ from those of the run to continue".into());
        }
        self.write(|recording| recording.facts(facts));
    }

    pub(super) fn open(&mut self, layout: RecordLayout) {
        match RecordEvaluation::of_layout(&self.plan, &layout) {
            Ok(evaluation) => self.collector.evaluation = Some(evaluation),
            Err(error) => self.fail(format!("cannot evaluate the scenario: {error}")),
        }
        let grid = self.grid.clone();
        self.collector.held_commands = HeldCommands::of(&layout);
        self.collector.curve = grid.map(|grid| CurveTaker::new(grid, &self.plan, &layout));
        if let Some(plan) = &self.recording_plan {
            let part = (!plan.choice.is_all()).then_some(Part {
                choice: &plan.choice,
                rate: self.plan.run.rate,
                last: Step(self.plan.run.steps),
            });
            let (path, how) = (&plan.path, plan.compression);
            match Recording::create(path, how, &layout, &plan.provenance, part) {
                Ok(recording) => self.recording = Some(recording),
                Err(error) => {
                    self.fail(format!(
                        "cannot write {}: {}",
                        plan.path.display(),
                        causes(&error)
                    ));
                }
            }
        }
        self.layout = layout;
    }

    /// Processes items until the plant has reported the end of the run, or its stream is empty after its death.
    pub(super) fn drain(&mut self, source: &mut impl RecordSource) {
        let mut error = None;
        while self.collector.recorded.end.is_none() {
            // Checked before the last look, which must include everything published until then.
            let finishing = self.shared.finish.load(Ordering::Acquire);
            let shared = Arc::clone(&self.shared);
            let mut take = |item: Item<'_>| {
                shared.cross();
                self.take(item);
                shared.cross();
            };
            match shared.in_stream(|| source.drain(&mut take)) {
                Ok(0) if finishing => break,
                Ok(0) => std::thread::park_timeout(NAP),
                Ok(_) => {}
                Err(failed) => {
                    error = Some(format!("the record stream failed: {failed}"));
                    break;
                }
            }
            self.keep_up();
        }
        if let Some(error) = error {
            self.fail(error);
        }
    }

    /// Returns `true` if the plant has reported the end of the run, or its records are invalid.
    pub(super) const fn has_ended(&self) -> bool {
        let recorded = &self.collector.recorded;
        recorded.end.is_some() || recorded.error.is_some()
    }

    pub(super) fn take(&mut self, item: Item<'_>) {
        if self.collector.recorded.end.is_some() {
            return self.refuse("the record stream continued after the end of the run".into());
        }
        match item {
            Item::Record(_) if self.validator.is_broken() => {}
            Item::Record(words) if words.len() == self.layout.words() => {
                let view = self.layout.view(words);
                let validated =
                    self.validator
                        .record(&self.plan, &view, self.collector.recorded.lost);
                if let Err(error) = validated {
                    return self.refuse(error);
                }
                self.digest.record(view.hashed);
                self.collector.record(words, &view.timing);
                let recorded = &mut self.collector.recorded;
                // Complete intervals are evaluated first, so that all have the same length.
                let mut stretches = recorded.stretches.iter_mut().rev();
                while stretches.next().is_some_and(|open| open.take(view.hashed)) {}
                if self.marks.contains(&recorded.records) && recorded.lost == 0 {
                    let digest = self.digest.clone().finish();
                    recorded.partial_digests.insert(recorded.records, digest);
                    let accepted = recorded.faults.accepted.len();
                    (recorded.stretches).push(Stretch::new(recorded.records, accepted));
                }
                (self.shared.next_step).store(self.validator.next_step(), Ordering::Relaxed);
                self.write(|recording| recording.record(words, &view));
            }
            Item::Record(words) => {
                let (got, expected) = (words.len(), self.layout.words());
                self.refuse(format!(
                    "received a record of {got} words instead of the agreed {expected}"
                ));
            }
            Item::Event(event) => {
                let event = clean(event);
                let validated = self
                    .validator
                    .event(&self.plan, &event, &self.collector.recorded);
                if let Err(error) = validated {
                    return self.refuse(error);
                }
                let step = self.note_event(&event);
                let time_ns = step.map(|step| self.plan.run.rate.nanoseconds(Step(step)));
                self.write(|recording| recording.event(&event, time_ns, monotonic_ns()));
            }
            Item::Lost(count) => {
                self.collector.recorded.lost = self.collector.recorded.lost.saturating_add(count);
                if self.plan.run.clock != Clock::Realtime {
                    let next = self.validator.next_step();
                    self.refuse(format!(
                        "{count} items of the record stream were lost before step {next}, but none may be lost"
                    ));
                }
            }
            Item::Broken(reason) => self.refuse(format!("the record stream is broken: {reason}")),
        }
    }

    /// Stores the parts of an event for the summary; returns its step, if it has one.
    fn note_event(&mut self, event: &Event) -> Option<u64> {
        if let Err(error) = self.collector.event(event) {
            self.fail(format!("the record stream is broken: {error}"));
        }
        self.digest.event(event);
        if let Some(happening) = Happening::of(event, self.plan.run.rate) {
            self.shared.board.note(happening);
        }
        if let Event::Controller(change) = event {
            let changes = self.shared.changes.lock();
            (changes.unwrap_or_else(PoisonError::into_inner)).push(change.clone());
        }
        event.step()
    }

    pub(super) fn keep_up(&mut self) {
        self.write_facts();
        let evaluation = self.collector.evaluation.as_ref();
        let standings = || evaluation.map(|one| standing::of(one.so_far()));
        (self.shared.board).answer(|| standings().unwrap_or_default());
        self.write(Recording::keep_up);
    }

    fn write_facts(&mut self) {
        let facts = self.shared.facts.lock();
        let facts = std::mem::take(&mut *facts.unwrap_or_else(PoisonError::into_inner));
        if !facts.is_empty() {
            self.write(|recording| recording.facts(facts));
        }
    }

    /// Writes to the recording, if there is one; the first failure ends the recording.
    fn write(&mut self, write: impl FnOnce(&mut Recording) -> std::io::Result<()>) {
        let written = self.recording.as_mut().map_or(Ok(()), write);
        let Err(error) = written else { return };
        let Some(recording) = self.recording.take() else {
            return;
        };
        let path = self.path();
        let step = self.shared.next_step.load(Ordering::Relaxed);
        let reason = format!("cannot write {path} before step {step}: {}", causes(&error));
        let content = self.end(recording, Outcome::Failed, Some(&reason)).1;
        self.collector.recorded.cut_short = Some(reason.clone());
        self.fail(format!("{reason}; {content}"));
    }

    /// Ends a recording; returns `true` if the recording is complete, and a description of its content.
    fn end(
        &mut self,
        mut recording: Recording,
        outcome: Outcome,
        reason: Option<&str>,
    ) -> (std::io::Result<()>, String) {
        let mut closed = recording.close();
        self.collector.recorded.written = recording.safe();
        let mut result = self.result(outcome, reason);
        if closed.is_err() {
            // It has fewer records than the digest covers.
            result.insert("records".into(), recording.safe().to_string());
            result.insert("digest".into(), String::new());
        }
        let (path, count) = (self.path(), self.collector.recorded.written);
        let content = match recording.end(result) {
            Ok(()) => format!("it has {count} records"),
            Err(error) => {
                closed = closed.and(Err(error));
                format!(
                    "it has {count} records and no end; complete it with `hil recover {path}` where there is disk space"
                )
            }
        };
        (closed, content)
    }

    fn path(&self) -> String {
        let plan = self.recording_plan.as_ref();
        plan.map_or_else(String::new, |plan| plan.path.display().to_string())
    }

    /// Returns the digest of the records so far; `None` if a record was lost.
    fn digest(&self) -> Option<String> {
        let is_there = self.collector.recorded.lost == 0 && self.collector.recorded.records > 0;
        is_there.then(|| self.digest.clone().finish())
    }

    /// Returns the facts written to a recording after the run.
    fn result(&self, outcome: Outcome, reason: Option<&str>) -> BTreeMap<String, String> {
        let facts = [
            ("records", self.collector.recorded.records.to_string()),
            ("lost", self.collector.recorded.lost.to_string()),
            ("digest", self.digest().unwrap_or_default()),
            ("outcome", outcome.name().to_owned()),
            ("reason", reason.unwrap_or_default().to_owned()),
        ];
        let owned = facts.map(|(name, value)| (name.to_owned(), value));
        owned.into_iter().collect()
    }

    /// Fails with this error, and trusts no later record.
    fn refuse(&mut self, error: String) {
        self.validator.broke();
        self.fail(error);
    }

    pub(super) fn fail(&mut self, error: String) {
        self.collector.recorded.error.get_or_insert(error);
        self.shared.failed.store(true, Ordering::Release);
    }

    pub(super) fn finish(mut self) -> Recorded {
        self.write_facts();
        self.collector.conclude();
        if self.collector.recorded.error.is_none()
            && let Some(what) = ending::contradiction(&self.plan, &self.collector.recorded)
        {
            self.fail(what);
        }
        if let (None, 1.., Some(end)) = (
            &self.collector.recorded.error,
            self.collector.recorded.lost,
            &self.collector.recorded.end,
        ) && end.outcome == Outcome::Completed
        {
            // Lost items are counted, some of which were events; and there is a record after the last step.
            self.collector.recorded.lost = end.steps + 1 - self.collector.recorded.records;
        }
        self.collector.recorded.digest = self.digest();
        if let Some(recording) = self.recording.take() {
            let Recorded { end, error, .. } = &self.collector.recorded;
            let (outcome, reason) = match (error.clone(), end.clone()) {
                (Some(error), _) => (Outcome::Failed, Some(error)),
                (None, Some(end)) => (end.outcome, end.reason),
                (None, None) => (
                    Outcome::Failed,
                    Some("the plant reported no end".to_owned()),
                ),
            };
            if let (Err(error), content) = self.end(recording, outcome, reason.as_deref()) {
                let (path, causes) = (self.path(), causes(&error));
                let reason = format!("cannot finish {path}: {causes}");
                let error = format!("{reason}; {content}");
                self.collector.recorded.cut_short = Some(reason);
                self.collector.recorded.error.get_or_insert(error);
            }
        }
        self.collector.recorded
    }
}

/// Formats an error with its causes; the last cause is the one on which a user can act.
fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text += &format!(": {error}");
        cause = error.source();
    }
    text
}
