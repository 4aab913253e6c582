//! Processes by number and start time, so that a later one with the same number is not taken for
//! them.
//!
//! Used by sessions and by the launcher's supervision; read from `/proc`.

use std::fs;

use rustix::process::{Pid, Signal, getpgid, kill_process, kill_process_group};
use serde::{Deserialize, Serialize};

/// A process that cannot be taken for a later one with the same number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessId {
    /// Process number.
    pub pid: u32,
    /// When it started, in clock ticks since boot.
    pub start_ticks: u64,
}

impl ProcessId {
    /// The process with this number, if there is one.
    #[must_use]
    pub fn of(pid: u32) -> Option<Self> {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The second field, the name, may hold anything; the third begins after its last `)`.
        let (_, rest) = stat.rsplit_once(')')?;
        let mut fields = rest.split_ascii_whitespace();
        let zombie = matches!(fields.next()?, "Z" | "X");
        let start_ticks = fields.nth(18)?.parse().ok()?;
        (!zombie).then_some(Self { pid, start_ticks })
    }

    /// The calling process.
    #[must_use]
    pub fn own() -> Self {
        let pid = std::process::id();
        Self::of(pid).unwrap_or(Self {
            pid,
            start_ticks: 0,
        })
    }

    /// Whether it is stopped, by a signal or a debugger.
    #[must_use]
    pub fn is_stopped(self) -> bool {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.pid)).unwrap_or_default();
        let state = stat
            .rsplit_once(") ")
            .and_then(|(_, rest)| rest.chars().next());
        self.is_alive() && matches!(state, Some('T' | 't'))
    }

    /// Whether it still runs (or is stopped).
    #[must_use]
    pub fn is_alive(self) -> bool {
        Self::of(self.pid) == Some(self)
    }

    /// Whether another process is this one or belongs to its process group, as what a launched script
    /// starts does.
    #[must_use]
    pub fn leads(self, other: u32) -> bool {
        let (Some(leader), Some(other)) = (number(self.pid), number(other)) else {
            return false;
        };
        other == leader || getpgid(Some(other)) == Ok(leader)
    }

    /// The name of the program that a process runs.
    #[must_use]
    pub fn name(pid: u32) -> Option<String> {
        let name = fs::read_to_string(format!("/proc/{pid}/comm")).ok()?;
        Some(name.trim_end().escape_debug().to_string())
    }

    /// Ends at once what is left of its process group, which it must have led.
    pub fn kill_group(self) {
        // A later process of this number may lead a group of its own; as long as any process is in the
        // old group there can be none.
        let later = Self::of(self.pid).is_some_and(|found| found != self);
        if !later && let Some(pid) = number(self.pid) {
            // There may be nobody left in it.
            let _ = kill_process_group(pid, Signal::KILL);
        }
    }

    /// Ends it at once, if it is still there.
    pub fn kill(self) {
        if self.is_alive()
            && let Some(pid) = number(self.pid)
        {
            // It may end by itself in between, which is as good.
            let _ = kill_process(pid, Signal::KILL);
        }
    }
}

/// A process number as the system calls take it.
fn number(pid: u32) -> Option<Pid> {
    i32::try_from(pid).ok().and_then(Pid::from_raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_known_by_its_start_too() {
        let own = ProcessId::own();
        assert!(own.is_alive());
        let later = ProcessId {
            start_ticks: own.start_ticks + 1,
            ..own
        };
        assert!(!later.is_alive());
    }
}
