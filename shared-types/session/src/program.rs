//! Command line of a plant or controller process: arguments, exit codes and errors, common to both.
//!
//! Called by `plant_process::program::run` and `controller_process::program::run`; a binary's `main` is a single call
//! of one of these.

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread::Builder;

use clap::Parser;
use nix::sys::signal::{SigSet, SigmaskHow};
use rustix::process::{Resource, getrlimit};
use serde::Serialize;

use crate::link::iceoryx::IceoryxLink;
use crate::manual_start;
use crate::session::SessionInfo;
use crate::supervision::Supervision;
use crate::waiter::Waiter;
use shared_types::describe::{Description, PROTOCOL};
use shared_types::link::LinkError;
use shared_types::local_map::LocalMap;
use shared_types::side::Side;
use shared_types::text;
use shared_types::wait::WaitLimit;

/// Name of a plant's job in the session's folder.
pub const PLANT_JOB: &str = "plant.json";

/// Name of a controller's job in the session's folder.
pub const CONTROLLER_JOB: &str = "controller.json";

/// Stack size of the thread that does a program's work, in bytes: the usual size of a main thread.
const STACK: usize = 8 << 20;

/// Exit code of a completed run.
pub const COMPLETED: u8 = 0;
/// Exit code of a diverged run.
pub const DIVERGED: u8 = 1;
/// Exit code for a job that cannot be run as given.
pub const UNUSABLE: u8 = 2;
/// Exit code of a run that ended in any other way.
pub const FAILED: u8 = 3;

/// Program inside a binary: one side of a run.
pub trait Program {
    /// Returns the side that the program is for.
    fn side(&self) -> Side;

    /// Returns the answer to `--describe`.
    fn description(&self) -> Description;

    /// Checks a job for `--check`.
    ///
    /// # Errors
    /// The reason why the job cannot be run.
    fn check(&self, job: &Path) -> Result<(), String>;

    /// Answers a question file for `--linearise` with the side's map at a point.
    ///
    /// # Errors
    /// The reason why there is no linear model.
    fn linearise(&self, _question: &Path) -> Result<LocalMap, String> {
        Err("this program has no linear model".into())
    }

    /// Runs the job of a session to its end and returns the exit code.
    ///
    /// # Errors
    /// A failure before or outside the run itself.
    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String>;
}

/// Side of a hardware-in-the-loop run. It is started by hil, or by hand with the command that
/// hil run --controller external or --plant external prints.
#[derive(Debug, Parser)]
struct Arguments {
    /// Say as JSON what this binary can be: names, signals, parameters with units and ranges
    #[arg(long, conflicts_with_all = ["check", "session"])]
    describe: bool,
    /// Read a job file and say whether its parameters go together
    #[arg(long, value_name = "JOB.json", conflicts_with = "session")]
    check: Option<PathBuf>,
    /// Read a question file and print as JSON the linear model of this side at a point
    #[arg(long, value_name = "QUESTION.json", conflicts_with_all = ["describe", "check", "session"])]
    linearise: Option<PathBuf>,
    /// Run the job in a session's folder
    #[arg(long, value_name = "FOLDER", required_unless_present_any = ["describe", "check", "linearise"])]
    session: Option<PathBuf>,
    /// Take the place in it that hil run --controller external or --plant external keeps
    #[arg(long, requires = "session")]
    by_hand: bool,
}

/// Runs a program's work on a thread with its own stack if the main thread's stack is smaller, as after `ulimit -s 64`;
/// otherwise on the calling thread. A panic is propagated to the caller. Signals reach the work as if it ran on the
/// main thread, which blocks all signals meanwhile: no other thread receives signals that the work blocks or reads.
pub fn with_stack<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let limit = getrlimit(Resource::Stack).current;
    if limit.is_none_or(|bytes| bytes >= STACK as u64) {
        return work();
    }
    // All signals; the call cannot fail otherwise.
    let before = SigSet::all().thread_swap_mask(SigmaskHow::SIG_SETMASK).ok();
    let restore = || {
        if let Some(mask) = before {
            let _ = mask.thread_set_mask();
        }
    };
    let work = || {
        restore();
        work()
    };
    let result = std::thread::scope(|scope| {
        // Thread name in panic messages.
        let thread = Builder::new().name("main".into()).stack_size(STACK);
        let ended = match thread.spawn_scoped(scope, work) {
            Ok(thread) => thread.join(),
            Err(error) => {
                say(&format!("error: cannot start a thread: {error}"));
                std::process::exit(i32::from(FAILED));
            }
        };
        ended.unwrap_or_else(|panic| resume_unwind(panic))
    });
    restore();
    result
}

/// Runs the program as its command-line arguments request.
#[must_use]
pub fn run(program: &(impl Program + Sync)) -> ExitCode {
    ExitCode::from(with_stack(|| answer(program, std::env::args_os())))
}

/// Runs the program with these arguments, of which the first is its own path, and returns the exit code.
pub fn answer(program: &impl Program, arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = Arguments::parse_from(arguments);
    let (result, otherwise) = if let Some(path) = arguments.check {
        (program.check(&path).map(|()| COMPLETED), UNUSABLE)
    } else if let Some(path) = arguments.linearise {
        let map = program.linearise(&path);
        (map.and_then(|map| print(&map)), UNUSABLE)
    } else if let Some(folder) = arguments.session.as_ref().filter(|_| arguments.by_hand) {
        (serve_by_hand(program, folder), UNUSABLE)
    } else if let Some(folder) = arguments.session {
        (serve(program, &folder), FAILED)
    } else {
        (print(&program.description()), FAILED)
    };
    result.unwrap_or_else(|reason| {
        say(&format!("error: {reason}"));
        otherwise
    })
}

