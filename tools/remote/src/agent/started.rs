//! The controller's program on a target: started, supplied with input, its output passed on, and ended with all its
//! descendants.

use std::io::{Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use hil_session::link::bell::Bell;
use hil_session::process::{MARK, end_group, end_marked, reap};
use hil_session::session::SessionInfo;
use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};

use crate::channel::Mouth;
use crate::message::ToDesk;

/// The program, in a process group of its own. Dropping the value ends the program and all its descendants.
pub(super) struct Started {
    child: Child,
    stdin: Option<ChildStdin>,
    has_ended: Arc<AtomicBool>,
    /// Held by each thread that passes on the program's output.
    passing_on: Arc<()>,
    prefix: String,
}

impl Started {
    pub(super) fn start(
        program: &Path,
        session: &SessionInfo,
        mouth: &Mouth,
        bell: Bell,
    ) -> std::io::Result<Self> {
        let mut child = Command::new(program)
            .arg("--session")
            .arg(&session.folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .env(MARK, &session.prefix)
            .process_group(0)
            .spawn()?;
        let passing_on = Arc::new(());
        if let Some(output) = child.stdout.take() {
            pass_on(output, mouth.clone(), Arc::clone(&passing_on));
        }
        if let Some(output) = child.stderr.take() {
            pass_on(output, mouth.clone(), Arc::clone(&passing_on));
        }
        let has_ended = Arc::new(AtomicBool::new(false));
        let (ended, pid) = (Arc::clone(&has_ended), Pid::from_child(&child));
        std::thread::spawn(move || {
            // It is not reaped here: until then its number is nobody else's.
            let _ = waitid(
                WaitId::Pid(pid),
                WaitIdOptions::EXITED | WaitIdOptions::NOWAIT,
            );
            ended.store(true, Ordering::Release);
            bell.ring();
        });
        Ok(Self {
            stdin: child.stdin.take(),
            child,
            has_ended,
            passing_on,
            prefix: session.prefix.clone(),
        })
    }

    pub(super) fn tell(&mut self, line: &str) {
        if let Some(stdin) = &mut self.stdin {
            let _ = writeln!(stdin, "{line}").and_then(|()| stdin.flush()); // its end shows elsewhere
        }
    }

    pub(super) fn process_id(&self) -> u32 {
        self.child.id()
    }

    /// Returns `true` once all output has been passed on.
    pub(super) fn is_silent(&self) -> bool {
        Arc::strong_count(&self.passing_on) == 1
    }

    /// Returns the program's exit status, once it has ended; the rest of its process group ends with it.
    pub(super) fn status(&mut self) -> Option<ExitStatus> {
        if !self.has_ended.load(Ordering::Acquire) {
            return None;
        }
        Some(match reap(&mut self.child) {
            Ok(status) => status?,
            Err(_) => self
                .child
                .wait()
                .unwrap_or_else(|_| ExitStatus::from_raw(0xff00)),
        })
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        self.stdin = None;
        end_group(&self.child);
        let _ = self.child.wait(); // it was killed, or had ended before
        end_marked(&self.prefix);
    }
}

/// Passes on a program's output, as far as the channel has room.
fn pass_on(mut from: impl Read + Send + 'static, mouth: Mouth, held: Arc<()>) {
    std::thread::spawn(move || {
        let _held = held;
        let (mut buffer, mut bytes) = ([0; 4096], Vec::new());
        let mut lost = 0;
        loop {
            let read = from.read(&mut buffer).unwrap_or(0);
            bytes.extend_from_slice(&buffer[..read]);
            // At the end no rest of a character comes any more.
            let count = if read > 0 { whole(&bytes) } else { bytes.len() };
            if read == 0 && count == 0 {
                break;
            }
            let mut text = String::from_utf8_lossy(&bytes[..count]).into_owned();
            bytes.drain(..count);
            if lost > 0 {
                text.insert_str(
                    0,
                    &format!("\n[{lost} bytes were dropped because they were written too fast]\n"),
                );
            }
            if mouth.try_say(&ToDesk::Log { text }) {
                lost = 0;
            } else {
                lost += count;
            }
        }
    });
}

/// Returns the length of the bytes without an incomplete character at their end.
fn whole(bytes: &[u8]) -> usize {
    match std::str::from_utf8(bytes) {
        Err(error) if error.error_len().is_none() => error.valid_up_to(),
        _ => bytes.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_character_that_has_only_begun_waits_for_its_rest() {
        let text = "2 \u{b5}m".as_bytes();
        assert_eq!(whole(&text[..3]), 2);
        assert_eq!(whole(&text[..4]), 4);
        // What is no character in any case waits for nothing.
        assert_eq!(whole(b"\xff"), 1);
        assert_eq!(whole(b""), 0);
    }
}
