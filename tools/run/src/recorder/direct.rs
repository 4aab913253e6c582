//! Recorders in the thread that executes large numbers of cases: the same digest, metrics and requirements, but neither
//! a recording nor latency figures.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use hil_config::plan::Plan;
use hil_facts::results::curve::Grid;
use hil_facts::results::recorded::Recorded;
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout};
use shared_types::stream::{Item, RecordSink, RecordSource};

use super::work::RecorderWork;
use super::{NAP, Shared};
use crate::attach::refuse_other_layout;

/// First sleep while waiting for records; each further sleep is twice as long.
const FIRST_NAP: Duration = Duration::from_micros(50);

/// Drains the records of one run from a stream shared by several runs, until the end of the run, or until the stream is
/// empty and `is_over` returns `true`.
pub(crate) fn take_run(
    plan: Plan,
    layout: &RecordLayout,
    grid: Option<Arc<Grid>>,
    source: &mut impl RecordSource,
    mut is_over: impl FnMut() -> bool,
) -> Recorded {
    let shared = Arc::new(Shared::default());
    let work = RecorderWork::new(plan, None, Vec::new(), shared).without_latency();
    let mut work = work.with_curve(grid);
    work.attach(layout.clone());
    let take = |work: &mut RecorderWork, item: Result<Item<'_>, String>| match item {
        Ok(item) => work.take(item),
        Err(error) => work.fail(error),
    };
    let has_ended = |work: &RecorderWork| work.has_ended();
    drain(source, &mut work, take, has_ended, &mut is_over);
    work.finish()
}

/// Passes items of a stream to a consumer until the consumer has ended, or until the stream is empty and `is_over`
/// returns `true`.
pub(crate) fn drain<C>(
    source: &mut impl RecordSource,
    consumer: &mut C,
    take: impl Fn(&mut C, Result<Item<'_>, String>),
    has_ended: impl Fn(&C) -> bool,
    mut is_over: impl FnMut() -> bool,
) {
    let mut nap = FIRST_NAP;
    while !has_ended(consumer) {
        // Checked before the last look, which must include everything published until then.
        let is_last = is_over();
        match source.drain(&mut |item| take(consumer, Ok(item))) {
            Ok(0) if is_last => break,
            Ok(0) => {
                std::thread::sleep(nap);
                nap = if nap < NAP { 2 * nap } else { NAP };
            }
            Ok(_) => nap = FIRST_NAP,
            Err(error) => take(consumer, Err(format!("the record stream failed: {error}"))),
        }
    }
}

/// Sink that processes items at once.
pub(crate) struct DirectRecorder {
    work: RecorderWork,
    shared: Arc<Shared>,
    layout: RecordLayout,
}

impl DirectRecorder {
    /// Creates a recorder for records of this layout, which records a curve if there is a grid.
    pub(crate) fn new(plan: Plan, layout: RecordLayout, grid: Option<Arc<Grid>>) -> Self {
        let shared = Arc::new(Shared::default());
        let work = RecorderWork::new(plan, None, Vec::new(), Arc::clone(&shared)).without_latency();
        Self {
            work: work.with_curve(grid),
            shared,
            layout,
        }
    }

    /// Returns a check for failures, after which the run should stop; usable while the recorder is borrowed.
    pub(crate) fn failure(&self) -> impl Fn() -> bool + use<> {
        let shared = Arc::clone(&self.shared);
        move || shared.failed.load(Ordering::Relaxed)
    }

    /// Returns the results.
    pub(crate) fn finish(self) -> Recorded {
        self.work.finish()
    }
}

impl RecordSink for DirectRecorder {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        match refuse_other_layout(&self.layout, layout) {
            Ok(()) => self.work.attach(layout.clone()),
            Err(other) => self.work.fail(other),
        }
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.work.take(Item::Record(words));
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.work.take(Item::Event(event.clone()));
        Ok(())
    }
}
