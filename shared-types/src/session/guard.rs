//! Guard of a process that owns sessions: its parent, whose death it does not survive.

use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::SessionInfo;
use super::all::is_live;
use crate::process::ProcessId;

/// Guard of this process.
static GUARD: OnceLock<ProcessId> = OnceLock::new();
/// Time that an owner may take to be gone after its guard.
const DEATH_LIMIT: Duration = Duration::from_secs(5);
/// Time between two looks at an owner that is about to be gone.
const LOOK: Duration = Duration::from_millis(2);

/// Names the guard of this process; the sessions that it makes from now on note it.
pub fn is(guard: ProcessId) {
    let _ = GUARD.set(guard); // the first one stands: a process has one parent
}

/// Returns the guard of this process, if it has one.
pub(super) fn own() -> Option<ProcessId> {
    GUARD.get().copied()
}

/// Waits for the end of an owner whose guard is dead, which the kernel ends at about the same time; returns `true`
/// if the session is dead then.
pub(super) fn dies(folder: &Path) -> bool {
    let guard = SessionInfo::read(folder).ok().and_then(|info| info.guard);
    if guard.is_none_or(ProcessId::is_alive) {
        return false;
    }
    let since = Instant::now();
    while is_live(folder) && since.elapsed() < DEATH_LIMIT {
        std::thread::sleep(LOOK);
    }
    !is_live(folder)
}

#[cfg(test)]
mod tests {
    use rustix::fs::{FlockOperation, flock};

    use super::super::{Session, sweep};
    use super::*;

    #[test]
    fn a_sweep_waits_for_an_owner_whose_guard_is_dead() {
        let session = Session::of_one_process(None).expect("a session");
        let mut info = session.info().clone();
        info.guard = Some(ProcessId {
            start_ticks: 0, // no process starts with the machine
            ..ProcessId::own()
        });
        info.write_file("session.json", &info).expect("writes");
        let folder = info.folder.clone();
        // Long enough for the sweep to find it alive; a longer or shorter time changes no result.
        let dies = std::thread::spawn(move || {
            std::thread::sleep(50 * LOOK);
            flock(&session._lock, FlockOperation::Unlock).expect("unlocks");
            session
        });
        sweep().expect("sweeps");
        assert!(!folder.exists());
        drop(dies.join());
    }
}
