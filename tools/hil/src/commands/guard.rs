//! Guard of a run: a small process that maps no shared memory, restarts `hil` as its child, and reports the outcome of
//! the run if the child is killed.
//!
//! A plant or controller can corrupt the memory that it shares with `hil`, so that a library ends the process by a
//! signal that it cannot survive; the kernel also kills the process when memory runs out. The guard survives both:
//!
//! 1. It forwards the signals it receives and stops with its child, so that terminals, shells and scripts see one
//!    process. Descriptors, process group and arguments are the same; the exit code is the child's.
//! 2. The child notes each run that it begins in a [list](begun) shared with the guard.
//! 3. If a signal ends the child, the guard ends both sides, removes the session and writes the missing summaries;
//!    it also writes summaries if the child gave up, for example after a panic of its recorder.
//! 4. If a signal ends the guard, the kernel kills the child, whose sides end when their input closes.

use std::ffi::c_int;
use std::fs::File;
use std::io;
use std::os::unix::process::{CommandExt, ExitStatusExt, parent_id};
use std::path::Path;
use std::process::{Child, ExitCode, ExitStatus};

use hil_campaign::arguments::CampaignAction;
use hil_console::files::begun;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::results::lost::{self, End};
use hil_session::process::ProcessId;
use hil_session::session;
use hil_verification::suite;
use nix::sys::signal::Signal;
use rustix::fs::{MemfdFlags, OFlags, fcntl_setfl, memfd_create};
use rustix::process::{Pid, kill_process, set_parent_process_death_signal};
use rustix::thread::set_name;
use serde_json::json;
use signal_hook::consts::{SIGABRT, SIGBUS, SIGKILL, SIGSEGV};
use signal_hook::low_level::signal_name;

use hil_recording::reader::RECORDING;

use crate::arguments::Command;
use signals::Signals;

mod handover;
mod signals;

/// Environment variable of a guarded process: the process ID of its guard.
const GUARD: &str = "HIL_GUARD";
/// Signals that end a run in an orderly way.
const INTERRUPTIONS: [Signal; 3] = [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP];

/// Returns `true` if a command maps shared memory that a user's program can write to.
///
/// Workers of a campaign already are children, and commands that only watch a session own nothing that they could leave
/// behind.
pub(super) fn is_needed(command: &Command) -> bool {
    let link = match command {
        Command::Run(arguments) => arguments.options.link,
        Command::Rerun(arguments) => arguments.options.link,
        Command::Replay(arguments) => arguments.link,
        Command::Campaign(arguments) => match &arguments.action {
            CampaignAction::Case(case) if !case.show && !case.in_process => LinkKind::Iceoryx2,
            _ => return false,
        },
        _ => return false,
    };
    link == LinkKind::Iceoryx2
}

/// Returns `true` if this process has a guard, and makes the kernel kill the process when the guard dies.
pub(super) fn is_there() -> bool {
    let Ok(guard) = std::env::var(GUARD) else {
        return false;
    };
    // Programs of a run inherit the variable and may start another `hil`; the message reaches one process alone.
    let Some(list) = handover::receive(&guard) else {
        return false;
    };
    begun::write_to(list);
    signals::release();
    let _ = set_name(c"hil"); // started as `/proc/self/exe`, it would show as `exe` in `ps` and the kernel's log
    let _ = set_parent_process_death_signal(Some(rustix::process::Signal::KILL)); // supported by every kernel
    let parent = parent_id();
    if guard != parent.to_string() {
        std::process::exit(Exit::Infrastructure as i32); // the guard died before
    }
    if let Some(guard) = ProcessId::of(parent) {
        session::guard::is(guard);
    }
    true
}

/// Executes a command in a child of this process.
pub(super) fn run(command: &Command) -> ExitCode {
    match Guard::start() {
        Ok(guard) => guard.guard(command),
        Err(error) => {
            let failure = Failure::infrastructure(format!("cannot start hil again: {error}"));
            output::tell(&failure.to_string());
            failure.exit().into()
        }
    }
}

struct Guard {
    signals: Signals,
    list: File,
    child: Child,
    /// Signals forwarded to the child.
    passed_on: Vec<Signal>,
}

impl Guard {
    fn start() -> io::Result<Self> {
        // Registered before the start, so that none is lost.
        let signals = Signals::hold()?;
        let list = File::from(memfd_create("hil-begun", MemfdFlags::CLOEXEC)?);
        fcntl_setfl(&list, OFlags::APPEND)?;
        let mut words = std::env::args_os();
        // Not by its path, which may name another file by now.
        let mut hil = std::process::Command::new("/proc/self/exe");
        hil.arg0(words.next().unwrap_or_else(|| "hil".into()));
        hil.args(words);
        let own = std::process::id().to_string();
        hil.stdin(handover::send(&own, &list)?).env(GUARD, own);
        Ok(Self {
            signals,
            list,
            child: hil.spawn()?,
            passed_on: Vec::new(),
        })
    }

