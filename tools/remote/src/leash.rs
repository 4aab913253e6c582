//! Lifeline of an agent: the agent ends when this value is dropped.

use std::io::Read;
use std::net::{Shutdown, TcpStream};
use std::process::Child;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use shared_types::text;

/// Time limit for `ssh` to end once its input is closed.
const PARTING: Duration = Duration::from_secs(1);

/// Lifeline of an agent: the agent ends when this value is dropped.
pub(crate) enum Leash {
    /// `ssh` process that started the agent, with the end of its messages.
    Ssh(Child, Said),
    /// Connection to the agent.
    Connection(TcpStream),
}

impl Leash {
    /// Returns the last messages of `ssh`.
    pub(crate) fn said(&self) -> String {
        match self {
            Self::Ssh(_, messages) => messages.text(),
            Self::Connection(_) => String::new(),
        }
    }
}

impl Drop for Leash {
    fn drop(&mut self) {
        match self {
            Self::Ssh(child, _) => {
                // The sending end closes its input; the agent ends, and `ssh` with it.
                let since = Instant::now();
                while matches!(child.try_wait(), Ok(None)) && since.elapsed() < PARTING {
                    std::thread::sleep(Duration::from_millis(2));
                }
                let _ = child.kill(); // it has ended by now, or never will
                let _ = child.wait();
            }
            Self::Connection(connection) => {
                let _ = connection.shutdown(Shutdown::Both); // it may be closed already
            }
        }
    }
}

/// End of the messages that `ssh`, and the agent through it, wrote to standard error.
#[derive(Clone, Default)]
pub(crate) struct Said(Arc<Mutex<Text>>);

#[derive(Default)]
struct Text {
    tail: Vec<u8>,
    has_ended: bool,
}

impl Said {
    const LONGEST: usize = 16 << 10;

    pub(crate) fn listen(&self, mut from: impl Read + Send + 'static) {
        let shared = self.clone();
        std::thread::spawn(move || {
            let mut buffer = [0; 1024];
            while let Ok(count @ 1..) = from.read(&mut buffer) {
                let tail = &mut shared.lock().tail;
                tail.extend(&buffer[..count]);
                let surplus = tail.len().saturating_sub(Self::LONGEST);
                tail.drain(..surplus);
            }
            shared.lock().has_ended = true;
        });
    }

    fn lock(&self) -> MutexGuard<'_, Text> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn text(&self) -> String {
        let tail = String::from_utf8_lossy(&self.lock().tail).replace("\r\n", "\n"); // line ends of ssh
        text::printable(&tail).into_owned()
    }

    /// Returns the last line, once the stream has ended or the limit is reached.
    pub(crate) fn last_line(&self, limit: Duration) -> Option<String> {
        let since = Instant::now();
        while !self.lock().has_ended && since.elapsed() < limit {
            std::thread::sleep(Duration::from_millis(5));
        }
        let text = self.text();
        let line = text.lines().rev().find(|line| !line.trim().is_empty());
        line.map(|line| line.trim().to_owned())
    }
}
