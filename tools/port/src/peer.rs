//! The program at the far end: started, awaited and ended, if the port file says how.

use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use hil_config::port::Start;
use hil_session::process::{end_group, reap};
use hil_session::program::say;
use hil_session::supervision::Supervision;

/// Time between two looks at whether a peer has ended while its ready line is awaited.
const LOOK: Duration = Duration::from_millis(10);
/// Most bytes of a line that are printed.
const LONGEST_LINE: u64 = 500;
/// Most lines that are printed.
const MOST_LINES: u64 = 10_000;

/// Part of the wait limit that the far end may use, so that the port names it before the other side gives up.
const SHARE: f64 = 0.8;
/// Part of the wait limit in which a started program must be ready. Its first answer has what is left of [`SHARE`].
const READY_SHARE: f64 = 0.6;
/// Longest wait, in s, where there is no limit.
const LONGEST_S: f64 = 1e6;

/// Returns the longest wait for the far end in a run with a wait limit.
#[must_use]
pub fn longest_wait(wait_limit_s: f64) -> Duration {
    part(SHARE, wait_limit_s)
}

/// Returns the longest wait for a started program to be ready in a run with a wait limit.
pub(crate) fn longest_start(wait_limit_s: f64) -> Duration {
    part(READY_SHARE, wait_limit_s)
}

fn part(share: f64, wait_limit_s: f64) -> Duration {
    let limit_s = share * wait_limit_s;
    Duration::from_secs_f64(match limit_s < LONGEST_S {
        true => limit_s,
        false => LONGEST_S,
    })
}

/// Started program. Its end is that of its process group; `hil` also finds descendants that leave the group.
#[derive(Debug)]
pub struct Peer {
    child: Child,
    name: String,
}

impl Peer {
    /// Starts the peer in the folder of the port file and waits until it is ready.
    ///
    /// # Errors
    /// If it cannot be started, ends, or is not ready in time.
    pub fn start(
        start: &Start,
        folder: &Path,
        limit: Duration,
        supervision: &Supervision,
    ) -> Result<Option<Self>, String> {
        let Some((program, arguments)) = start.command.split_first() else {
            return Ok(None);
        };
        // A path is relative to the port file; a bare name is looked up as a shell does.
        let path = match program.contains('/') {
            true => folder.join(program),
            false => program.into(),
        };
        let mut child = Command::new(&path)
            .args(arguments)
            .current_dir(match folder.as_os_str().is_empty() {
                true => Path::new("."),
                false => folder,
            })
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .process_group(0)
            .spawn()
            .map_err(|error| format!("`start` of the port: {}: {error}", path.display()))?;
        let readiness = print_lines(&mut child, start.ready.clone());
        let mut peer = Self {
            child,
            name: program.clone(),
        };
        if let Some(ready) = &start.ready {
            peer.await_line(&readiness, ready, (limit, supervision))?;
        }
        Ok(Some(peer))
    }

    fn await_line(
        &mut self,
        readiness: &Receiver<()>,
        ready: &str,
        (limit, supervision): (Duration, &Supervision),
    ) -> Result<(), String> {
        let until = Instant::now() + limit;
        loop {
            match readiness.recv_timeout(LOOK) {
                Ok(()) => return Ok(()),
                Err(error) => {
                    // Its output may be closed while it runs.
                    if error == RecvTimeoutError::Disconnected {
                        std::thread::sleep(LOOK);
                    }
                    if let Some(end) = self.end() {
                        return Err(format!("{end}, before it printed `{ready}`"));
                    }
                }
            }
            if supervision.wants_stop() {
                return Err(format!("stopped before the peer printed `{ready}`"));
            }
            if Instant::now() >= until {
                let limit_s = limit.as_secs_f64();
                return Err(format!(
                    "the peer `{}` did not print `{ready}` within {limit_s:.3} s; raise --wait-limit if it needs longer",
                    self.name
                ));
            }
        }
    }

    /// Returns how the peer ended; `None` if it runs.
    pub fn end(&mut self) -> Option<String> {
        let status = match reap(&mut self.child) {
            Ok(status) => status?,
            Err(error) => return Some(format!("the peer `{}` is lost: {error}", self.name)),
        };
        Some(format!("the peer `{}` ended with {status}", self.name))
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        end_group(&self.child);
        // It was killed, or has ended before.
        let _ = self.child.wait();
    }
}

/// Prints the lines of a peer, bounded, into the log of the port; sends once when one begins with `ready`.
fn print_lines(child: &mut Child, ready: Option<String>) -> Receiver<()> {
    let (sender, receiver) = channel();
    if let Some(stdout) = child.stdout.take() {
        std::thread::spawn(move || {
            let mut ready = ready;
            let mut reader = BufReader::new(stdout);
            let mut line = Vec::new();
            for number in 0_u64.. {
                line.clear();
                let result = (&mut reader)
                    .take(LONGEST_LINE)
                    .read_until(b'\n', &mut line);
                if !matches!(result, Ok(1..)) {
                    return;
                }
                let is_whole = line.ends_with(b"\n");
                let text = String::from_utf8_lossy(line.trim_ascii_end());
                if ready
                    .as_ref()
                    .is_some_and(|ready| text.starts_with(&**ready))
                {
                    ready = None;
                    // Nobody receives if the wait has ended.
                    let _ = sender.send(());
                }
                match number {
                    0..MOST_LINES => say(&format!("peer: {}", shared_types::text::line(&text))),
                    MOST_LINES => say("peer: .. (further lines are not printed)"),
                    _ => {}
                }
                if !is_whole && reader.skip_until(b'\n').is_err() {
                    return;
                }
            }
        });
    }
    receiver
}