/// Prints an answer as JSON.
fn print(answer: &impl Serialize) -> Result<u8, String> {
    let text = serde_json::to_string_pretty(answer).map_err(|e| e.to_string())?;
    match writeln!(std::io::stdout(), "{text}") {
        // A reader that stops early, such as `head`.
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(COMPLETED),
        written => written
            .map(|()| COMPLETED)
            .map_err(|error| format!("cannot write to standard output: {error}")),
    }
}

fn serve(program: &impl Program, folder: &Path) -> Result<u8, String> {
    let supervision = Supervision::from_stdin();
    let session = SessionInfo::read(folder).map_err(|e| e.to_string())?;
    program.serve(&session, &supervision)
}

/// Serves a manually started side; an error means that the side was not admitted.
fn serve_by_hand(program: &impl Program, folder: &Path) -> Result<u8, String> {
    let session = SessionInfo::read(folder).map_err(|e| e.to_string())?;
    let side = program.side();
    let (supervision, leash) = manual_start::enter(&session, side)?;
    let (role, name) = (side.name(), &session.name);
    say(&format!("admitted as the {role} of session {name}"));
    let served = program.serve(&session, &supervision);
    let code = served.unwrap_or_else(|reason| {
        say(&format!("error: {reason}"));
        FAILED
    });
    leash.ends(code);
    Ok(code)
}

/// Line on standard output by which a host of foreign code states that a check was completed: without it, foreign code
/// could end the process early with the exit code of a success.
pub const CHECKED: &str = "checked";

/// Size in bytes of the file in which a host of foreign code stores the name of the current call. The file contains two
/// names with their lengths: first the changing part, then the prefix that all calls share.
pub const CALL_BYTES: usize = 2 * CALL_NAME_BYTES;
/// Size in bytes of one of these names, including its length.
pub const CALL_NAME_BYTES: usize = 64;

/// Returns the path of the file with a process's current call, in a session's folder.
#[must_use]
pub fn call_file(folder: &Path, process: u32) -> PathBuf {
    folder.join(format!("call-{process}"))
}

/// Returns the call of foreign code during which a process ended, if any.
#[must_use]
pub fn last_call(folder: &Path, process: u32) -> Option<String> {
    let bytes = std::fs::read(call_file(folder, process)).ok()?;
    let name = |at: usize| {
        let length = usize::from(*bytes.get(at)?);
        let name = bytes.get(at + 1..=at + length)?;
        Some(text::line(std::str::from_utf8(name).ok()?))
    };
    let (call, family) = (name(0)?, name(CALL_NAME_BYTES)?);
    (!call.is_empty()).then(|| format!("{family}{call}"))
}

/// Writes a line to standard error, which goes to the run's log. A failure of the log, for example on a full disk, must
/// not change how the process ends.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Reads a job file.
///
/// # Errors
/// If the file is missing or is not a job.
pub fn read_job<J: serde::de::DeserializeOwned>(path: &Path) -> Result<J, String> {
    let failed = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let text = std::fs::read_to_string(path).map_err(|e| failed(&e))?;
    serde_json::from_str(&text).map_err(|e| failed(&e))
}

/// Checks the launcher's protocol version.
///
/// # Errors
/// If the version differs; the error states both versions.
pub fn check_protocol(theirs: u32) -> Result<(), String> {
    if theirs == PROTOCOL {
        Ok(())
    } else {
        Err(format!(
            "the launcher speaks protocol {theirs}, but this binary speaks {PROTOCOL}; build both from one version"
        ))
    }
}

/// Opens the controller's end of an epoch, once the plant has created its link and any unauthorised process has left
/// the controller's place.
///
/// # Errors
/// The reason why the link was not available within the limit.
pub fn attach(
    session: &SessionInfo,
    epoch: u32,
    limit: WaitLimit,
    supervision: &Supervision,
) -> Result<IceoryxLink, String> {
    let mut waiter = Waiter::new(limit);
    loop {
        match IceoryxLink::open(session, epoch) {
            Ok(link) => return Ok(link),
            Err(LinkError::Absent { .. } | LinkError::Taken { .. }) if supervision.wants_stop() => {
                return Err("stopped before the session's link existed".into());
            }
            Err(LinkError::Absent { .. } | LinkError::Taken { .. })
                if supervision.is_peer_gone() =>
            {
                return Err("the plant ended before the session's link existed".into());
            }
            Err(LinkError::Absent { .. }) if !waiter.pause() => {}
            // The plant tells a process that was not launched to leave.
            Err(LinkError::Taken { .. }) if is_launched(session, epoch) && !waiter.pause() => {}
            Err(error) => return Err(error.to_string()),
        }
    }
}

/// Returns `true` if this process is the controller that was launched.
fn is_launched(session: &SessionInfo, epoch: u32) -> bool {
    let session = SessionInfo::read(&session.folder);
    let launched = session.ok().and_then(|session| session.controller);
    launched.is_some_and(|launched| {
        launched.epoch == epoch && launched.process.leads(std::process::id())
    })
}
