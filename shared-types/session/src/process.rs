//! Processes identified by number and start time, so that a later process with the same number is not mistaken for an
//! earlier one.
//!
//! Used by sessions and by the launcher's supervision; read from `/proc`.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt;
use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{
    Pid, PidfdFlags, Signal, WaitId, WaitIdOptions, getpgid, kill_process, kill_process_group,
    pidfd_open, pidfd_send_signal, waitid,
};
use rustix::time::Timespec;
use serde::{Deserialize, Serialize};

/// Environment variable inherited by every descendant of a launched process, by which all of them can be found.
pub const MARK: &str = "HIL_STARTED_FOR";
/// Attempts to read the environment of a process that momentarily has none.
const LOOKS: u32 = 5;
/// Time limit for killed processes to disappear.
const DEATH_LIMIT: Duration = Duration::from_secs(1);

/// Process identity that no later process with the same number shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessId {
    /// Process number.
    pub pid: u32,
    /// Start time in clock ticks since boot.
    pub start_ticks: u64,
}

impl ProcessId {
    /// Returns the process with this number, if it exists.
    #[must_use]
    pub fn of(pid: u32) -> Option<Self> {
        Self::found(pid).map(|(id, _)| id)
    }

    /// Returns the process with this number and its state letter, if the process exists and has not ended.
    fn found(pid: u32) -> Option<(Self, char)> {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The second field, the name, may contain anything; the third begins after the last `)`.
        let (_, rest) = stat.rsplit_once(')')?;
        let mut fields = rest.split_ascii_whitespace();
        let state = fields.next()?.chars().next()?;
        let start_ticks = fields.nth(18)?.parse().ok()?;
        let has_ended = matches!(state, 'Z' | 'X');
        (!has_ended).then_some((Self { pid, start_ticks }, state))
    }

    /// Returns the calling process.
    #[must_use]
    pub fn own() -> Self {
        let pid = std::process::id();
        Self::of(pid).unwrap_or(Self {
            pid,
            start_ticks: 0,
        })
    }

    /// Returns `true` if the process is stopped, by a signal or a debugger.
    #[must_use]
    pub fn is_stopped(self) -> bool {
        Self::found(self.pid).is_some_and(|(id, state)| id == self && matches!(state, 'T' | 't'))
    }

    /// Returns `true` if the process is running or stopped.
    #[must_use]
    pub fn is_alive(self) -> bool {
        Self::of(self.pid) == Some(self)
    }

    /// Returns `true` if another process is this one or belongs to its process group, for example a child of a launched
    /// script.
    #[must_use]
    pub fn leads(self, other: u32) -> bool {
        let (Some(leader), Some(other)) = (number(self.pid), number(other)) else {
            return false;
        };
        other == leader || getpgid(Some(other)) == Ok(leader)
    }

    /// Returns the name of the program that a process runs.
    #[must_use]
    pub fn name(pid: u32) -> Option<String> {
        let name = fs::read_to_string(format!("/proc/{pid}/comm")).ok()?;
        Some(name.trim_end().escape_debug().to_string())
    }

    /// Kills the rest of its process group, which the process must have led.
    pub fn kill_group(self) {
        // A later process of this number may lead a group of its own, but not while the old group has a member.
        let later = Self::of(self.pid).is_some_and(|process| process != self);
        if !later && let Some(pid) = number(self.pid) {
            // The group may be empty.
            let _ = kill_process_group(pid, Signal::KILL);
        }
    }

    /// Kills the process, if it still exists.
    pub fn kill(self) {
        if self.is_alive()
            && let Some(pid) = number(self.pid)
        {
            // It may end by itself in the meantime, which is just as well.
            let _ = kill_process(pid, Signal::KILL);
        }
    }
}

/// Handle for awaiting the end of a process without reaping it.
#[derive(Debug)]
pub struct Ending(OwnedFd);

impl Ending {
    /// Opens a handle to this process; `None` if it has ended, or the kernel lacks process descriptors.
    #[must_use]
    pub fn of(id: ProcessId) -> Option<Self> {
        let descriptor = pidfd_open(number(id.pid)?, PidfdFlags::empty()).ok()?;
        // Checked after opening, it cannot be a later process of that number.
        id.is_alive().then_some(Self(descriptor))
    }

