//! The process of a side: started in a group of its own, or by hand and admitted; told the end over its input
//! or its leash, killed if it does not end by itself. Knows nothing of the run that it belongs to.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::Binary;
use shared_types::by_hand;
use shared_types::process::{Ending, MARK, ProcessId, end_group, reap};
use shared_types::program;
use shared_types::session::SessionInfo;
use signal_hook::consts::SIGKILL;

use super::log::Log;
use super::open_files;

/// Time that a process may take to end once it was told to.
pub const GRACE: Duration = Duration::from_secs(2);
/// Time that it may take if it is stopped, which it cannot end from.
const STOPPED_GRACE: Duration = Duration::from_millis(200);
/// Exit code of a Rust program that panicked.
const PANIC: i32 = by_hand::PANIC as i32;
/// Time that a process that was killed may take to be gone.
const DEATH_LIMIT: Duration = Duration::from_secs(1);

/// Side of the run.
pub struct SideProcess {
    pub name: &'static str,
    process: Process,
    id: Option<ProcessId>,
    /// Its end, where the kernel tells of it.
    ending: Option<Ending>,
    /// Folder of its session, and the call of foreign code that it ended in.
    session: Option<PathBuf>,
    call: Option<String>,
    /// Output, unless that goes to a terminal.
    log: Option<Log>,
    /// Name of the machine that it is the bridge to.
    target: Option<String>,
    status: Option<ExitStatus>,
    /// A process that is no child ended and did not say how.
    is_silent: bool,
    /// State in which the process was found, if it had to be killed.
    pub killed: Option<&'static str>,
    pub told_to_stop: bool,
}

enum Process {
    Launched(Child),
    /// Started by hand, with the connection that it came in by.
    ByHand(UnixStream),
}

impl SideProcess {
    /// Takes a process that somebody started by hand and that was admitted.
    pub fn by_hand(name: &'static str, id: ProcessId, leash: UnixStream) -> Self {
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

    /// Starts it; its output goes to a log of this name in a folder.
    ///
    /// # Errors
    /// If it cannot be started, or is not the file any more that was checked.
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
            // A group of its own: Ctrl-C is for hil, which ends both in order.
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
        // After the start: what was replaced just before it ends with the side.
        binary.refuse_changed()?;
        Ok(side)
    }

    pub fn process_id(&self) -> u32 {
        match (&self.process, self.id) {
            (Process::Launched(process), _) => process.id(),
            (Process::ByHand(_), id) => id.map_or(0, |id| id.pid),
        }
    }

    /// Returns true if the side has ended, and all that it started in its group with it; bounds its log.
    pub fn has_ended(&mut self) -> bool {
        if self.status.is_none() {
            // Without such a process there is no status to be had.
            const UNKNOWN: i32 = 0xff00;
            self.status = match (&mut self.process, self.id) {
                (Process::Launched(process), _) => {
                    reap(process).unwrap_or_else(|_| Some(ExitStatus::from_raw(UNKNOWN)))
                }
                (Process::ByHand(_), Some(id)) if id.is_alive() => None,
                (Process::ByHand(leash), _) => {
                    let code = by_hand::last_word(leash);
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

    /// Returns its end to wait for, if it is still to come.
    pub const fn ending(&self) -> Option<&Ending> {
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

    /// Forgets its output so far.
    pub(super) fn forget_output(&mut self) {
        if let Some(log) = &mut self.log {
            log.clear();
        }
    }

    /// Writes a line to its input or its leash. It may have ended, which shows elsewhere.
    pub fn tell(&mut self, line: &str) {
        let _ = match &mut self.process {
            Process::Launched(process) => match &mut process.stdin {
                Some(input) => writeln!(input, "{line}").and_then(|()| input.flush()),
                None => Ok(()),
            },
            Process::ByHand(leash) => writeln!(leash, "{line}"),
        };
    }

    /// Ends it if it had this time to end by itself, `since` it was to.
    pub(super) fn end_if_due(&mut self, since: Instant, grace: Duration) {
        let waited = since.elapsed();
        let is_due = waited > grace || waited > STOPPED_GRACE && self.is_stopped();
        if is_due && !self.has_ended() {
            self.kill();
        }
    }

    pub fn is_stopped(&self) -> bool {
        self.id.is_some_and(ProcessId::is_stopped)
    }

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
            // Its group is the terminal's, or the debugger's.
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

    /// Notes the call of foreign code that it ended in, while its session is there.
    fn note_call(&mut self) {
        if let (Some(_), Some(session)) = (self.status, &self.session) {
            self.call = program::last_call(session, self.process_id());
        }
    }

    /// Describes how the side ended, if there is something to say about it, and where to read more.
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

    /// Describes its end, if that was not in order.
    pub fn death(&self) -> Option<String> {
        let call = (self.call.as_ref()).map_or_else(String::new, |call| format!(" in {call}"));
        if let Some(state) = self.killed {
            let name = self.name;
            return Some(format!("{name} was {state}{call} and had to be killed"));
        }
        let status = self.status?;
        if self.is_silent {
            return Some(format!(
                "{}, started by hand, is gone without a word: killed, or its debugger ended",
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

    /// Returns `true` if it died by a signal or a panic, and was not killed.
    pub(super) fn has_crashed(&self) -> bool {
        let status = self.status.filter(|_| self.killed.is_none());
        status.is_some_and(|status| status.signal().is_some() || status.code() == Some(PANIC))
    }

    /// Returns the error that a bridge ended with, which says what became of the controller on its target.
    fn said_of_target(&self) -> Option<String> {
        let begin = format!("target {}: ", self.target.as_ref()?);
        self.log.as_ref()?.last_error(&begin)
    }

    /// The last line of its output, without the word `error`.
    pub fn last_word(&self) -> Option<String> {
        self.log.as_ref().and_then(Log::last_word)
    }

    /// The warnings that it wrote to its log.
    pub(super) fn warnings(&self) -> Vec<String> {
        self.log.as_ref().map(Log::warnings).unwrap_or_default()
    }

    /// The file of its output and the first and last lines of that, if there is any.
    pub(super) fn shown_log(&self) -> Option<String> {
        let log = self.log.as_ref()?;
        let excerpt = log.excerpt();
        let path = log.path().display();
        (!excerpt.is_empty()).then(|| format!("{path}:\n{excerpt}"))
    }

    /// The first and last lines of its output.
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
