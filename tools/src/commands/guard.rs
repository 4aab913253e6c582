//! Guard of a run: a small process that opens no shared memory, starts `hil` once more as its child, and says what
//! became of the run if the child is killed.
//!
//! A plant or controller can write over the memory that it shares with `hil`, whose libraries then end the process by
//! a signal that nothing inside it survives; the kernel ends it where memory runs out. The guard outlives both:
//!
//! 1. It passes on the signals that it gets and stops with its child, so that terminals, shells and scripts see one
//!    process. Descriptors, process group and arguments are the same; the exit code is the child's.
//! 2. The child notes each run that it begins in a [list](begun) that both hold.
//! 3. If a signal ends the child, the guard ends both sides, removes the session and writes the summaries that are
//!    missing; the summaries too if the child gave up, as after a panic of its recorder.
//! 4. If a signal ends the guard, the kernel kills the child, whose sides end with their input.

use std::ffi::c_int;
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::process::{CommandExt, ExitStatusExt, parent_id};
use std::path::Path;
use std::process::{Child, ExitCode, ExitStatus};
use std::thread;
use std::time::Duration;

use rustix::fs::{MemfdFlags, memfd_create};
use rustix::process::{Pid, Signal, getpid, kill_process, set_parent_process_death_signal};
use rustix::thread::set_name;
use serde_json::json;
use shared_types::process::{Ending, ProcessId};
use shared_types::session;
use signal_hook::consts::{
    SIGABRT, SIGBUS, SIGCHLD, SIGCONT, SIGHUP, SIGINT, SIGKILL, SIGQUIT, SIGSEGV, SIGTERM, SIGTSTP,
};
use signal_hook::iterator::Signals;
use signal_hook::low_level::{emulate_default_handler, signal_name};

use hil_recording::reader::RECORDING;

use crate::arguments::Command;
use crate::arguments::campaign::CampaignAction;
use crate::arguments::run::LinkKind;
use crate::files::begun;
use crate::results::lost;
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::output;
use crate::verification::suite;

/// Environment variable of a guarded process: the number of its guard and the guard's descriptor of the list.
const GUARD: &str = "HIL_GUARD";
/// Signals that end a run in order.
const ENDS: [c_int; 3] = [SIGINT, SIGTERM, SIGHUP];

/// Returns `true` if a command opens shared memory that a program of somebody else can write to.
///
/// Workers of a campaign are children already, and what watches a session owns nothing that it could leave.
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

/// Returns `true` if this process has a guard, and ties its life to the guard's.
pub(super) fn is_there() -> bool {
    let Ok(told) = std::env::var(GUARD) else {
        return false;
    };
    let (pid, list) = told.split_once(':').unwrap_or_default();
    // Programs that a run starts inherit the variable, and may start another `hil`.
    let Some(guard) = pid.parse().ok().filter(|pid| *pid == parent_id()) else {
        return false;
    };
    let _ = set_name(c"hil"); // started as `/proc/self/exe`, it would be `exe` to `ps` and to the kernel's log
    let _ = set_parent_process_death_signal(Some(Signal::KILL)); // every kernel knows it
    if parent_id() != guard {
        std::process::exit(Exit::Infrastructure as i32); // it died before
    }
    if let Some(guard) = ProcessId::of(guard) {
        session::guard::is(guard);
    }
    let list = format!("/proc/{guard}/fd/{list}");
    if let Ok(list) = File::options().append(true).open(list) {
        begun::write_to(list);
    }
    true
}

/// Does a command in a child of this process.
pub(super) fn run(command: &Command) -> ExitCode {
    match Guard::start() {
        Ok(guard) => guard.guard(command),
        Err(error) => {
            let failure = Failure::infrastructure(format!("cannot start hil once more: {error}"));
            output::tell(&failure.to_string());
            failure.exit().into()
        }
    }
}

struct Guard {
    signals: Signals,
    list: File,
    child: Child,
    /// Signals that were passed on.
    passed_on: Vec<c_int>,
    /// The terminal or a person wants the run to stop until it is continued.
    is_held: bool,
}

