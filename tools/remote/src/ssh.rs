//! Start of an agent through the user's own `ssh`: keys, configuration and jump hosts all work.
//!
//! The remote command is a constant. Everything else is sent through its standard input, once its marker has been
//! received, so nothing from a scenario or a command line reaches the remote shell. The agent's file is stored on the
//! target under its SHA-256, which is verified before every start.

use std::io::{self, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::io::Errno;
use rustix::time::Timespec;
use sha2::{Digest, Sha256};
use shared_types::text;

use crate::channel::{Ear, Mouth};
use crate::leash::{Leash, Said};
use crate::message::ToDesk;
use crate::way::{TargetError, Way};

/// Script of the remote command, for any POSIX shell. Contains no single quotes, so that it can be enclosed in
/// them.
const SCRIPT: &str = r#"umask 077; c="${XDG_CACHE_HOME:-$HOME/.cache}/hil-target"; mkdir -p "$c" && chmod 700 "$c" && [ -O "$c" ] || { echo "HIL-TARGET no-cache $c"; exit 1; }; echo "HIL-TARGET 1 $(uname -m)"; read -r h n || exit 1; case "$h" in *[!0-9a-f]*|"") exit 1;; esac; f="$c/$h"; ok() { [ -f "$1" ] && [ -O "$1" ] && [ "$(sha256sum <"$1" | cut -c1-64)" = "$h" ]; }; if ok "$f"; then echo have; else p="$f.part$$"; echo send; head -c "$n" >"$p" && sync; if ok "$p" && chmod 500 "$p" && mv -f "$p" "$f"; then echo stored; else rm -f "$p"; echo broken; exit 1; fi; fi; exec "$f" agent"#;
/// Prefix of the line that announces the script.
const MARKER: &str = "HIL-TARGET ";
/// Maximum number of bytes that a noisy profile may print before the marker.
const MOST_NOISE: usize = 64 << 10;
/// Time limit for `ssh` to connect, in s.
const CONNECT_S: u32 = 10;
/// Polling interval for an interruption.
const LOOK: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 50_000_000,
};
/// Time limit for the script to start, and to answer.
const SPEAKS: Duration = Duration::from_secs(20);
/// Time limit for sending a part of the agent, and for the arrival of the last part.
const COPIES: Duration = Duration::from_secs(60);

type Opened = (Ear<ToDesk>, Mouth, Leash);

