//! Process of a side: started in its own process group, or started by hand and admitted; told to end through its input
//! or its connection, and killed if it does not end by itself. Independent of the run to which it belongs.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::Binary;
use hil_session::manual_start;
use hil_session::process::{Ending, MARK, ProcessId, end_group, reap};
use hil_session::program;
use hil_session::session::SessionInfo;
use signal_hook::consts::SIGKILL;

use super::log::Log;
use super::open_files;

/// Polling interval for a process that is about to answer or end.
pub const LOOK: Duration = Duration::from_millis(2);
/// Time limit for a process to end after the request to end.
pub const GRACE: Duration = Duration::from_secs(2);
/// Time limit for a stopped process, which cannot end by itself.
const STOPPED_GRACE: Duration = Duration::from_millis(200);
/// Exit code of a Rust program that panicked.
const PANIC: i32 = manual_start::PANIC as i32;
/// Time limit for a killed process to disappear.
const DEATH_LIMIT: Duration = Duration::from_secs(1);

/// Side of the run.
pub struct SideProcess {
    /// Name of the side in messages.
    pub name: &'static str,
    process: Process,
    id: Option<ProcessId>,
    /// Pending end, if the kernel reports it.
    ending: Option<Ending>,
    /// Folder of the process's session, and the call of foreign code in which it ended.
    session: Option<PathBuf>,
    call: Option<String>,
    /// Output, unless it goes to a terminal.
    log: Option<Log>,
    /// Name of the machine to which this process is the bridge.
    target: Option<String>,
    status: Option<ExitStatus>,
    /// `true` if a process that is not a child ended without reporting how.
    is_silent: bool,
    /// State in which the process was found, if it had to be killed.
    pub killed: Option<&'static str>,
    /// `true` once the process was asked to stop.
    pub told_to_stop: bool,
}

enum Process {
    Launched(Child),
    /// Started by hand, with its connection.
    ByHand(UnixStream),
}

impl SideProcess {
    /// Wraps a process that was started by hand and admitted.
    pub(crate) fn by_hand(name: &'static str, id: ProcessId, leash: UnixStream) -> Self {
        Self {
            name,
            process: Process::ByHand(leash),
            id: Some(id),
            ending: Ending::of(id),
            session: None,
            call: None,
            log: None,
            target: None,
            status: None,
            is_silent: false,
            killed: None,
            told_to_stop: false,
        }
    }

    /// Starts a process whose output goes to a log of this name in a folder.
    ///
    /// # Errors
    /// If the process cannot be started, or its file has changed since the check.
    pub fn start(
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
            // In its own process group: Ctrl-C is for hil, which ends both sides in order.
            .process_group(0)
            .spawn()
            .map_err(cannot)?;
        let id = ProcessId::of(process.id());
        let side = Self {
            name,
            process: Process::Launched(process),
            id,
            ending: id.and_then(Ending::of),
            session: Some(session.folder.clone()),
            call: None,
            log: Some(log),
            target: binary.at.as_ref().map(|at| at.target().to_string()),
            status: None,
            is_silent: false,
            killed: None,
            told_to_stop: false,
        };
        // After the start: a file replaced just before it ends with the side.
        binary.refuse_changed()?;
        Ok(side)
    }

    /// Returns the process id.
    pub fn process_id(&self) -> u32 {
        match (&self.process, self.id) {
            (Process::Launched(process), _) => process.id(),
            (Process::ByHand(_), id) => id.map_or(0, |id| id.pid),
        }
    }

    /// Returns `true` if the side and its whole process group have ended; limits its log.
    pub fn has_ended(&mut self) -> bool {
        if self.status.is_none() {
            // Without such a process there is no exit status.
            const UNKNOWN: i32 = 0xff00;
            self.status = match (&mut self.process, self.id) {
                (Process::Launched(process), _) => {
                    reap(process).unwrap_or_else(|_| Some(ExitStatus::from_raw(UNKNOWN)))
                }
                (Process::ByHand(_), Some(id)) if id.is_alive() => None,
                (Process::ByHand(leash), _) => {
                    let code = manual_start::last_word(leash);
                    self.is_silent = code.is_none();
                    let status = code.map_or(UNKNOWN, |code| i32::from(code) << 8);
                    Some(ExitStatus::from_raw(status))
                }
            };
            self.bound_log();
            self.note_call();
        }
        self.status.is_some()
    }

    /// Returns the pending end, to wait for.
    pub(crate) const fn ending(&self) -> Option<&Ending> {
        match self.status {
            None => self.ending.as_ref(),
            Some(_) => None,
        }
    }

    fn bound_log(&mut self) {
        if let Some(log) = &mut self.log {
            log.bound();
        }
    }

    /// Discards the output so far.
    pub(super) fn forget_output(&mut self) {
        if let Some(log) = &mut self.log {
            log.clear();
        }
    }

