//! Recorder: drains the record stream on a thread of its own.
//!
//! Its `work` processes each record: digest, metrics, latency figures, requirements, recording. A failure to write the
//! recording is reported to the supervisor of the run. The loop never waits for this work, except that the stream's
//! credit delays the loop before a record would be lost.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::checkpoint::past::PastRecords;
use hil_facts::results::curve::Grid;
use hil_facts::results::recorded::Recorded;
use hil_facts::session::standing::Board;
use hil_recording::compression::Compression;
use hil_recording::excerpt::Choice;
use hil_recording::writer::Provenance;
use hil_session::session::SessionInfo;
use shared_types::record::{ControllerChange, RecordLayout};
use shared_types::stream::RecordSource;

use work::RecorderWork;

pub(crate) mod direct;
mod heard;
mod work;

/// Polling interval for the stream.
const LOOK: Duration = Duration::from_micros(500);
/// Sleep when the stream is empty: well below the time in which the fastest loop fills the stream's buffer, so that the
/// loop is not delayed. Each wake-up takes a core from the loop for some microseconds, in addition to the work on the
/// records.
const NAP: Duration = Duration::from_millis(4);

/// Time after which a thread that continues without the sides may be stuck in memory that they left behind.
const STUCK: Duration = Duration::from_millis(50);

/// Location and format of a recording.
#[derive(Clone, Debug)]
pub struct RecordingPlan {
    /// Path of the file.
    pub path: PathBuf,
    /// Compression.
    pub compression: Compression,
    /// Selection of the run's records.
    pub choice: Choice,
    /// Provenance of the run.
    pub provenance: Provenance,
    /// Session in which both sides report their settings before the first record.
    pub session: SessionInfo,
}

/// Handle of the recorder thread.
pub struct Recorder {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<Recorded>>,
    /// Escape from a stream left by dead sides.
    way_out: Option<WayOut>,
}

/// Escape from a stream that dead sides left incomplete or corrupted.
struct WayOut {
    /// Frees the thread from an incomplete stream.
    unblock: Box<dyn Fn()>,
    /// Time limit for progress in the stream, after which the thread counts as stuck; `None` for no limit.
    limit: Option<Duration>,
}

#[derive(Default)]
struct Shared {
    /// `true` once the stream will receive no more items.
    finish: AtomicBool,
    /// `true` once the records of the continued run have been processed.
    recalled: AtomicBool,
    /// `true` after a failure, which makes the run pointless.
    failed: AtomicBool,
    next_step: AtomicU64,
    /// Number of times that the thread entered or left the stream's code: odd while it is inside.
    crossings: AtomicU64,
    /// Changes of controllers.
    changes: Mutex<Vec<ControllerChange>>,
    /// Additional facts for the recording.
    facts: Mutex<BTreeMap<String, String>>,
    /// Queue of queries about the state of the requirements.
    board: Arc<Board>,
}

impl Shared {
    /// Notes that the thread, the only caller, enters or leaves the stream's code.
    fn cross(&self) {
        let crossings = self.crossings.load(Ordering::Relaxed);
        (self.crossings).store(crossings.wrapping_add(1), Ordering::Relaxed);
    }

    /// Executes work that may hang in the stream's code.
    fn in_stream<T>(&self, work: impl FnOnce() -> T) -> T {
        self.cross();
        let result = work();
        self.cross();
        result
    }
}

