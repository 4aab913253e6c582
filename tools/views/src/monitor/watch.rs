//! Watching the session, on a thread of its own: from before its first step to its summary.
//!
//! The thread sleeps between looks at the stream. It must not wait for a terminal: what it does not
//! take in time is lost to it. Events that were lost are in the recording, once the run has ended.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use hil_console::files::runs::SUMMARY;
use hil_console::terminal::exit::Failure;
use hil_facts::session::happening::Happening;
use hil_facts::session::observer::{Observer, Seen};
use hil_recording::reader::{RECORDING, ReadError, RunReader};
use hil_session::session::SessionInfo;
use serde_json::Value;
use shared_types::record::RecordLayout;
use shared_types::time::Rate;

use super::{SharedModel, line};

/// Interval between two looks for the beginning of the session.
const BEGIN: Duration = Duration::from_millis(20);
/// Interval between two looks for the session while nothing comes.
const LOOK: Duration = Duration::from_millis(200);
/// Limit for the end of a session after its last record, and for its summary after that.
const END_LIMIT: Duration = Duration::from_secs(20);
/// Limit for reading the events of a recording.
const READ_LIMIT: Duration = Duration::from_secs(4);

/// A second consumer of the observed records; called on the observer thread, must not block.
pub(crate) trait Audience: Send {
    /// The signals are known.
    fn attach(&mut self, layout: &RecordLayout);

    /// Something was seen.
    fn take(&mut self, seen: &Seen<'_>);

    /// Nothing will be seen any more; why, as a person reads it.
    fn end(&mut self, last_word: &str);
}

/// The thread as its owner sees it.
pub(crate) struct Watch {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    failures: Receiver<Failure>,
    first: Receiver<()>,
}

impl Watch {
    /// Watches a session from now on, until this is dropped; with a whole log in the end if that is shown.
    #[must_use]
    pub(crate) fn start(
        session: SessionInfo,
        model: SharedModel,
        audience: Option<Box<dyn Audience>>,
        shows_log: bool,
    ) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (failed, failures) = channel();
        let (tried, first) = channel();
        let mut work = WatchThread {
            session,
            model,
            audience,
            shows_log,
            stop: Arc::clone(&stop),
        };
        let thread = std::thread::spawn(move || {
            if let Err(failure) = work.watch(&tried) {
                let _ = failed.send(failure); // nobody is left to tell
            }
        });
        Self {
            stop,
            thread: Some(thread),
            failures,
            first,
        }
    }

    /// Waits until it was tried for the first time to attach.
    pub(crate) fn wait_for_first(&self) {
        let _ = self.first.recv(); // an error is told by `check`
    }

    /// Tells what keeps it from watching.
    ///
    /// # Errors
    /// If something does.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        self.failures.try_recv().map_or(Ok(()), Err)
    }

    /// Reports the end of the records.
    #[must_use]
    pub(crate) fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic has told itself
        }
    }
}

struct WatchThread {
    session: SessionInfo,
    model: SharedModel,
    audience: Option<Box<dyn Audience>>,
    shows_log: bool,
    stop: Arc<AtomicBool>,
}