    fn guard(mut self, command: &Command) -> ExitCode {
        let status = match self.wait() {
            Ok(status) => status,
            Err(error) => {
                let failure = Failure::infrastructure(error);
                output::tell(&failure.to_string());
                return failure.exit().into();
            }
        };
        let Some(signal) = status.signal() else {
            // A child that did not exit was ended by a signal.
            let code = status.code().and_then(|code| u8::try_from(code).ok());
            let code = code.unwrap_or(Exit::Infrastructure as u8);
            if code != Exit::Pass as u8 {
                let reason = format!(
                    "hil ended with exit code {code} before the run had a summary; standard error has the cause"
                );
                self.summarise(&reason, End::Exit);
            }
            return code.into();
        };
        if let Err(error) = session::sweep() {
            tell!("error: {error}");
        }
        let cause = Signal::try_from(signal).ok();
        let interruption = INTERRUPTIONS.into_iter().find(|one| Some(*one) == cause);
        if let Some(interruption) = interruption.filter(|one| self.passed_on.contains(one)) {
            // The signal arrived before the child listened: no run was begun.
            if interruption != Signal::SIGINT {
                self.signals.end_by(interruption); // if it fails, the next line reports the same
            }
            return Exit::Interrupted.into();
        }
        if let Err(failure) = self.report(command, signal) {
            output::tell(&failure.to_string());
        }
        Exit::Infrastructure.into()
    }

    /// Waits for the end of the child, forwarding signals and job control.
    fn wait(&mut self) -> io::Result<ExitStatus> {
        let child = Pid::from_child(&self.child);
        loop {
            let signal = self.signals.next()?;
            if signal == Signal::SIGCHLD {
                match self.child.try_wait()? {
                    Some(status) => return Ok(status),
                    None => continue, // stopped or continued
                }
            }
            if let Some(signal) = rustix::process::Signal::from_named_raw(signal as c_int) {
                let _ = kill_process(child, signal); // the child may have ended
            }
            match signal {
                Signal::SIGTSTP => self.signals.stop()?,
                signal => self.passed_on.push(signal),
            }
        }
    }

    /// Returns the runs that were begun together with their summaries, and writes the missing summaries.
    fn summarise(&self, reason: &str, end: End) -> Vec<suite::lost::LostRun> {
        let mut all = Vec::new();
        for run in begun::read(&self.list) {
            match lost::summarise(&run, reason, end) {
                Ok(Some(summary)) => {
                    let is_recorded = run.folder.join(RECORDING).exists();
                    if lost::reason_of(&summary) == Some(reason) && is_recorded {
                        let folder = run.folder.display();
                        tell!(
                            "  = help: `hil recover {folder}` makes a whole recording and a summary of what was written"
                        );
                    }
                    all.push((run, summary));
                }
                Ok(None) => {}
                Err(failure) => output::tell(&failure.to_string()),
            }
        }
        all
    }

    /// Reports how the child ended, and writes the results that the child could not write.
    fn report(&self, command: &Command, signal: c_int) -> Result<(), Failure> {
        let name = signal_name(signal).unwrap_or("a signal");
        let reason = format!("hil was killed by {name} ({signal})");
        if output::person_watches() {
            output::tell("\r"); // after the progress bar
        }
        tell!("error: {reason}: {}", cause(signal));
        let lost = self.summarise(&reason, End::Signal);
        match command {
            Command::Run(arguments) => suite::lost::report(arguments, &lost, &reason),
            Command::Replay(arguments) if arguments.json => aborted(&reason, &arguments.run),
            Command::Rerun(arguments) if arguments.options.json => aborted(&reason, &arguments.run),
            _ => Ok(()),
        }
    }
}

/// Writes the result of a command that processes a recorded run.
fn aborted(reason: &str, run: &Path) -> Result<(), Failure> {
    let run = run.display().to_string();
    let aborted = json!({"verdict": "aborted", "reason": reason, "run": run});
    output::write(&format!("{aborted:#}\n"))
}

/// Returns the usual cause of a death by a signal.
const fn cause(signal: c_int) -> &'static str {
    match signal {
        SIGBUS => {
            "shared memory became inaccessible: a file of the session in /dev/shm was truncated, or /dev/shm is full"
        }
        SIGSEGV | SIGABRT => {
            "a plant or controller can cause this by overwriting the memory that it shares with hil; look for a wild pointer in code that is not safe Rust"
        }
        SIGKILL => "a user killed hil, or the kernel did because memory ran out; see `sudo dmesg`",
        _ => "a user or a limit of the system ended hil; see `ulimit -a`",
    }
}
