//! Branches of a run: new runs that repeat it up to a step and are held there, each with a panel of its own.
//!
//! Used by the pages of a session and of a recorded run. A [`Trunk`] is the run; [`launch`] starts a branch and
//! compares it with the trunk. At most one branch is alive at a time, and it ends with this panel.

mod launch;

use std::path::PathBuf;
use std::process::Child;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;
use serde_json::{Value, json};
use shared_types::time::Step;

/// Time limit for a branch to end after its panel.
const END_LIMIT: Duration = Duration::from_secs(8);
/// Polling interval for the end of a branch.
const LOOK: Duration = Duration::from_millis(20);
/// Maximum number of branches that are listed.
const MOST: usize = 20;

/// Run from which branches start.
#[derive(Clone, Debug)]
pub(crate) struct Trunk {
    /// Folder or recording of the run; `None` if the run is not recorded.
    pub recording: Option<PathBuf>,
    /// `true` while the recording is being written; its checkpoints do not exist yet.
    pub is_live: bool,
}

/// Progress of a branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum State {
    /// Being started, or repeating the steps before its own.
    Starting,
    /// Held at its step, with the bits of its trunk.
    Held,
    /// Not possible.
    Refused,
    /// Over.
    Ended,
}

/// Branch as described to pages.
#[derive(Clone, Debug, Serialize)]
struct Branch {
    step: u64,
    state: State,
    /// Progress, or reason of a refusal.
    text: String,
    /// Folder of the new run.
    folder: Option<String>,
    /// Session of the new run while it is alive.
    session: Option<String>,
    /// Command line that starts the same branch.
    command: Option<String>,
    /// Address of its panel.
    panel: Option<String>,
}

/// Branches that were started from a panel.
pub(crate) struct Branches {
    trunk: Trunk,
    shared: Mutex<Shared>,
}

#[derive(Default)]
struct Shared {
    /// Counter of changes.
    edition: u32,
    list: Vec<Branch>,
    /// `true` from the request to the end of the branch.
    is_busy: bool,
    child: Option<Child>,
    is_over: bool,
}

impl Branches {
    pub(crate) fn of(trunk: Trunk) -> Arc<Self> {
        Arc::new(Self {
            trunk,
            shared: Mutex::default(),
        })
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts a branch in the background; a refusal is listed like a branch.
    pub(super) fn start(self: &Arc<Self>, step: Step) {
        let mut shared = self.shared();
        if shared.is_over {
            return;
        }
        if shared.list.len() >= MOST {
            shared.list.remove(0);
        }
        let is_busy = std::mem::replace(&mut shared.is_busy, true);
        let (state, text) = match is_busy {
            true => (
                State::Refused,
                "another branch of this panel is alive; end it first",
            ),
            false => (State::Starting, "reads the recording"),
        };
        let branch = Branch {
            step: step.0,
            state,
            text: text.into(),
            folder: None,
            session: None,
            command: None,
            panel: None,
        };
        shared.list.push(branch);
        shared.edition += 1;
        drop(shared);
        if !is_busy {
            let branches = Arc::clone(self);
            std::thread::spawn(move || branches.work(step));
        }
    }

    /// Starts a branch, waits for its end and keeps its entry up to date.
    fn work(&self, step: Step) {
        match launch::launch(self, step) {
            Ok(text) => {
                self.note(|branch| (branch.state, branch.text) = (State::Held, text));
                self.wait_for_end();
                self.note(|branch| {
                    (branch.state, branch.text) = (State::Ended, "ended".into());
                    (branch.panel, branch.session) = (None, None);
                });
            }
            Err(reason) => {
                self.interrupt();
                self.note(|branch| {
                    (branch.state, branch.text) = (State::Refused, reason);
                    (branch.panel, branch.session) = (None, None);
                });
            }
        }
        self.shared().is_busy = false;
    }

    /// Changes the entry of the branch that is alive.
    fn note(&self, change: impl FnOnce(&mut Branch)) {
        let mut shared = self.shared();
        let alive = |branch: &&mut Branch| matches!(branch.state, State::Starting | State::Held);
        if let Some(branch) = shared.list.iter_mut().find(alive) {
            change(branch);
            shared.edition += 1;
        }
    }

    /// Keeps the process of the branch; returns `false` if the panel has ended meanwhile.
    fn keep(&self, child: Child) -> bool {
        let mut shared = self.shared();
        shared.child = Some(child);
        !shared.is_over
    }

    /// Returns `true` if the process of the branch has ended, or never started.
    fn has_ended(&self) -> bool {
        let mut shared = self.shared();
        let child = shared.child.as_mut();
        child.is_none_or(|child| !matches!(child.try_wait(), Ok(None)))
    }

    fn wait_for_end(&self) {
        while !self.has_ended() {
            std::thread::sleep(LOOK);
        }
        self.shared().child = None;
    }

    /// Interrupts the branch that is alive as a terminal does, and kills it if it does not end.
    fn interrupt(&self) {
        if let Some(child) = &self.shared().child {
            let _ = kill_process(Pid::from_child(child), Signal::INT); // it may have ended
        }
        let since = Instant::now();
        while !self.has_ended() && since.elapsed() < END_LIMIT {
            std::thread::sleep(LOOK);
        }
        if let Some(mut child) = self.shared().child.take() {
            let _ = child.kill(); // as above
            let _ = child.wait();
        }
    }

    /// Ends the branch that is alive, and starts no other.
    pub(super) fn end(&self) {
        self.shared().is_over = true;
        self.interrupt();
    }

    /// Returns `true` while a branch is alive.
    pub(super) fn is_busy(&self) -> bool {
        self.shared().is_busy
    }

    /// Describes all branches to a page that has seen an earlier edition; `None` if nothing has changed.
    pub(super) fn news(&self, seen: &mut u32) -> Option<Value> {
        let shared = self.shared();
        let is_new = *seen != shared.edition;
        *seen = shared.edition;
        is_new.then(|| json!({ "tell": "branches", "branches": shared.list }))
    }
}
