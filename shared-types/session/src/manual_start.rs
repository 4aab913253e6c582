//! A side that somebody starts by hand, in a debugger for one: the way into its session, and its leash.
//!
//! 1. `hil` listens at a door in the session's folder, writes a [`Token`] into a file beside it that its user
//!    alone can read, and waits.
//! 2. The program connects and shows the token and itself ([`enter`]). `hil` looks at the process behind the
//!    connection, and admits it or says why not.
//! 3. The connection stays. The words come on it that a launched side reads from its standard input, and its
//!    end is the end of `hil`; back goes the exit code, the last that the side says ([`Leash`]).
//!
//! No wait is limited here: a debugger may hold the process wherever it likes.

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
/// Word before the exit code of a side that ends.
const ENDED: &str = "ended";

/// Name of the socket that a side comes in by.
#[must_use]
pub fn door(side: Side) -> String {
    format!("{}.door", side.name())
}

/// Name of the file with the token of a side, which is there once somebody listens at the door.
#[must_use]
pub fn token_file(side: Side) -> String {
    format!("{}.token", side.name())
}

/// Secret of a side of one session: who can read it is of the user whose session that is.
#[derive(Clone, Serialize, Deserialize)]
pub struct Token {
    token: String,
}

impl std::fmt::Debug for Token {
    // Never in a log.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// Makes a token that nobody can guess.
    ///
    /// # Errors
    /// If the system gives no random bytes.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0; 32];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        let token = Hash::from_bytes(bytes).to_hex().to_string();
        Ok(Self { token })
    }

    /// Compares in a time that does not tell how much of it is right.
    #[must_use]
    pub fn is(&self, shown: &Self) -> bool {
        let hash = |token: &Self| blake3::hash(token.token.as_bytes());
        hash(self) == hash(shown)
    }
}

/// Request of a program to be a side.
#[derive(Debug, Serialize, Deserialize)]
pub struct Entry {
    /// Token of the side.
    pub token: Token,
    /// Process that asks.
    pub process: ProcessId,
}

/// Answer to an [`Entry`].
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "response", rename_all = "kebab-case")]
pub enum Admission {
    /// The process is the side from now on.
    Admitted,
    /// The process is not, and is to leave.
    Refused {
        /// Reason for the refusal.
        reason: String,
    },
}

/// Asks to be a side of a session; gives its supervision and its leash.
///
/// # Errors
/// Reason for which it is not, in words.
pub fn enter(session: &SessionInfo, side: Side) -> Result<(Supervision, Leash), String> {
    let (name, role) = (&session.name, side.name());
    let no_place = |error: &dyn std::fmt::Display| {
        format!(
            "session `{name}` waits for no {role} that is started by hand ({error}); `hil run --{role} external` does"
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

/// Connection of a side that was admitted with its `hil`.
#[derive(Debug)]
pub struct Leash {
    stream: UnixStream,
}

impl Leash {
    /// Says how the side ends, as `hil`, which is not its parent, cannot ask the system.
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

/// Reads the exit code that an ended side said; `None` if it ended without a word.
#[must_use]
pub fn last_word(stream: &UnixStream) -> Option<u8> {
    let mut said = String::new();
    // Long enough for every word there is.
    BufReader::new(stream.take(64)).read_line(&mut said).ok()?;
    let code = said.strip_prefix(ENDED)?.trim();
    code.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_itself_and_no_other_and_is_not_shown() {
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
    fn the_last_word_is_the_exit_code_and_a_panic_is_one() {
        for (ends, code) in [
            (Some(0), Some(0)),
            (Some(3), Some(3)),
            // Without a word.
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
