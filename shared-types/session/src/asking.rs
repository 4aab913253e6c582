//! Queries of a program: starts it to obtain a short answer, with limits on time and output.

use std::ffi::OsStr;
use std::io::{self, Read};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use crate::process::{MARK, ProcessId, end_group, end_marked, reap};

/// Time limit for a program to describe itself or to check a job.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// Time limit in s that a program has at least to start.
pub const LEAST_S: f64 = ANSWER_LIMIT.as_secs() as f64;
/// Time limit of queried programs in ms: the wait limit of this process's command line, if that is longer.
static LIMIT_MS: AtomicU64 = AtomicU64::new(ANSWER_LIMIT.as_millis() as u64);
/// Time that a queried program may remain stopped, in ms: the limit of this process's command line, if that is shorter.
static STOPPED_MS: AtomicU64 = AtomicU64::new(ANSWER_LIMIT.as_millis() as u64);
/// Interval between checks of a program's state.
const LOOK: Duration = Duration::from_millis(50);
/// Maximum length of an answer in bytes; the answer of 100 plants with 512 signals each is shorter.
const LONGEST_ANSWER: u64 = 16 << 20;
/// Maximum number of bytes kept from the beginning of a program's standard error.
const LONGEST_COMPLAINT: u64 = 64 << 10;

/// Answer of a program.
#[derive(Debug)]
pub struct Answer {
    /// Exit status.
    pub status: ExitStatus,
    /// Complete standard output.
    pub stdout: Vec<u8>,
    /// Beginning of its standard error.
    pub stderr: Vec<u8>,
}

/// Reason for a missing answer.
#[derive(Debug, thiserror::Error)]
pub enum NoAnswer {
    /// The query was interrupted.
    #[error("interrupted")]
    Interrupted,
    /// The program cannot be started, or does not answer properly.
    #[error("{0}")]
    Failed(String),
}

/// Extends the time limit of all programs run by this process to this number of seconds; the minimum is 10. A program
/// that is stopped by a signal or a debugger gets exactly this time.
pub fn allow_seconds(limit_s: f64) {
    // The cast saturates: infinity becomes 584 million years.
    let limit_ms = (limit_s * 1e3) as u64;
    LIMIT_MS.fetch_max(limit_ms, Ordering::Relaxed);
    STOPPED_MS.store(limit_ms, Ordering::Relaxed);
}

fn limit(of: &AtomicU64) -> Duration {
    Duration::from_millis(of.load(Ordering::Relaxed))
}

/// Runs a program for a short answer; a program that never answers or never ends is killed with all its
/// descendants.
///
/// # Errors
/// If there is no answer; the error states the reason.
pub fn ask<S: AsRef<OsStr>>(
    path: &Path,
    arguments: &[S],
    is_interrupted: &dyn Fn() -> bool,
) -> Result<Answer, NoAnswer> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let mark = format!("hil_{}_{number}", std::process::id());
    let mut child = Command::new(path)
        .args(arguments)
        .env(MARK, &mark)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn()
        .map_err(failed)?;
    let output = Heard {
        stdout: listen(child.stdout.take(), LONGEST_ANSWER),
        stderr: listen(child.stderr.take(), LONGEST_COMPLAINT),
    };
    let status = await_end(&mut child, &output, is_interrupted);
    if status.is_err() {
        end_group(&child);
        let _ = child.wait(); // it was killed, or has just ended
    }
    // Descendants outside its process group would live on and hold the pipes open.
    end_marked(&mark);
    output.answer(status?).map_err(NoAnswer::Failed)
}

fn failed(error: io::Error) -> NoAnswer {
    NoAnswer::Failed(error.to_string())
}

/// Waits for the end of a program.
fn await_end(
    child: &mut Child,
    output: &Heard,
    is_interrupted: &dyn Fn() -> bool,
) -> Result<ExitStatus, NoAnswer> {
    let since = Instant::now();
    let id = ProcessId::of(child.id());
    let (mut looked, mut stopped_since) = (since, None);
    loop {
        if looked.elapsed() > LOOK {
            looked = Instant::now();
            stopped_since = match id.is_some_and(ProcessId::is_stopped) {
                true => stopped_since.or(Some(looked)),
                false => None,
            };
        }
        let stopped_limit = limit(&STOPPED_MS);
        match reap(child).map_err(failed)? {
            Some(status) => return Ok(status),
            None if is_interrupted() => return Err(NoAnswer::Interrupted),
            None if output.stdout.is_too_long() => return Err(NoAnswer::Failed(too_long())),
            None if stopped_since.is_some_and(|since| since.elapsed() > stopped_limit) => {
                let limit_s = stopped_limit.as_secs_f64();
                let reason =
                    format!("the program was stopped and did not answer within {limit_s} s");
                return Err(NoAnswer::Failed(reason));
            }
            None if since.elapsed() > limit(&LIMIT_MS) => {
                let limit_s = limit(&LIMIT_MS).as_secs_f64();
                let reason = format!("no answer within {limit_s} s");
                return Err(NoAnswer::Failed(reason));
            }
            None => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

fn too_long() -> String {
    format!("the answer is longer than {} MiB", LONGEST_ANSWER >> 20)
}

/// Output of a program, read while it runs, because a full pipe would block it.
struct Heard {
    stdout: Ear,
    stderr: Ear,
}

/// Output stream, read on a thread of its own.
struct Ear {
    is_too_long: Arc<AtomicBool>,
    bytes: Receiver<Vec<u8>>,
}

impl Ear {
    fn is_too_long(&self) -> bool {
        self.is_too_long.load(Ordering::Acquire)
    }
}

impl Heard {
    /// Returns the answer of a program that has ended.
    fn answer(self, status: ExitStatus) -> Result<Answer, String> {
        let collect = |ear: &Ear| {
            let held_open = |_| "a child process of the program holds the output open".to_owned();
            ear.bytes.recv_timeout(ANSWER_LIMIT).map_err(held_open)
        };
        let stdout = collect(&self.stdout)?;
        if self.stdout.is_too_long() {
            return Err(too_long());
        }
        Ok(Answer {
            status,
            stdout,
            stderr: collect(&self.stderr)?,
        })
    }
}

/// Reads an output to its end; discards everything beyond the limit.
fn listen(pipe: Option<impl Read + Send + 'static>, limit_bytes: u64) -> Ear {
    let is_too_long = Arc::new(AtomicBool::new(false));
    let (sender, bytes) = channel();
    let tell = Arc::clone(&is_too_long);
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // After a read error, the output so far is all there is.
            let _ = (&mut pipe).take(limit_bytes).read_to_end(&mut bytes);
            if matches!(io::copy(&mut (&mut pipe).take(1), &mut io::sink()), Ok(1)) {
                tell.store(true, Ordering::Release);
                let _ = io::copy(&mut pipe, &mut io::sink());
            }
        }
        let _ = sender.send(bytes); // the receiver may be gone
    });
    Ear { is_too_long, bytes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopped_program_has_the_requested_limit() {
        allow_seconds(0.2);
        let stops = ["-c", "kill -STOP $$"];
        let answer = ask(Path::new("sh"), &stops, &|| false).map(|answer| answer.status);
        let reason = answer.expect_err("it is stopped").to_string();
        assert_eq!(
            reason,
            "the program was stopped and did not answer within 0.2 s"
        );
    }
}