    /// Waits until one of these processes has ended, or until the limit; returns `true` if one has ended.
    pub fn wait_for_any<'a>(endings: impl IntoIterator<Item = &'a Self>, limit: Duration) -> bool {
        let mut ends: Vec<PollFd<'_>> = (endings.into_iter())
            .map(|Self(descriptor)| PollFd::new(descriptor, PollFlags::IN))
            .collect();
        let limit = Timespec::try_from(limit).unwrap_or_default();
        // A signal means the same as the limit: check again.
        poll(&mut ends, Some(&limit)).is_ok_and(|ended| ended > 0)
    }
}

/// Kills a child that was started as the leader of its own group, with all its descendants in that group.
pub fn end_group(child: &Child) {
    // The group may be empty.
    let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
}

/// Returns the status of a child that has ended. The rest of its group is killed before the child is reaped, because
/// its number may be reused afterwards.
///
/// # Errors
/// If there is no such child.
pub fn reap(child: &mut Child) -> io::Result<Option<ExitStatus>> {
    let ended = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    if waitid(WaitId::Pid(Pid::from_child(child)), ended)?.is_none() {
        return Ok(None);
    }
    end_group(child);
    child.try_wait()
}

/// Kills every process of this user with this value of [`MARK`], including orphans in a group or session of their own,
/// and waits until they are gone.
pub fn end_marked(value: &str) {
    let line = format!("{MARK}={value}");
    let since = Instant::now();
    // Repeated until none is found: one may have started another just before its end.
    while kill_those_with(line.as_bytes()) > 0 && since.elapsed() < DEATH_LIMIT {
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Kills the processes with this line in their environment and returns their number.
fn kill_those_with(line: &[u8]) -> usize {
    let uid = rustix::process::geteuid().as_raw();
    let own = std::process::id();
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut count = 0;
    for process in processes {
        let pid: Option<u32> = process
            .file_name()
            .to_str()
            .and_then(|name| name.parse().ok());
        let is_own = process.metadata().is_ok_and(|process| process.uid() == uid);
        let Some(pid) = pid.filter(|pid| is_own && *pid != own) else {
            continue;
        };
        if !has_in_environment(pid, line) {
            continue;
        }
        // Held by its descriptor and checked once more, it cannot be a later process of that number.
        let descriptor = number(pid).and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok());
        if let Some(descriptor) = descriptor
            && has_in_environment(pid, line)
        {
            count += 1;
            let _ = pidfd_send_signal(descriptor, Signal::KILL); // it may have ended just now
        }
    }
    count
}

fn has_in_environment(pid: u32, line: &[u8]) -> bool {
    let read = || fs::read(format!("/proc/{pid}/environ"));
    let mut environment = read();
    // During `exec` a process has no environment for a moment.
    for _ in 0..LOOKS {
        if !(environment.as_ref()).is_ok_and(|content| content.is_empty() && becomes_another(pid)) {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
        environment = read();
    }
    let environment = environment.unwrap_or_default();
    environment.split(|byte| *byte == 0).any(|one| one == line)
}

/// Returns `true` if a process without an environment may still get one: a process that has not ended and is no kernel
/// thread.
fn becomes_another(pid: u32) -> bool {
    let is_program = fs::read_link(format!("/proc/{pid}/exe")).is_ok();
    is_program && ProcessId::of(pid).is_some()
}

/// Converts a process number for system calls.
fn number(pid: u32) -> Option<Pid> {
    i32::try_from(pid).ok().and_then(Pid::from_raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_process_ends_the_wait() {
        const LONG: Duration = Duration::from_secs(60);
        let start = || {
            let mut sleeper = std::process::Command::new("sleep");
            let child = sleeper.arg("600").spawn().expect("starts");
            let id = ProcessId::of(child.id()).expect("a process");
            (child, id, Ending::of(id).expect("its end"))
        };
        let ((mut first, id, end), (mut second, _, other)) = (start(), start());
        assert!(!Ending::wait_for_any(
            [&end, &other],
            Duration::from_millis(5)
        ));
        first.kill().expect("it lives");
        assert!(Ending::wait_for_any([&other, &end], LONG));
        assert!(!id.is_alive() && !id.is_stopped());
        assert!(Ending::of(id).is_none(), "it has ended");
        let status = reap(&mut first).expect("a child");
        assert!(status.is_some(), "it was not reaped");
        second.kill().expect("it lives");
        second.wait().expect("it is reaped");
    }

    #[test]
    fn a_process_is_identified_by_its_start_time_too() {
        let own = ProcessId::own();
        assert!(own.is_alive());
        let later = ProcessId {
            start_ticks: own.start_ticks + 1,
            ..own
        };
        assert!(!later.is_alive());
    }
}
