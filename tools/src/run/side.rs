//! The process of a side: started in a group of its own, told the end over its input, killed if it does not
//! end by itself. Knows nothing of the run that it belongs to.

use std::io::Write;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use shared_types::process::{MARK, ProcessId, end_group, reap};
use shared_types::session::SessionInfo;

use super::log::Log;
use super::open_files;
use crate::programs::binaries::Binary;
use crate::terminal::exit::Failure;

/// Time that a process may take to end once it was told to.
pub(crate) const GRACE: Duration = Duration::from_secs(2);
/// Time that it may take if it is stopped, which it cannot end from.
const STOPPED_GRACE: Duration = Duration::from_millis(200);
/// Exit code of a Rust program that panicked.
const PANIC: i32 = 101;

/// Side of the run.
pub(crate) struct Side {
    pub(super) name: &'static str,
    process: Child,
    id: Option<ProcessId>,
    log: Log,
    status: Option<ExitStatus>,
    /// State in which the process was found, if it had to be killed.
    pub(super) killed: Option<&'static str>,
    pub(super) told_to_stop: bool,
}

impl Side {
    /// Starts it; its output goes to a log of this name in a folder.
    ///
    /// # Errors
    /// If it cannot be started, or is not the file any more that was checked.
    pub(crate) fn start(
        name: &'static str,
        binary: &Binary,
        session: &SessionInfo,
        folder: &Path,
        log: &str,
    ) -> Result<Self, Failure> {
        open_files::ensure()?;
        let cannot = |error: std::io::Error| {
            Failure::infrastructure(format!("cannot start {}: {error}", binary.path.display()))
        };
        let log = Log::create(folder.join(log)).map_err(cannot)?;
        let process = (binary.command(&session.folder)?)
            .stdin(Stdio::piped())
            .stdout(log.output().map_err(cannot)?)
            .stderr(log.output().map_err(cannot)?)
            .env(MARK, &session.prefix)
            // A group of its own: Ctrl-C is for hil, which ends both in order.
            .process_group(0)
            .spawn()
            .map_err(cannot)?;
        let id = ProcessId::of(process.id());
        let side = Self {
            name,
            process,
            id,
            log,
            status: None,
            killed: None,
            told_to_stop: false,
        };
        // After the start: what was replaced just before it ends with the side.
        binary.refuse_changed()?;
        Ok(side)
    }

    pub(crate) fn process_id(&self) -> u32 {
        self.process.id()
    }

    /// Returns true if the side has ended, and all that it started in its group with it; bounds its log.
    pub(crate) fn has_ended(&mut self) -> bool {
        if self.status.is_none() {
            // An error here means that there is no such process, which is an end too.
            self.status = match reap(&mut self.process) {
                Ok(status) => status,
                Err(_) => Some(ExitStatus::from_raw(0xff00)),
            };
            self.log.bound();
        }
        self.status.is_some()
    }

    /// Forgets its output so far.
    pub(super) fn forget_output(&mut self) {
        self.log.clear();
    }

    /// Writes a line to its input. It may have ended, which shows elsewhere.
    pub(super) fn tell(&mut self, line: &str) {
        if let Some(input) = &mut self.process.stdin {
            let _ = writeln!(input, "{line}").and_then(|()| input.flush());
        }
    }

    /// Ends it if it had its time to end by itself, `since` it was to.
    pub(super) fn end_if_due(&mut self, since: Instant) {
        let waited = since.elapsed();
        let is_due = waited > GRACE || waited > STOPPED_GRACE && self.is_stopped();
        if is_due && !self.has_ended() {
            self.kill();
        }
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.id.is_some_and(ProcessId::is_stopped)
    }

    pub(crate) fn kill(&mut self) {
        self.killed = Some(if self.is_stopped() {
            "stopped"
        } else {
            "stuck"
        });
        end_group(&self.process);
        self.status = self.process.wait().ok();
        self.log.bound();
    }

    /// Describes how the side ended, if there is something to say about it, and where to read more.
    pub(super) fn fate(&self) -> Option<String> {
        let death = self.death()?;
        let panicked = self.status.and_then(|status| status.code()) == Some(PANIC);
        Some(if panicked && self.killed.is_none() {
            format!("{death}, see {}", self.log.path().display())
        } else {
            death
        })
    }

    /// Describes its end, if that was not in order.
    pub(crate) fn death(&self) -> Option<String> {
        if let Some(state) = self.killed {
            return Some(format!("{} was {state} and had to be killed", self.name));
        }
        let status = self.status?;
        match (status.code(), status.signal()) {
            (Some(0), _) => None,
            (Some(PANIC), _) => Some(format!("{} panicked", self.name)),
            (Some(code), _) => Some(format!("{} ended with exit code {code}", self.name)),
            (None, Some(signal)) => {
                let name = signal_hook::low_level::signal_name(signal).unwrap_or("a signal");
                Some(format!("{} was killed by {name} ({signal})", self.name))
            }
            (None, None) => None,
        }
    }

    /// The last line of its output, without the word `error`.
    pub(super) fn last_word(&self) -> Option<String> {
        self.log.last_word()
    }

    /// The file of its output.
    pub(super) fn log_path(&self) -> &Path {
        self.log.path()
    }

    /// The first and last lines of its output.
    pub(crate) fn excerpt(&self) -> String {
        self.log.excerpt()
    }
}

impl Drop for Side {
    fn drop(&mut self) {
        if !self.has_ended() {
            self.kill();
        }
    }
}