impl Recorder {
    /// Starts the thread. `marks` are the numbers of records after which an additional digest is taken, `past` the
    /// records of the continued run, which are processed first, and `curve` the grid of the curve if one is recorded.
    /// The function returned by `prepare` is called on the thread repeatedly, until it returns the stream and its
    /// layout.
    pub fn start<S, A>(
        plan: Plan,
        recording: Option<RecordingPlan>,
        marks: Vec<u64>,
        past: Option<PastRecords>,
        curve: Option<Arc<Grid>>,
        prepare: impl FnOnce() -> A + Send + 'static,
    ) -> Self
    where
        S: RecordSource,
        A: FnMut() -> Result<Option<(S, RecordLayout)>, String>,
    {
        let shared = Arc::new(Shared {
            recalled: AtomicBool::new(past.is_none()),
            ..Shared::default()
        });
        let theirs = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            let mut attach = prepare();
            let work = RecorderWork::new(plan, recording, marks, Arc::clone(&theirs));
            let mut work = work.with_curve(curve);
            if let Some(past) = &past {
                work.recall(past);
                theirs.recalled.store(true, Ordering::Release);
            }
            loop {
                // Checked before the last look: a short run may be over between the two.
                let is_over = theirs.finish.load(Ordering::Acquire);
                match theirs.in_stream(&mut attach) {
                    Ok(Some((mut source, layout))) => {
                        work.attach(layout);
                        work.drain(&mut source);
                        theirs.in_stream(|| drop(source));
                        break;
                    }
                    Ok(None) if is_over => break,
                    Ok(None) => std::thread::sleep(LOOK),
                    Err(error) => {
                        work.fail(error);
                        break;
                    }
                }
            }
            work.finish()
        });
        Self {
            shared,
            thread: Some(thread),
            way_out: None,
        }
    }

    /// Adds an escape from a stream that dead sides left incomplete. `unblock` is called repeatedly until the thread
    /// ends, and only once the sides are gone. If the thread then makes no progress in the stream's code for longer
    /// than `limit`, the memory of the stream is corrupt, and the process is aborted, because nothing else would end
    /// the thread.
    #[must_use]
    pub(crate) fn unblocked_by(
        mut self,
        limit: Option<Duration>,
        unblock: impl Fn() + 'static,
    ) -> Self {
        self.way_out = Some(WayOut {
            unblock: Box::new(unblock),
            limit,
        });
        self
    }

    /// Waits until the records of the continued run have been processed, before the run begins, so that no side has to
    /// wait for them.
    ///
    /// # Errors
    /// If the user interrupts the wait.
    pub(crate) fn recall(&self, interruption: &Interruption) -> Result<(), Failure> {
        while !self.shared.recalled.load(Ordering::Acquire) {
            interruption.check()?;
            std::thread::sleep(LOOK);
        }
        Ok(())
    }

    /// Returns the step after the last recorded one.
    pub(crate) fn next_step(&self) -> u64 {
        self.shared.next_step.load(Ordering::Relaxed)
    }

    /// Adds facts to the recording that became known during the run.
    pub(crate) fn add_facts(&self, facts: impl IntoIterator<Item = (String, String)>) {
        let all = self.shared.facts.lock();
        (all.unwrap_or_else(PoisonError::into_inner)).extend(facts);
    }

    /// Returns the queue for queries about the state of the requirements.
    pub(crate) fn board(&self) -> Arc<Board> {
        Arc::clone(&self.shared.board)
    }

    /// Returns the changes of controllers after the first `known` ones.
    pub(crate) fn changes_after(&self, known: usize) -> Vec<ControllerChange> {
        let changes = self.shared.changes.lock();
        let changes = changes.unwrap_or_else(PoisonError::into_inner);
        changes.get(known..).unwrap_or_default().to_vec()
    }

    /// Returns `true` if recording failed, so that the run should stop.
    pub(crate) fn has_failed(&self) -> bool {
        self.shared.failed.load(Ordering::Acquire)
    }

    /// Processes the remaining items in the stream of an ended plant, and ends.
    ///
    /// # Errors
    /// If the thread panicked.
    pub fn finish(mut self) -> Result<Recorded, String> {
        match self.join() {
            Some(Ok(recorded)) => Ok(recorded),
            Some(Err(_)) | None => Err("the recorder panicked".into()),
        }
    }

    fn join(&mut self) -> Option<thread::Result<Recorded>> {
        self.shared.finish.store(true, Ordering::Release);
        let thread = self.thread.take()?;
        thread.thread().unpark(); // it may be sleeping
        if !self.comes_back(&thread) {
            tell!(
                "error: the recorder is stuck in memory that it shares with the plant, because that memory was corrupted"
            );
            std::process::abort();
        }
        Some(thread.join())
    }

    /// Waits for the end of the thread; returns `false` if the thread is stuck in the stream.
    fn comes_back(&self, thread: &JoinHandle<Recorded>) -> bool {
        let Some(way_out) = &self.way_out else {
            return true;
        };
        let mut last = self.shared.crossings.load(Ordering::Relaxed);
        let (mut since_unblocked, mut without_progress) = (Duration::ZERO, Duration::ZERO);
        while !thread.is_finished() {
            let since = Instant::now();
            thread::sleep(LOOK);
            // While this process was stopped, the thread had no time either.
            let slept = since.elapsed().min(STUCK);
            since_unblocked += slept;
            without_progress += slept;
            if since_unblocked > STUCK {
                (way_out.unblock)();
                since_unblocked = Duration::ZERO;
            }
            let crossings = self.shared.crossings.load(Ordering::Relaxed);
            if crossings != last || crossings.is_multiple_of(2) {
                (last, without_progress) = (crossings, Duration::ZERO);
            }
            if way_out.limit.is_some_and(|limit| without_progress > limit) {
                return false;
            }
        }
        true
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // A run that could not be started delivers nothing more.
        let _ = self.join(); // its result is not needed
    }
}

#[cfg(test)]
pub(crate) mod tests;
