//! Manual start of a side, for example in a debugger: joining a session, and the lifeline.
//!
//! 1. `hil` listens on a socket in the session's folder, writes a [`Token`] to a file in the same folder that only its
//!    user can read, and waits.
//! 2. The program connects and presents the token and its process ([`enter`]). `hil` checks the process behind the
//!    connection, then admits it or states the reason for the refusal.
//! 3. The connection stays open. It carries the messages that a launched side reads from its standard input, and closes
//!    when `hil` ends. In the other direction it carries the side's exit code as its last message ([`Leash`]).
//!
//! No step has a time limit, because a debugger may stop the process anywhere.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;

use blake3::Hash;
use serde::{Deserialize, Serialize};

use crate::process::ProcessId;
use crate::session::SessionInfo;
use crate::supervision::Supervision;
use shared_types::side::Side;

/// Exit code of a Rust program that panicked.
pub const PANIC: u8 = 101;
/// Word that precedes the exit code of an ending side.
const ENDED: &str = "ended";

/// Returns the name of the socket to which a side connects.
#[must_use]
pub fn door(side: Side) -> String {
    format!("{}.door", side.name())
}

/// Returns the name of a side's token file, which exists while the socket is open.
#[must_use]
pub fn token_file(side: Side) -> String {
    format!("{}.token", side.name())
}

/// Secret of one side of one session; only the session's user can read it.
#[derive(Clone, Serialize, Deserialize)]
pub struct Token {
    token: String,
}

impl std::fmt::Debug for Token {
    // Must not appear in a log.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// Creates an unguessable token.
    ///
    /// # Errors
    /// If the system provides no random bytes.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0; 32];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        let token = Hash::from_bytes(bytes).to_hex().to_string();
        Ok(Self { token })
    }

    /// Compares two tokens in constant time.
    #[must_use]
    pub fn is(&self, other: &Self) -> bool {
        let hash = |token: &Self| blake3::hash(token.token.as_bytes());
        hash(self) == hash(other)
    }
}

/// Request of a program to become a side.
#[derive(Debug, Serialize, Deserialize)]
pub struct Entry {
    /// Token of the side.
    pub token: Token,
    /// Requesting process.
    pub process: ProcessId,
}

/// Answer to an [`Entry`].
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "response", rename_all = "kebab-case")]
pub enum Admission {
    /// The process is now the side.
    Admitted,
    /// The process is refused and must exit.
    Refused {
        /// Reason for the refusal.
        reason: String,
    },
}

/// Requests to become a side of a session; returns the side's supervision and lifeline.
///
/// # Errors
/// If the request is refused or the session cannot be reached; the error states the reason.
pub fn enter(session: &SessionInfo, side: Side) -> Result<(Supervision, Leash), String> {
    let (name, role) = (&session.name, side.name());
    let no_place = |error: &dyn std::fmt::Display| {
        format!(
            "session `{name}` expects no manually started {role} ({error}); start the run with `hil run --{role} external`"
        )
    };
    let token = session.read_file(&token_file(side));
    let token = token.map_err(|error| no_place(&error))?;
    let stream = UnixStream::connect(session.folder.join(door(side)));
    let mut stream = stream.map_err(|error| no_place(&error))?;
    let entry = Entry {
        token,
        process: ProcessId::own(),
    };
    let mut line = serde_json::to_string(&entry).map_err(|error| error.to_string())?;
    line.push('\n');
    let broken = |error: std::io::Error| format!("session `{name}` does not answer: {error}");
    stream.write_all(line.as_bytes()).map_err(broken)?;
    let leash = Leash {
        stream: stream.try_clone().map_err(broken)?,
    };
    let mut words = BufReader::new(stream);
    let mut answer = String::new();
    if words.read_line(&mut answer).map_err(broken)? == 0 {
        return Err(broken(ErrorKind::UnexpectedEof.into()));
    }
    match serde_json::from_str(&answer) {
        Ok(Admission::Admitted) => Ok((Supervision::from_words(words), leash)),
        Ok(Admission::Refused { reason }) => Err(reason),
        Err(error) => Err(format!("session `{name}` does not answer: {error}")),
    }
}

/// Connection between an admitted side and its `hil`.
#[derive(Debug)]
pub struct Leash {
    stream: UnixStream,
}

impl Leash {
    /// Sends the side's exit code: `hil` is not its parent and cannot obtain the code from the system.
    pub fn ends(mut self, code: u8) {
        self.say(code);
    }

    fn say(&mut self, code: u8) {
        let _ = writeln!(self.stream, "{ENDED} {code}"); // nobody may be left to hear it
    }
}

impl Drop for Leash {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.say(PANIC);
        }
    }
}

/// Reads the exit code that an ended side sent; `None` if it sent no code.
#[must_use]
pub fn last_word(stream: &UnixStream) -> Option<u8> {
    let mut line = String::new();
    // Longer than any valid message.
    BufReader::new(stream.take(64)).read_line(&mut line).ok()?;
    let code = line.strip_prefix(ENDED)?.trim();
    code.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_equals_only_itself_and_is_not_printed() {
        let (own, other) = (Token::random(), Token::random());
        let (own, other) = (own.expect("made"), other.expect("made"));
        assert!(own.is(&own.clone()) && !own.is(&other));
        let none = Token {
            token: String::new(),
        };
        assert!(!own.is(&none));
        assert_eq!(own.token.len(), 64);
        assert!(!format!("{own:?}").contains(&own.token));
    }

    #[test]
    fn the_last_message_is_the_exit_code_also_after_a_panic() {
        for (ends, code) in [
            (Some(0), Some(0)),
            (Some(3), Some(3)),
            // No message at all.
            (None, None),
        ] {
            let (hil, stream) = UnixStream::pair().expect("a pair");
            let leash = Leash { stream };
            match ends {
                Some(code) => leash.ends(code),
                None => drop(leash),
            }
            assert_eq!(last_word(&hil), code);
        }
        let (hil, stream) = UnixStream::pair().expect("a pair");
        let panics = std::thread::spawn(move || {
            let _leash = Leash { stream };
            panic!("as a law may");
        });
        assert!(panics.join().is_err());
        assert_eq!(last_word(&hil), Some(PANIC));
    }
}