    /// Writes a line to the process's input or connection. The process may have ended, which is noticed elsewhere.
    pub fn tell(&mut self, line: &str) {
        let _ = match &mut self.process {
            Process::Launched(process) => match &mut process.stdin {
                Some(input) => writeln!(input, "{line}").and_then(|()| input.flush()),
                None => Ok(()),
            },
            Process::ByHand(leash) => writeln!(leash, "{line}"),
        };
    }

    /// Ends the process if its grace period, which began at `since`, is over.
    pub(super) fn end_if_due(&mut self, since: Instant, grace: Duration) {
        let waited = since.elapsed();
        let is_due = waited > grace || waited > STOPPED_GRACE && self.is_stopped();
        if is_due && !self.has_ended() {
            self.kill();
        }
    }

    /// Returns `true` if a signal has stopped the process.
    pub(crate) fn is_stopped(&self) -> bool {
        self.id.is_some_and(ProcessId::is_stopped)
    }

    /// Kills the process.
    pub fn kill(&mut self) {
        self.killed = Some(if self.is_stopped() {
            "stopped"
        } else {
            "stuck"
        });
        match &mut self.process {
            Process::Launched(process) => {
                end_group(process);
                self.status = process.wait().ok();
            }
            // Its process group is the terminal's, or the debugger's.
            Process::ByHand(_) => {
                let since = Instant::now();
                while let Some(id) = self.id.filter(|id| id.is_alive())
                    && since.elapsed() < DEATH_LIMIT
                {
                    id.kill();
                    std::thread::sleep(Duration::from_millis(2));
                }
                self.status = Some(ExitStatus::from_raw(SIGKILL));
            }
        }
        self.bound_log();
        self.note_call();
    }

    /// Notes the call of foreign code in which the process ended, while its session exists.
    fn note_call(&mut self) {
        if let (Some(_), Some(session)) = (self.status, &self.session) {
            self.call = program::last_call(session, self.process_id());
        }
    }

    /// Describes how the side ended, if notable, and where to read more.
    pub(super) fn fate(&self) -> Option<String> {
        let death = self.death()?;
        let panicked = self.status.and_then(|status| status.code()) == Some(PANIC);
        Some(match &self.log {
            Some(log) if panicked && self.killed.is_none() => {
                format!("{death}, see {}", log.path().display())
            }
            _ => death,
        })
    }

    /// Describes the end of the process, if abnormal.
    pub fn death(&self) -> Option<String> {
        let call = (self.call.as_ref()).map_or_else(String::new, |call| format!(" in {call}"));
        if let Some(state) = self.killed {
            let name = self.name;
            return Some(format!("{name} was {state}{call} and had to be killed"));
        }
        let status = self.status?;
        if self.is_silent {
            return Some(format!(
                "{}, which was started by hand, ended without reporting why: it was killed, or its debugger ended",
                self.name
            ));
        }
        match (status.code(), status.signal()) {
            (Some(0), _) => None,
            (Some(PANIC), _) => Some(format!("{} panicked", self.name)),
            (Some(code), _) => Some(
                (self.said_of_target())
                    .unwrap_or_else(|| format!("{} ended with exit code {code}", self.name)),
            ),
            (None, Some(signal)) => {
                let name = signal_hook::low_level::signal_name(signal).unwrap_or("a signal");
                // Other signals name the call themselves, as the last word of the log.
                let call = if signal == SIGKILL { &*call } else { "" };
                Some(format!(
                    "{} was killed by {name} ({signal}){call}",
                    self.name
                ))
            }
            (None, None) => None,
        }
    }

    /// Returns `true` if the process died by a signal or a panic, and was not killed by hil.
    pub(super) fn has_crashed(&self) -> bool {
        let status = self.status.filter(|_| self.killed.is_none());
        status.is_some_and(|status| status.signal().is_some() || status.code() == Some(PANIC))
    }

    /// Returns the error with which a bridge ended, which describes the fate of the controller on its target.
    fn said_of_target(&self) -> Option<String> {
        let begin = format!("target {}: ", self.target.as_ref()?);
        self.log.as_ref()?.last_error(&begin)
    }

    /// Returns the last line of the output, without the prefix `error`.
    pub(crate) fn last_word(&self) -> Option<String> {
        self.log.as_ref().and_then(Log::last_word)
    }

    /// Returns the warnings in its log.
    pub(super) fn warnings(&self) -> Vec<String> {
        self.log.as_ref().map(Log::warnings).unwrap_or_default()
    }

    /// Returns the path of the log with its first and last lines, if there are any.
    pub(super) fn shown_log(&self) -> Option<String> {
        let log = self.log.as_ref()?;
        let excerpt = log.excerpt();
        let path = log.path().display();
        (!excerpt.is_empty()).then(|| format!("{path}:\n{excerpt}"))
    }

    /// Returns the first and last lines of the output.
    pub fn excerpt(&self) -> String {
        self.log.as_ref().map(Log::excerpt).unwrap_or_default()
    }
}

impl Drop for SideProcess {
    fn drop(&mut self) {
        if !self.has_ended() {
            self.kill();
        }
    }
}
