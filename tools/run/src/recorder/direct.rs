//! Recorders in the thread that runs very many cases: the same digest, metrics and requirements, with neither a
//! recording nor latency.

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

/// First sleep of one who waits for records; each further one is twice as long.
const FIRST_NAP: Duration = Duration::from_micros(50);

/// Takes the records of one run from a stream that other runs use after it: to the end of the run, or until there
/// is nothing to take and `is_over`.
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
    let mut nap = FIRST_NAP;
    while !work.has_ended() {
        // Asked before the last look: what was published until then must be in it.
        let is_last = is_over();
        match source.drain(&mut |item| work.take(item)) {
            Ok(0) if is_last => break,
            Ok(0) => {
                std::thread::sleep(nap);
                nap = if nap < NAP { 2 * nap } else { NAP };
            }
            Ok(_) => nap = FIRST_NAP,
            Err(error) => work.fail(format!("the record stream failed: {error}")),
        }
    }
    work.finish()
}

/// A sink whose items are taken at once.
pub(crate) struct DirectRecorder {
    work: RecorderWork,
    shared: Arc<Shared>,
    layout: RecordLayout,
}

impl DirectRecorder {
    /// Makes a recorder of records of this layout, which takes a curve if there is a grid for it.
    pub(crate) fn new(plan: Plan, layout: RecordLayout, grid: Option<Arc<Grid>>) -> Self {
        let shared = Arc::new(Shared::default());
        let work = RecorderWork::new(plan, None, Vec::new(), Arc::clone(&shared)).without_latency();
        Self {
            work: work.with_curve(grid),
            shared,
            layout,
        }
    }

    /// Returns a check of whether something went wrong, so that the run should stop; usable while the recorder is
    /// lent.
    pub(crate) fn failure(&self) -> impl Fn() -> bool + use<> {
        let shared = Arc::clone(&self.shared);
        move || shared.failed.load(Ordering::Relaxed)
    }

    /// Ends with all that was taken.
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
