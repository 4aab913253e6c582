//! What the recorder's thread does with each item of the stream, until the recording is complete.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::{Clock, Plan};
use shared_types::clock::monotonic_ns;
use shared_types::digest::Digest;
use shared_types::record::{Event, Outcome, RecordLayout, Validity};
use shared_types::stream::{Item, RecordSource};
use shared_types::time::Step;

use super::heard::Heard;
use crate::checkpoint::past::PastRecords;
use crate::recording::clean::clean;
use crate::recording::reader::{ReadError, RunReader};
use crate::recording::writer::{Part, Recording};
use crate::results::ending;
use crate::results::faults::LiveFault;
use crate::results::latency::legs::Latency;
use crate::results::recorded::Recorded;
use crate::run::realtime;
use crate::run::recorder::{NAP, RecordingPlan, Shared};
use crate::session::standing;

/// The thread's own state.
pub(super) struct Work {
    plan: Plan,
    recording_plan: Option<RecordingPlan>,
    /// After how many records the digest is wanted besides.
    marks: Vec<u64>,
    shared: Arc<Shared>,
    /// The records that come are those of this run, not those that it goes on from.
    is_live: bool,
    pub(super) layout: RecordLayout,
    validity: Validity,
    heard: Heard,
    recording: Option<Recording>,
    evaluation: Option<Evaluation>,
    digest: Digest,
    latency: Latency,
    first_ns: Option<u64>,
    last_ns: u64,
    recorded: Recorded,
}

impl Work {
    pub(super) fn new(
        plan: Plan,
        recording_plan: Option<RecordingPlan>,
        marks: Vec<u64>,
        shared: Arc<Shared>,
    ) -> Self {
        let latency = Latency::default();
        let recorded = Recorded::begun(latency.summary());
        Self {
            plan,
            recording_plan,
            marks,
            shared,
            is_live: true,
            layout: RecordLayout::default(),
            validity: Validity::default(),
            heard: Heard::default(),
            recording: None,
            evaluation: None,
            digest: Digest::default(),
            latency,
            first_ns: None,
            last_ns: 0,
            recorded,
        }
    }

