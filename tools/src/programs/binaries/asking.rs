//! Asking a binary: run for a short answer, with a limit to everything that it may do meanwhile.

use std::ffi::OsStr;
use std::io::{self, Read};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use shared_types::process::{MARK, end_marked};

use super::{end_group, reap};
use crate::terminal::exit::Failure;
use crate::terminal::interruption::Interruption;

/// Longest time that a binary may take to describe itself or to check a job.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// Longest answer; that of 100 plants with 512 signals each is shorter.
const LONGEST_ANSWER: u64 = 16 << 20;
/// Longest beginning of a binary's standard error that is kept, in bytes.
const LONGEST_COMPLAINT: u64 = 64 << 10;

/// Answer of a binary.
pub(super) struct Answer {
    pub(super) status: ExitStatus,
    pub(super) stdout: Vec<u8>,
    /// Its beginning.
    pub(super) stderr: Vec<u8>,
}

/// Runs a binary for a short answer; one that never answers, or never ends to, is ended, and so is
/// all that it started.
pub(super) fn ask<S: AsRef<OsStr>>(
    path: &Path,
    arguments: &[S],
    interruption: &Interruption,
) -> Result<Result<Answer, String>, Failure> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let mark = format!("hil_{}_{number}", std::process::id());
    let child = Command::new(path)
        .args(arguments)
        .env(MARK, &mark)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn();
    let mut child = match child {
        Ok(child) => child,
        Err(error) => return Ok(Err(error.to_string())),
    };
    let heard = Heard {
        stdout: listen(child.stdout.take(), LONGEST_ANSWER),
        stderr: listen(child.stderr.take(), LONGEST_COMPLAINT),
    };
    let status = await_end(&mut child, &heard, interruption);
    if !matches!(status, Ok(Ok(_))) {
        end_group(&child);
        let _ = child.wait(); // it was killed, or had ended just now
    }
    // What left its group would live on, and hold the pipes open.
    end_marked(&mark);
    Ok(status?.and_then(|status| heard.answer(status)))
}

/// Waits for the end of a binary that was asked.
fn await_end(
    child: &mut Child,
    heard: &Heard,
    interruption: &Interruption,
) -> Result<Result<ExitStatus, String>, Failure> {
    let since = Instant::now();
    loop {
        match reap(child) {
            Err(error) => return Ok(Err(error.to_string())),
            Ok(Some(status)) => return Ok(Ok(status)),
            Ok(None) if interruption.came() => return Err(Failure::Interrupted),
            Ok(None) if heard.stdout.is_too_long() => return Ok(Err(too_long())),
            Ok(None) if since.elapsed() > ANSWER_LIMIT => {
                let limit_s = ANSWER_LIMIT.as_secs();
                return Ok(Err(format!("it gave no answer within {limit_s} s")));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

fn too_long() -> String {
    format!("its answer is longer than {} MiB", LONGEST_ANSWER >> 20)
}

/// Output of a binary, read while it runs: a full pipe would stop the binary.
struct Heard {
    stdout: Ear,
    stderr: Ear,
}

/// One of its outputs, read on a thread of its own.
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
    /// The answer of a binary that has ended.
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
