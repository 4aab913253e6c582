//! Recorder of a stepped run: digest, metrics and requirements so far, and the newest record.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

use hil_config::plan::Plan;
use hil_facts::results::collector::Collector;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_facts::results::held_commands::HeldCommands;
use hil_recording::clean::clean;
use shared_types::digest::Digest;
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout};
use shared_types::stream::RecordSink;

use super::Place;
use crate::attach::refuse_other_layout;

/// Results of the steps so far.
#[derive(Clone)]
pub(super) struct StepRecorder {
    layout: Arc<RecordLayout>,
    digest: Digest,
    pub(super) collector: Collector,
    /// Words of the newest record; empty before the first.
    newest: Vec<u64>,
    /// Reason for which the results are invalid.
    pub(super) error: Option<String>,
}

impl StepRecorder {
    /// Starts the results of a plan whose records have this layout.
    pub(super) fn new(plan: &Plan, layout: RecordLayout) -> Self {
        let (evaluation, error) = match RecordEvaluation::of_layout(plan, &layout) {
            Ok(evaluation) => (Some(evaluation), None),
            Err(error) => (None, Some(format!("cannot evaluate the scenario: {error}"))),
        };
        let mut collector = Collector::new(plan.run.steps, evaluation, None);
        collector.held_commands = HeldCommands::of(&layout);
        Self {
            digest: Digest::default(),
            collector,
            newest: Vec::with_capacity(layout.words()),
            layout: Arc::new(layout),
            error,
        }
    }

    fn record(&mut self, words: &[u64]) {
        let view = self.layout.view(words);
        self.digest.record(view.hashed);
        self.collector.record(words, &view.timing);
        self.newest.clear();
        self.newest.extend_from_slice(words);
    }

    fn event(&mut self, event: &Event) {
        let event = clean(event.clone());
        if let Err(error) = self.collector.event(&event) {
            self.error.get_or_insert(error);
        }
        self.digest.event(&event);
    }

    /// Returns the digest of the records so far; `None` before the first.
    pub(super) fn digest(&self) -> Option<String> {
        (!self.newest.is_empty()).then(|| self.digest.clone().finish())
    }

    /// Returns a value of the newest record; `None` before the first.
    #[inline]
    pub(super) fn value(&self, place: Place) -> Option<f64> {
        match place {
            Place::Word(word) => self.newest.get(word).map(|bits| f64::from_bits(*bits)),
            Place::Derived(index) if !self.newest.is_empty() => {
                let evaluation = self.collector.evaluation.as_ref()?;
                evaluation.so_far().derived().get(index).copied()
            }
            Place::Derived(_) => None,
        }
    }
}

/// Recorder shared by the plant, which writes, and the session, which reads.
#[derive(Clone)]
pub(super) struct SharedRecorder(pub(super) Rc<RefCell<StepRecorder>>);

impl RecordSink for SharedRecorder {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        let mut recorder = self.0.borrow_mut();
        if let Err(other) = refuse_other_layout(&recorder.layout, layout) {
            recorder.error.get_or_insert(other);
        }
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.0.borrow_mut().record(words);
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.0.borrow_mut().event(event);
        Ok(())
    }
}
