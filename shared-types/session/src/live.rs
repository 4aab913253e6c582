//! Sockets of a session: requests to a running plant, and the side that answers.
//!
//! The plant listens on a socket in the session's private folder, on its own thread; `hil` sends requests. Each request
//! and response is one line of JSON. The loop only reads one atomic.

mod listening;

use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::session::SessionInfo;
use shared_types::live::{Request, Response};

pub use listening::{Listening, answer, listen};

/// Name of the socket in the session's folder.
pub const SOCKET: &str = "control";
/// Name of the socket in the session's folder where parameters of plant and law are validated.
pub const OBJECTIONS: &str = "judge";

/// Request without a response.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// Missing listener: the plant does not listen yet, or has ended.
    #[error(
        "the plant of session `{0}` takes no requests, because it is starting or has ended; see `hil sessions`"
    )]
    Absent(String),
    /// Plant that accepts the connection but does not respond.
    #[error(
        "the plant of session `{session}` did not respond within {limit_s} s; is it stopped, or held by a debugger?"
    )]
    Silent {
        /// The session.
        session: String,
        /// Time that the client waited, in s.
        limit_s: u64,
    },
    /// Broken connection.
    #[error("the plant of session `{session}`: {what}")]
    Broken {
        /// The session.
        session: String,
        /// Description of the failure.
        what: String,
    },
}

/// Sends a request to the plant of a session.
///
/// # Errors
/// If the plant does not respond within the limit.
pub fn ask(
    session: &SessionInfo,
    request: &Request,
    limit: Duration,
) -> Result<Response, LiveError> {
    ask_at(session, SOCKET, request, limit)
}

/// Sends a request to a socket of a session: one line of JSON in each direction.
///
/// # Errors
/// If the socket's owner does not respond within the limit.
pub fn ask_at<Q: Serialize, A: DeserializeOwned>(
    session: &SessionInfo,
    socket: &str,
    request: &Q,
    limit: Duration,
) -> Result<A, LiveError> {
    let name = || session.name.clone();
    let broken = |error: std::io::Error| match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => LiveError::Silent {
            session: name(),
            limit_s: limit.as_secs(),
        },
        _ => LiveError::Broken {
            session: name(),
            what: error.to_string(),
        },
    };
    let stream = UnixStream::connect(session.folder.join(socket));
    let mut stream = stream.map_err(|_| LiveError::Absent(name()))?;
    stream.set_read_timeout(Some(limit)).map_err(broken)?;
    stream.set_write_timeout(Some(limit)).map_err(broken)?;
    let mut line = serde_json::to_vec(request).map_err(|e| broken(e.into()))?;
    line.push(b'\n');
    stream.write_all(&line).map_err(broken)?;
    let mut answer = String::new();
    let read = BufReader::new(&stream).read_line(&mut answer);
    if read.map_err(broken)? == 0 {
        return Err(LiveError::Broken {
            session: name(),
            what: "the plant closed the connection without a response".into(),
        });
    }
    serde_json::from_str(&answer).map_err(|e| broken(e.into()))
}
