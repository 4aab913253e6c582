//! Background thread that watches the session from before its first step until its summary.
//!
//! The thread sleeps between polls of the stream. It never waits for a terminal, because records that are not read in
//! time are lost. Lost events are read from the recording once the run has ended.

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

/// Polling interval until the session begins.
const BEGIN: Duration = Duration::from_millis(20);
/// Polling interval while no records arrive.
const LOOK: Duration = Duration::from_millis(200);
/// Time limit for the end of a session after its last record, and for its summary after that.
const END_LIMIT: Duration = Duration::from_secs(20);
/// Time limit for reading the events of a recording.
const READ_LIMIT: Duration = Duration::from_secs(4);

/// Second consumer of the observed records; called on the observer thread, must not block.
pub(crate) trait Audience: Send {
    /// Receives the layout once it is known.
    fn attach(&mut self, layout: &RecordLayout);

    /// Receives an observation.
    fn take(&mut self, seen: &Seen<'_>);

    /// Ends the stream; `last_word` is the reason, formatted for the user.
    fn end(&mut self, last_word: &str);
}

/// Handle of the thread.
pub(crate) struct Watch {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    failures: Receiver<Failure>,
    first: Receiver<()>,
}

impl Watch {
    /// Starts watching a session, until the handle is dropped; `shows_log` requests the complete log at the end.
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
                let _ = failed.send(failure); // the handle may be gone
            }
        });
        Self {
            stop,
            thread: Some(thread),
            failures,
            first,
        }
    }

    /// Waits for the first attempt to attach.
    pub(crate) fn wait_for_first(&self) {
        let _ = self.first.recv(); // `check` reports errors
    }

    /// Reports the failure of the thread.
    ///
    /// # Errors
    /// If the session cannot be watched.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        self.failures.try_recv().map_or(Ok(()), Err)
    }

    /// Returns `true` at the end of the records.
    pub(crate) fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // the panic hook has reported a panic
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

    /// Attaches as soon as the session allows it; `None` if the session ends earlier.
    fn attach(&mut self, tried: &Sender<()>) -> Result<Option<Observer>, Failure> {
        while !self.is_over() && self.session.is_there() {
            self.find_run_dir();
            if let Some(observer) = Observer::attach(&self.session)? {
                self.model.lock().attach(observer.layout())?;
                if let Some(audience) = &mut self.audience {
                    audience.attach(observer.layout());
                }
                let _ = tried.send(()); // the waiting thread may have given up
                return Ok(Some(observer));
            }
            let _ = tried.send(());
            std::thread::sleep(BEGIN);
        }
        Ok(None)
    }

    /// Polls the stream until the run ends.
    fn look(&mut self, observer: &mut Observer) -> Result<(), Failure> {
        let mut looked = Instant::now();
        while !self.is_over() {
            // Checked before the poll, so that the poll covers everything up to then.
            let is_last = looked.elapsed() > LOOK && !self.session.is_there();
            let count = {
                let mut model = self.model.lock();
                let count = observer.look(|seen| {
                    if let Some(audience) = &mut self.audience {
                        audience.take(&seen);
                    }
                    model.take(seen);
                })?;
                if model.ending().is_some() {
                    return Ok(());
                }
                count
            };
            if count == 0 && is_last {
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

    /// Waits until `hil` has removed the session and written the summary, and stores the verdict.
    fn wait_for_summary(&self) {
        let since = Instant::now();
        let run_dir = self.find_run_dir();
        let (mut verdict, mut standings) = (None, None);
        while !self.is_over() && verdict.is_none() && since.elapsed() < END_LIMIT {
            // Checked before reading the summary. A killed `hil` writes none, and it removes the folder of a run
            // that did not begin.
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
            return; // the handle was dropped, which does not end the session
        }
        if self.shows_log {
            self.complete_log(run_dir.as_deref());
        }
        let mut model = self.model.lock();
        // The last answer predates the end.
        model.hear_standings(standings);
        if verdict.is_none() && !self.session.owner.is_alive() {
            let recording = model.run_dir.as_ref().map(|folder| folder.join(RECORDING));
            model.abandon(recording.is_some_and(|file| file.exists()));
        } else {
            model.end(verdict);
        }
    }

    /// Finds the folder of the run while the session exists: a newly created session does not name the folder yet.
    fn find_run_dir(&self) -> Option<PathBuf> {
        let run_dir = self.model.lock().run_dir.clone();
        run_dir.or_else(|| {
            let info = SessionInfo::read(&self.session.folder).ok();
            // The name may belong to another session by now.
            let info = info.filter(|info| info.id == self.session.id)?;
            self.model.lock().run_dir.clone_from(&info.run_dir);
            info.run_dir
        })
    }

    /// Completes the log from the recording if the stream has not delivered all events.
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

/// Reads the account of a recorded run, or as much of it as the time limit allows.
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
