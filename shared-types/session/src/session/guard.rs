//! Guard of a process that owns sessions: the parent whose death ends the process.

use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::{SessionInfo, is_live};
use crate::process::ProcessId;

/// Guard of this process.
static GUARD: OnceLock<ProcessId> = OnceLock::new();
/// Time limit for an owner to end after its guard.
const DEATH_LIMIT: Duration = Duration::from_secs(5);
/// Polling interval for an owner that is about to end.
const LOOK: Duration = Duration::from_millis(2);

/// Sets the guard of this process, which all sessions created from now on record.
pub fn is(guard: ProcessId) {
    let _ = GUARD.set(guard); // the first one stands: a process has one parent
}

/// Returns the guard of this process, if it has one.
#[must_use]
pub fn own() -> Option<ProcessId> {
    GUARD.get().copied()
}

/// Waits for the end of an owner whose guard is dead and which the kernel ends at about the same time; returns `true`
/// if the session is then dead. If the guard itself calls this function, it also waits for the end of a process that
/// the dead owner was just starting: until that process executes another program, it holds the owner's lock.
pub(super) fn dies(folder: &Path) -> bool {
    let Ok(info) = SessionInfo::read(folder) else {
        return false;
    };
    let is_ending = match info.guard {
        None => false,
        Some(guard) if guard == ProcessId::own() => !info.owner.is_alive(),
        Some(guard) => !guard.is_alive(),
    };
    if !is_ending {
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

    /// Sweeps a session with this owner and guard while its lock is still held for a moment.
    fn sweep_removes(owner: ProcessId, guard: ProcessId) -> bool {
        let session = Session::of_one_process(None).expect("a session");
        let mut info = session.info().clone();
        (info.owner, info.guard) = (owner, Some(guard));
        info.write_file("session.json", &info).expect("writes");
        let folder = info.folder.clone();
        // Long enough for the sweep to find it alive; a longer or shorter time changes no result.
        let dies = std::thread::spawn(move || {
            std::thread::sleep(50 * LOOK);
            flock(&session._lock, FlockOperation::Unlock).expect("unlocks");
            session
        });
        sweep().expect("sweeps");
        let is_removed = !folder.exists();
        drop(dies.join());
        is_removed
    }

    #[test]
    fn a_sweep_waits_for_a_dying_owner() {
        let own = ProcessId::own();
        let dead = ProcessId {
            start_ticks: 0, // no process starts with the machine
            ..own
        };
        assert!(sweep_removes(own, dead), "killed with its guard");
        assert!(sweep_removes(dead, own), "killed while it starts a process");
    }
}