/// Starts an agent on a host.
pub(crate) fn open(
    way: &Way,
    host: &str,
    ring: Box<dyn Fn() + Send>,
    is_interrupted: &dyn Fn() -> bool,
) -> Result<Opened, TargetError> {
    use std::os::unix::process::CommandExt;
    let mut child = Command::new("ssh")
        .args([
            "-T",
            "-oBatchMode=yes",
            "-oClearAllForwardings=yes",
            // An existing connection is used; none of a run outlives it.
            "-oControlMaster=no",
            "-oForwardAgent=no",
            "-oForwardX11=no",
            "-oRemoteCommand=none",
        ])
        .arg(format!("-oConnectTimeout={CONNECT_S}"))
        // A dead line is detected within this time, in any state.
        .args(["-oServerAliveInterval=5", "-oServerAliveCountMax=2"])
        .args(["--", host])
        .arg(format!("exec /bin/sh -c '{SCRIPT}'"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn()
        .map_err(|error| way.infrastructure(format!("cannot start ssh: {error}")))?;
    let messages = Said::default();
    if let Some(stderr) = child.stderr.take() {
        messages.listen(stderr);
    }
    let (Some(mut input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(way.infrastructure("ssh has no input or output"));
    };
    let mut start = Start {
        way,
        output,
        child,
        messages,
        is_interrupted,
    };
    if let Err(error) = start.up_to_agent(&mut input) {
        drop(input);
        let _ = start.child.kill(); // it may have ended by itself
        let _ = start.child.wait();
        return Err(error);
    }
    let Start {
        output,
        child,
        messages,
        ..
    } = start;
    let mouth = Mouth::speak(input, None);
    let ear = Ear::listen(output, None, ring);
    Ok((ear, mouth, Leash::Ssh(child, messages)))
}

struct Start<'a> {
    way: &'a Way,
    output: ChildStdout,
    child: Child,
    messages: Said,
    is_interrupted: &'a dyn Fn() -> bool,
}

impl Start<'_> {
    /// Exchanges messages with the script until it becomes the agent.
    fn up_to_agent(&mut self, input: &mut ChildStdin) -> Result<(), TargetError> {
        let way = self.way;
        let machine = self.marker()?;
        let agent = way.agent_for(&machine)?;
        let content = std::fs::read(&agent).map_err(|error| {
            way.infrastructure(format!("cannot read {}: {error}", agent.display()))
        })?;
        let hash = crate::message::to_hex(&Sha256::digest(&content));
        let closed =
            |_: io::Error| way.infrastructure("connection lost while the agent was started");
        writeln!(input, "{hash} {}", content.len())
            .and_then(|()| input.flush())
            .map_err(closed)?;
        if self.answer(SPEAKS)? == "send" {
            self.copy(input, &content)?;
            if self.answer(COPIES)? != "stored" {
                return Err(way.infrastructure(
                    "the agent was not copied completely; is there room in its cache folder?",
                ));
            }
        }
        Ok(())
    }

    /// Sends the agent's file. A script that has ended reports the reason in its answer.
    fn copy(&self, input: &mut ChildStdin, content: &[u8]) -> Result<(), TargetError> {
        let failed = |error: Errno| self.way.infrastructure(error);
        fcntl_setfl(&*input, OFlags::NONBLOCK).map_err(failed)?;
        let (mut remaining, mut since) = (content, Instant::now());
        while !remaining.is_empty() {
            if (self.is_interrupted)() {
                return Err(TargetError::Interrupted);
            }
            if since.elapsed() > COPIES {
                let limit_s = COPIES.as_secs();
                let reason = format!("sending the agent made no progress for {limit_s} s");
                return Err(self.way.infrastructure(reason));
            }
            match input.write(remaining) {
                Ok(count) => (remaining, since) = (&remaining[count..], Instant::now()),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    let mut ready = [PollFd::new(&*input, PollFlags::OUT)];
                    let _ = poll(&mut ready, Some(&LOOK)); // a signal means polling again
                }
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => break,
                Err(error) => return Err(self.way.infrastructure(error)),
            }
        }
        fcntl_setfl(&*input, OFlags::empty()).map_err(failed)
    }

    /// Reads up to the marker; returns the machine type.
    fn marker(&mut self) -> Result<String, TargetError> {
        let (mut noise, since) = (0, Instant::now());
        loop {
            if since.elapsed() > SPEAKS {
                return Err(self
                    .way
                    .usage("its shell profile does not finish; it must end without input"));
            }
            let line = self.line(SPEAKS)?;
            // A profile may print an unterminated line before it.
            if let Some((_, marked)) = line.split_once(MARKER) {
                if let Some(folder) = marked.strip_prefix("no-cache ") {
                    return Err(self.way.usage(format!(
                        "its cache folder {folder} cannot be created, or is accessible to other users"
                    )));
                }
                let machine = marked.strip_prefix("1 ").unwrap_or_default().trim();
                let is_name = !machine.is_empty()
                    && machine
                        .chars()
                        .all(|c| c.is_ascii_alphanumeric() || c == '_');
                return match is_name {
                    true => Ok(machine.to_owned()),
                    false => Err(self
                        .way
                        .infrastructure("it does not report its machine type")),
                };
            }
            noise += line.len() + 1;
            if noise > MOST_NOISE {
                return Err(self.way.usage("its shell profile prints without end; it must print nothing without a terminal"));
            }
        }
    }

    fn answer(&mut self, limit: Duration) -> Result<String, TargetError> {
        let line = self.line(limit)?;
        match line.as_str() {
            "have" | "send" | "stored" | "broken" => Ok(line),
            _ => Err(self
                .way
                .infrastructure(format!("unexpected answer `{}`", text::line(&line)))),
        }
    }

    /// Reads a line byte by byte, because the data after the last line belongs to the agent.
    fn line(&mut self, limit: Duration) -> Result<String, TargetError> {
        let (mut line, since) = (Vec::new(), Instant::now());
        loop {
            if (self.is_interrupted)() {
                return Err(TargetError::Interrupted);
            }
            if since.elapsed() > limit {
                let limit_s = limit.as_secs();
                return Err(self
                    .way
                    .infrastructure(format!("no answer within {limit_s} s")));
            }
            let mut ready = [PollFd::new(&self.output, PollFlags::IN)];
            if !matches!(poll(&mut ready, Some(&LOOK)), Ok(1..)) {
                continue;
            }
            let mut byte = [0];
            match self.output.read(&mut byte) {
                Ok(1..) if byte[0] == b'\n' => {
                    let line = String::from_utf8_lossy(&line);
                    return Ok(text::line(line.trim_end_matches('\r')));
                }
                Ok(1..) if line.len() < MOST_NOISE => line.push(byte[0]),
                Ok(1..) => return Err(self.way.usage("its shell profile prints without end")),
                Ok(0) => return Err(self.refused()),
                Err(error) => return Err(self.way.infrastructure(error)),
            }
        }
    }

    /// Describes the failure of `ssh`.
    fn refused(&self) -> TargetError {
        let last = self.messages.last_line(Duration::from_millis(500));
        let text = self.messages.text();
        let reason = last.unwrap_or_else(|| "ssh ended without a message".into());
        let is_usage = [
            "Could not resolve hostname",
            "Host key verification failed",
            "host key",
            "Permission denied",
            "Bad configuration option",
            "no such identity",
        ]
        .iter()
        .any(|phrase| text.contains(phrase));
        if is_usage {
            self.way.usage(reason)
        } else {
            self.way.infrastructure(reason)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_script_has_no_single_quotes_and_is_one_line() {
        assert!(!SCRIPT.contains('\'') && !SCRIPT.contains('\n'));
    }
}