    /// Takes the records that the run goes on from, with what happened between them.
    pub(super) fn recall(&mut self, past: &PastRecords) {
        self.open(past.layout.clone());
        self.is_live = false;
        let from = past.recording.display();
        if let Err(error) = self.recall_records(past) {
            self.fail(format!("cannot go on from {from}: {error}"));
        } else if self.recorded.records != past.count || self.digest.clone().finish() != past.digest
        {
            self.fail(format!(
                "cannot go on from {from}: it changed since it was looked at"
            ));
        }
        self.is_live = true;
        self.recorded.past_records = self.recorded.records;
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

    /// What the records of this run will hold is known, and what both sides run with.
    pub(super) fn attach(&mut self, layout: RecordLayout) {
        let facts: BTreeMap<String, String> = match &self.recording_plan {
            Some(plan) => realtime::facts(&plan.session).collect(),
            None => BTreeMap::new(),
        };
        if self.recorded.records == 0 {
            if let Some(plan) = &mut self.recording_plan {
                plan.provenance.facts.extend(facts);
            }
            self.open(layout);
            return;
        }
        if layout != self.layout {
            self.fail("the records have other signals than those that the run goes on from".into());
        }
        let written = match &mut self.recording {
            Some(recording) => recording.facts(facts),
            None => Ok(()),
        };
        self.note(written);
    }

    pub(super) fn open(&mut self, layout: RecordLayout) {
        match Evaluation::new(&self.plan, &Columns::from(&layout)) {
            Ok(evaluation) => self.evaluation = Some(evaluation),
            Err(error) => self.fail(format!("cannot evaluate the scenario: {error}")),
        }
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
        self.validity = layout.validity();
        self.layout = layout;
    }

    /// Takes items until the plant said how the run ended, or its stream is dry after its death.
    pub(super) fn drain(&mut self, source: &mut impl RecordSource) {
        let mut error = None;
        while self.recorded.end.is_none() {
            // Asked before the last look: what was published until then must be in it.
            let finishing = self.shared.finish.load(Ordering::Acquire);
            match source.drain(&mut |item| self.take(item)) {
                Ok(0) if finishing => break,
                Ok(0) => std::thread::sleep(NAP),
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

    fn take(&mut self, item: Item<'_>) {
        if self.recorded.end.is_some() {
            return self.refuse("the record stream went on after the end of the run".into());
        }
        match item {
            Item::Record(_) if self.heard.is_broken() => {}
            Item::Record(words) if words.len() == self.layout.words() => {
                let view = self.layout.view(words);
                let heard = self.heard.record(&self.plan, &view, self.recorded.lost);
                if let Err(error) = heard {
                    return self.refuse(error);
                }
                if view.step < self.plan.run.steps
                    && let Some(answers) = &mut self.recorded.answers
                {
                    answers.take(&view.timing);
                }
                self.digest.record(view.hashed);
                if let Some(evaluation) = &mut self.evaluation {
                    evaluation.observe(Step(view.step), view.values, self.validity.invalid(words));
                }
                if self.is_live {
                    self.latency.take(view.step, &view.timing);
                    self.first_ns.get_or_insert(view.timing.published_ns);
                    self.last_ns = view.timing.published_ns;
                }
                self.recorded.records += 1;
                let records = self.recorded.records;
                if self.marks.contains(&records) && self.recorded.lost == 0 {
                    let digest = self.digest.clone().finish();
                    self.recorded.partial_digests.insert(records, digest);
                }
                (self.shared.next_step).store(self.heard.next_step(), Ordering::Relaxed);
                let written = match &mut self.recording {
                    Some(recording) => recording.record(words, &view),
                    None => Ok(()),
                };
                self.note(written);
            }
            Item::Record(words) => {
                let (got, wanted) = (words.len(), self.layout.words());
                self.refuse(format!(
                    "a record of {got} words came where {wanted} were agreed"
                ));
            }
            Item::Event(event) => {
                let event = clean(event);
                let heard = self.heard.event(&self.plan, &event, &self.recorded);
                if let Err(error) = heard {
                    return self.refuse(error);
                }
                let step = self.note_event(&event);
                let time_ns = step.map(|step| self.plan.run.rate.nanoseconds(Step(step)));
                let written = match &mut self.recording {
                    Some(recording) => recording.event(&event, time_ns, monotonic_ns()),
                    None => Ok(()),
                };
                self.note(written);
            }
            Item::Lost(count) => {
                self.recorded.lost = self.recorded.lost.saturating_add(count);
                if self.plan.run.clock != Clock::Realtime {
                    let next = self.heard.next_step();
                    self.refuse(format!(
                        "{count} items of the record stream were lost before step {next}, and all are due"
                    ));
                }
            }
            Item::Broken(what) => self.refuse(format!("the record stream is broken: {what}")),
        }
    }

    /// Keeps what the summary needs of an event; the step that it is about, if it is about one.
    fn note_event(&mut self, event: &Event) -> Option<u64> {
        let faults = &mut self.recorded.faults;
        match event {
            Event::Accepted(accepted) => {
                match LiveFault::try_from(accepted) {
                    Ok(live) => faults.accepted.push(live),
                    Err(error) => {
                        let id = accepted.id;
                        self.fail(format!("the record stream is broken: fault {id}: {error}"));
                    }
                }
                Some(accepted.step)
            }
            Event::Fault(taken) => {
                self.digest.fault(taken);
                if let Some(evaluation) = &mut self.evaluation {
                    evaluation.fault(taken.id, Step(taken.step));
                }
                faults.taken.push(taken.clone());
                Some(taken.step)
            }
            Event::FaultEnded(ended) => {
                faults.ended.push(ended.clone());
                Some(ended.step)
            }
            Event::Controller(change) => {
                self.recorded.changes.push(change.clone());
                let changes = self.shared.changes.lock();
                (changes.unwrap_or_else(PoisonError::into_inner)).push(change.clone());
                Some(change.step)
            }
            Event::End(end) => {
                faults.sizes = Some(end.effects.clone());
                self.recorded.end = Some(end.clone());
                None
            }
        }
    }

    pub(super) fn keep_up(&mut self) {
        self.write_facts();
        let evaluation = self.evaluation.as_ref();
        (self.shared.board).answer(|| evaluation.map(standing::of).unwrap_or_default());
        if let Some(recording) = &mut self.recording {
            let kept = recording.keep_up();
            self.note(kept);
        }
    }

    fn write_facts(&mut self) {
        let facts = self.shared.facts.lock();
        let facts = std::mem::take(&mut *facts.unwrap_or_else(PoisonError::into_inner));
        if let Some(recording) = &mut self.recording
            && !facts.is_empty()
        {
            let written = recording.facts(facts);
            self.note(written);
        }
    }

    fn note(&mut self, written: std::io::Result<()>) {
        let Err(error) = written else { return };
        let Some(recording) = self.recording.take() else {
            return;
        };
        let path = self.path();
        let step = self.shared.next_step.load(Ordering::Relaxed);
        let reason = format!("cannot write {path} before step {step}: {}", causes(&error));
        let left = self.end(recording, Outcome::Failed, Some(&reason)).1;
        self.recorded.cut_short = Some(reason.clone());
        self.fail(format!("{reason}; {left}"));
    }

    /// Ends a recording: whether all that it took is in it, and what it is now.
    fn end(
        &mut self,
        mut recording: Recording,
        outcome: Outcome,
        reason: Option<&str>,
    ) -> (std::io::Result<()>, String) {
        let mut closed = recording.close();
        self.recorded.written = recording.safe();
        let mut result = self.result(outcome, reason);
        if closed.is_err() {
            // The records that it has are fewer than those that the digest covers.
            result.insert("records".into(), recording.safe().to_string());
            result.insert("digest".into(), String::new());
        }
        let (path, kept) = (self.path(), self.recorded.written);
        let left = match recording.end(result) {
            Ok(()) => format!("it has {kept} records"),
            Err(error) => {
                closed = closed.and(Err(error));
                format!(
                    "it has {kept} records and no end: `hil recover {path}` makes a whole file of it where there is room"
                )
            }
        };
        (closed, left)
    }

    fn path(&self) -> String {
        let plan = self.recording_plan.as_ref();
        plan.map_or_else(String::new, |plan| plan.path.display().to_string())
    }

    /// The digest of the records so far; `None` if one was lost.
    fn digest(&self) -> Option<String> {
        let is_there = self.recorded.lost == 0 && self.recorded.records > 0;
        is_there.then(|| self.digest.clone().finish())
    }

    /// What a recording says after the run.
    fn result(&self, outcome: Outcome, reason: Option<&str>) -> BTreeMap<String, String> {
        let facts = [
            ("records", self.recorded.records.to_string()),
            ("lost", self.recorded.lost.to_string()),
            ("digest", self.digest().unwrap_or_default()),
            ("outcome", outcome.name().to_owned()),
            ("reason", reason.unwrap_or_default().to_owned()),
        ];
        let owned = facts.map(|(name, value)| (name.to_owned(), value));
        owned.into_iter().collect()
    }

    /// What came is not to be believed, nor is any record after it.
    fn refuse(&mut self, error: String) {
        self.heard.broke();
        self.fail(error);
    }

    pub(super) fn fail(&mut self, error: String) {
        self.recorded.error.get_or_insert(error);
        self.shared.failed.store(true, Ordering::Release);
    }

    pub(super) fn finish(mut self) -> Recorded {
        self.write_facts();
        self.recorded.latency = self.latency.summary();
        if let Some(evaluation) = &self.evaluation {
            self.recorded.metrics = evaluation.results();
            self.recorded.requirements = evaluation.requirements();
        }
        if let Some(first_ns) = self.first_ns {
            self.recorded.wall_time_s = self.last_ns.saturating_sub(first_ns) as f64 / 1e9;
        }
        if self.recorded.error.is_none()
            && let Some(what) = ending::contradiction(&self.plan, &self.recorded)
        {
            self.fail(what);
        }
        if let (None, 1.., Some(end)) =
            (&self.recorded.error, self.recorded.lost, &self.recorded.end)
            && end.outcome == Outcome::Completed
        {
            // Items were counted, of which some were events; and there is a record after the last step.
            self.recorded.lost = end.steps + 1 - self.recorded.records;
        }
        self.recorded.digest = self.digest();
        if let Some(recording) = self.recording.take() {
            let Recorded { end, error, .. } = &self.recorded;
            let (outcome, reason) = match (error.clone(), end.clone()) {
                (Some(error), _) => (Outcome::Failed, Some(error)),
                (None, Some(end)) => (end.outcome, end.reason),
                (None, None) => (Outcome::Failed, Some("the plant told no end".to_owned())),
            };
            if let (Err(error), left) = self.end(recording, outcome, reason.as_deref()) {
                let (path, causes) = (self.path(), causes(&error));
                let reason = format!("cannot finish {path}: {causes}");
                let error = format!("{reason}; {left}");
                self.recorded.cut_short = Some(reason);
                self.recorded.error.get_or_insert(error);
            }
        }
        self.recorded
    }
}

/// An error with what is behind it: the last cause is what a person can act on.
fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text += &format!(": {error}");
        cause = error.source();
    }
    text
}
