//! The leash: what keeps an agent alive. When it goes, the agent ends.

use std::io::Read;
use std::net::{Shutdown, TcpStream};
use std::process::Child;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use shared_types::text;

/// Time that `ssh` may take to end once its input is closed.
const PARTING: Duration = Duration::from_secs(1);

/// Leash that keeps an agent alive: when it goes, the agent ends.
pub(crate) enum Leash {
    /// The `ssh` that started it, and the last of what that said.
    Ssh(Child, Said),
    /// The connection itself.
    Connection(TcpStream),
}

impl Leash {
    /// The last of what `ssh` said.
    pub(crate) fn said(&self) -> String {
        match self {
            Self::Ssh(_, said) => said.text(),
            Self::Connection(_) => String::new(),
        }
    }
}

impl Drop for Leash {
    fn drop(&mut self) {
        match self {
            Self::Ssh(child, _) => {
                // Its input closes with the mouth; the agent ends, and `ssh` with it.
                let since = Instant::now();
                while matches!(child.try_wait(), Ok(None)) && since.elapsed() < PARTING {
                    std::thread::sleep(Duration::from_millis(2));
                }
                let _ = child.kill(); // it has ended by now, or never would
                let _ = child.wait();
            }
            Self::Connection(connection) => {
                let _ = connection.shutdown(Shutdown::Both); // it may be closed by now
            }
        }
    }
}

/// The last of what `ssh`, and the agent through it, wrote to standard error.
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
        let said = self.clone();
        std::thread::spawn(move || {
            let mut buffer = [0; 1024];
            while let Ok(count @ 1..) = from.read(&mut buffer) {
                let tail = &mut said.lock().tail;
                tail.extend(&buffer[..count]);
                let surplus = tail.len().saturating_sub(Self::LONGEST);
                tail.drain(..surplus);
            }
            said.lock().has_ended = true;
        });
    }

    fn lock(&self) -> MutexGuard<'_, Text> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn text(&self) -> String {
        let tail = String::from_utf8_lossy(&self.lock().tail).replace("\r\n", "\n"); // ssh ends its lines so
        text::printable(&tail).into_owned()
    }

    /// The last line, once all is said or the limit is over.
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