impl Guard {
    fn start() -> io::Result<Self> {
        // Before the start, so that none is lost.
        let others = [SIGCHLD, SIGCONT, SIGQUIT, SIGTSTP];
        let signals = Signals::new(ENDS.iter().chain(&others))?;
        let list = File::from(memfd_create("hil-begun", MemfdFlags::CLOEXEC)?);
        let mut words = std::env::args_os();
        // Not by its path, where another file may be by now.
        let mut hil = std::process::Command::new("/proc/self/exe");
        hil.arg0(words.next().unwrap_or_else(|| "hil".into()));
        hil.args(words);
        let own = getpid().as_raw_nonzero();
        hil.env(GUARD, format!("{own}:{}", list.as_raw_fd()));
        Ok(Self {
            signals,
            list,
            child: hil.spawn()?,
            passed_on: Vec::new(),
            is_held: false,
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
            // It has one: there is no third way to end.
            let code = status.code().and_then(|code| u8::try_from(code).ok());
            let code = code.unwrap_or(Exit::Infrastructure as u8);
            if code != Exit::Pass as u8 {
                let reason = format!(
                    "hil ended with exit code {code} before the run had a summary; standard error has the cause"
                );
                self.summarise(&reason);
            }
            return code.into();
        };
        if let Err(error) = session::sweep() {
            tell!("error: {error}");
        }
        if self.passed_on.contains(&signal) {
            // It came before the child listened: nothing was begun.
            if signal != SIGINT {
                let _ = emulate_default_handler(signal); // the next line is as good
            }
            return Exit::Interrupted.into();
        }
        if let Err(failure) = self.report(command, signal) {
            output::tell(&failure.to_string());
        }
        Exit::Infrastructure.into()
    }

    /// Waits for the end of the child, and is to it what the terminal is to this process.
    fn wait(&mut self) -> io::Result<ExitStatus> {
        let child = Pid::from_child(&self.child);
        self.wake_at_the_end();
        loop {
            // What came meanwhile is in no order; a run that is to go on must not be left stopped.
            let mut signals: Vec<c_int> = self.signals.wait().collect();
            signals.sort_by_key(|signal| *signal == SIGCONT);
            for signal in signals {
                match signal {
                    // The child dies of SIGQUIT, which is reported.
                    SIGCHLD | SIGQUIT => {}
                    SIGCONT => self.is_held = false,
                    SIGTSTP => self.is_held = true,
                    other => self.passed_on.push(other),
                }
                if let Some(signal) = Signal::from_named_raw(signal).filter(|_| signal != SIGCHLD) {
                    let _ = kill_process(child, signal); // its end is seen below
                }
            }
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            let is_stopped = || ProcessId::of(self.child.id()).is_some_and(ProcessId::is_stopped);
            if self.is_held && is_stopped() {
                let _ = kill_process(getpid(), Signal::STOP); // it is there
            }
        }
    }

    /// Wakes [`wait`](Self::wait) at the end of the child, even if this process was started with SIGCHLD blocked.
    fn wake_at_the_end(&self) {
        const LOOK: Duration = Duration::from_secs(60);
        let handle = self.signals.handle();
        // Without it, SIGCHLD tells.
        let ending = ProcessId::of(self.child.id()).and_then(Ending::of);
        thread::spawn(move || {
            if let Some(ending) = ending {
                while !Ending::wait_for_any([&ending], LOOK) {}
                handle.close();
            }
        });
    }

    /// Gives the runs that were begun with their summaries, and writes those that are missing.
    fn summarise(&self, reason: &str) -> Vec<suite::lost::LostRun> {
        let mut all = Vec::new();
        for run in begun::read(&self.list) {
            match lost::summarise(&run, reason) {
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

    /// Says how the child ended, and writes what it could not.
    fn report(&self, command: &Command, signal: c_int) -> Result<(), Failure> {
        let name = signal_name(signal).unwrap_or("a signal");
        let reason = format!("hil was killed by {name} ({signal})");
        if output::person_watches() {
            output::tell("\r"); // behind what was drawn
        }
        tell!("error: {reason}: {}", cause(signal));
        let lost = self.summarise(&reason);
        match command {
            Command::Run(arguments) => suite::lost::report(arguments, &lost, &reason),
            Command::Replay(arguments) if arguments.json => aborted(&reason, &arguments.run),
            Command::Rerun(arguments) if arguments.options.json => aborted(&reason, &arguments.run),
            _ => Ok(()),
        }
    }
}

/// Writes the result of a command that goes over a recorded run.
fn aborted(reason: &str, run: &Path) -> Result<(), Failure> {
    let run = run.display().to_string();
    let aborted = json!({"verdict": "aborted", "reason": reason, "run": run});
    output::write(&format!("{aborted:#}\n"))
}

/// Names the usual cause of a death by a signal.
const fn cause(signal: c_int) -> &'static str {
    match signal {
        SIGSEGV | SIGABRT | SIGBUS => {
            "a plant or controller that writes over the memory that it shares with hil does this; look for a wild pointer in one that is not of safe Rust"
        }
        SIGKILL => {
            "by somebody, or by the kernel because no memory was left; `sudo dmesg` tells which"
        }
        _ => "by somebody, or by a limit of the system",
    }
}