impl WatchThread {
    fn watch(&mut self, tried: &Sender<()>) -> Result<(), Failure> {
        let attached = self.attach(tried)?;
        if let Some(mut observer) = attached {
            self.look(&mut observer)?;
        }
        self.wait_for_summary();
        let model = self.model.lock();
        if let (Some(audience), Some(ending)) = (&mut self.audience, model.ending()) {
            audience.end(&line::ended(&model, ending));
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    /// Attaches as soon as there is something to attach to; `None` if there will not be.
    fn attach(&mut self, tried: &Sender<()>) -> Result<Option<Observer>, Failure> {
        while !self.is_over() && self.session.is_there() {
            self.find_run_dir();
            if let Some(observer) = Observer::attach(&self.session)? {
                self.model.lock().attach(observer.layout())?;
                if let Some(audience) = &mut self.audience {
                    audience.attach(observer.layout());
                }
                let _ = tried.send(()); // whoever waited may not any more
                return Ok(Some(observer));
            }
            let _ = tried.send(());
            std::thread::sleep(BEGIN);
        }
        Ok(None)
    }

    /// Looks until the run ends.
    fn look(&mut self, observer: &mut Observer) -> Result<(), Failure> {
        let mut looked = Instant::now();
        while !self.is_over() {
            // Asked before the look: what came until then must be in it.
            let is_last = looked.elapsed() > LOOK && !self.session.is_there();
            let taken = {
                let mut model = self.model.lock();
                let taken = observer.look(|seen| {
                    if let Some(audience) = &mut self.audience {
                        audience.take(&seen);
                    }
                    model.take(seen);
                })?;
                if model.ending().is_some() {
                    return Ok(());
                }
                taken
            };
            if taken == 0 && is_last {
                return Ok(());
            }
            if looked.elapsed() > LOOK {
                looked = Instant::now();
                self.model.lock().is_owner_stopped = self.session.owner.is_stopped();
            }
            std::thread::sleep(observer.nap());
        }
        Ok(())
    }

    /// Waits until `hil` has removed the session and written the summary, and takes the verdict.
    fn wait_for_summary(&self) {
        let since = Instant::now();
        let run_dir = self.find_run_dir();
        let (mut verdict, mut standings) = (None, None);
        while !self.is_over() && verdict.is_none() && since.elapsed() < END_LIMIT {
            // Asked before the look. Killed, it writes none, and it removes the folder of a run that did not begin.
            let has_folder = run_dir.as_ref().is_some_and(|folder| folder.exists());
            let is_last =
                !(self.session.owner.is_alive() && (has_folder || self.session.is_there()));
            let text = run_dir
                .as_ref()
                .and_then(|folder| std::fs::read_to_string(folder.join(SUMMARY)).ok());
            let summary: Option<Value> = text.and_then(|text| serde_json::from_str(&text).ok());
            if let Some(mut summary) = summary {
                verdict = summary["verdict"].as_str().map(str::to_owned);
                standings = serde_json::from_value(summary["requirements"].take()).ok();
            }
            if verdict.is_none() && is_last {
                break;
            }
            std::thread::sleep(BEGIN);
        }
        if self.is_over() {
            return; // it is not watched any more, which is no end
        }
        if self.shows_log {
            self.complete_log(run_dir.as_deref());
        }
        let mut model = self.model.lock();
        // What was asked last is older than the end.
        model.hear_standings(standings);
        if verdict.is_none() && !self.session.owner.is_alive() {
            let recording = model.run_dir.as_ref().map(|folder| folder.join(RECORDING));
            model.abandon(recording.is_some_and(|file| file.exists()));
        } else {
            model.end(verdict);
        }
    }

    /// Finds the folder of the run as long as the session is there: one that was just made does not tell it yet.
    fn find_run_dir(&self) -> Option<PathBuf> {
        let known = self.model.lock().run_dir.clone();
        known.or_else(|| {
            let info = SessionInfo::read(&self.session.folder).ok();
            // Another session may have the name by now.
            let info = info.filter(|info| info.id == self.session.id)?;
            self.model.lock().run_dir.clone_from(&info.run_dir);
            info.run_dir
        })
    }

    /// Takes from the recording what happened, of a run of which the stream has not told all.
    fn complete_log(&self, run_dir: Option<&Path>) {
        let model = self.model.lock();
        let (is_whole, rate) = (model.has_seen_all(), model.rate());
        drop(model);
        if let (false, Some(run_dir)) = (is_whole, run_dir)
            && let Ok(account) = recorded(run_dir, rate)
        {
            self.model.lock().hear_whole_account(account);
        }
    }
}

/// The account of a recorded run, or as much of it as is read in time.
fn recorded(run: &Path, rate: Rate) -> Result<Vec<Happening>, ReadError> {
    let since = Instant::now();
    let mut reader = RunReader::open(run)?.without_digest();
    let mut account = Vec::new();
    loop {
        let is_there = reader.advance()?;
        let events = reader.events().iter();
        account.extend(events.filter_map(|event| Happening::of(event, rate)));
        if !is_there || since.elapsed() > READ_LIMIT {
            return Ok(account);
        }
    }
}
