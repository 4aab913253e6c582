//! Asking a program: run for a short answer, with a limit to everything that it may do meanwhile.

use std::ffi::OsStr;
use std::io::{self, Read};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use crate::process::{MARK, end_group, end_marked, reap};

/// Time that every program may take to describe itself or to check a job.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// The same in s: the least that a program may take to start.
pub const LEAST_S: f64 = ANSWER_LIMIT.as_secs() as f64;
/// Time that a program may take in this process, in ms: the limit of its command line, if that is longer.
static LIMIT_MS: AtomicU64 = AtomicU64::new(ANSWER_LIMIT.as_millis() as u64);
/// Longest answer; that of 100 plants with 512 signals each is shorter.
const LONGEST_ANSWER: u64 = 16 << 20;
/// Longest beginning of a program's standard error that is kept, in bytes.
const LONGEST_COMPLAINT: u64 = 64 << 10;

/// Answer of a program.
#[derive(Debug)]
pub struct Answer {
    /// Exit status.
    pub status: ExitStatus,
    /// Standard output, whole.
    pub stdout: Vec<u8>,
    /// The beginning of its standard error.
    pub stderr: Vec<u8>,
}

/// A program gave no answer.
#[derive(Debug, thiserror::Error)]
pub enum NoAnswer {
    /// Somebody interrupted it.
    #[error("interrupted")]
    Interrupted,
    /// Failure: it cannot be started, or does not answer as it should.
    #[error("{0}")]
    Failed(String),
}

/// Lets every program that this process asks take so many seconds from now on, and never less than 10.
pub fn allow_seconds(limit_s: f64) {
    // The cast saturates: infinity is 584 million years.
    let limit_ms = (limit_s * 1e3) as u64;
    LIMIT_MS.fetch_max(limit_ms, Ordering::Relaxed);
}

fn limit() -> Duration {
    Duration::from_millis(LIMIT_MS.load(Ordering::Relaxed))
}

/// Runs a program for a short answer; one that never answers, or never ends to, is ended, and so is
/// all that it started.
///
/// # Errors
/// If there is no answer.
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
    let heard = Heard {
        stdout: listen(child.stdout.take(), LONGEST_ANSWER),
        stderr: listen(child.stderr.take(), LONGEST_COMPLAINT),
    };
    let status = await_end(&mut child, &heard, is_interrupted);
    if status.is_err() {
        end_group(&child);
        let _ = child.wait(); // it was killed, or had ended just now
    }
    // What left its group would live on, and hold the pipes open.
    end_marked(&mark);
    heard.answer(status?).map_err(NoAnswer::Failed)
}

fn failed(error: io::Error) -> NoAnswer {
    NoAnswer::Failed(error.to_string())
}

/// Waits for the end of a program that was asked.
fn await_end(
    child: &mut Child,
    heard: &Heard,
    is_interrupted: &dyn Fn() -> bool,
) -> Result<ExitStatus, NoAnswer> {
    let since = Instant::now();
    loop {
        match reap(child).map_err(failed)? {
            Some(status) => return Ok(status),
            None if is_interrupted() => return Err(NoAnswer::Interrupted),
            None if heard.stdout.is_too_long() => return Err(NoAnswer::Failed(too_long())),
            None if since.elapsed() > limit() => {
                let limit_s = limit().as_secs_f64();
                let reason = format!("it gave no answer within {limit_s} s");
                return Err(NoAnswer::Failed(reason));
            }
            None => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

fn too_long() -> String {
    format!("its answer is longer than {} MiB", LONGEST_ANSWER >> 20)
}

/// Output of a program, read while it runs: a full pipe would stop the binary.
struct Heard {
    stdout: Ear,
    stderr: Ear,
}

/// Output of the program, read on a thread of its own.
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
    /// The answer of a program that has ended.
    fn answer(self, status: ExitStatus) -> Result<Answer, String> {
        let collect = |ear: &Ear| {
            let held = |_| "something that it started holds its output open".to_owned();
            ear.bytes.recv_timeout(ANSWER_LIMIT).map_err(held)
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

/// Reads an output to its end; what is beyond the limit is passed over.
fn listen(pipe: Option<impl Read + Send + 'static>, limit_bytes: u64) -> Ear {
    let is_too_long = Arc::new(AtomicBool::new(false));
    let (sender, bytes) = channel();
    let tell = Arc::clone(&is_too_long);
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // What was read before an error is all there is to show.
            let _ = (&mut pipe).take(limit_bytes).read_to_end(&mut bytes);
            if matches!(io::copy(&mut (&mut pipe).take(1), &mut io::sink()), Ok(1)) {
                tell.store(true, Ordering::Release);
                let _ = io::copy(&mut pipe, &mut io::sink());
            }
        }
        let _ = sender.send(bytes); // nobody waits for it any more
    });
    Ear { is_too_long, bytes }
}
