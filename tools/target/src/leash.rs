//! The leash: what keeps an agent alive. When it goes, the agent ends.

use std::io::Read;
use std::net::{Shutdown, TcpStream};
use std::process::Child;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use shared_types::text;

/// Time that `ssh` may take to end once its input is closed.
const PARTING: Duration = Duration::from_secs(2);

/// What keeps an agent alive: when it goes, the agent ends.
pub(crate) enum Leash {
    /// The `ssh` that started it, and the beginning of what that said.
    Ssh(Child, Said),
    /// The connection itself.
    Connection(TcpStream),
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

/// Beginning of what `ssh`, and the agent before its first word, wrote to standard error.
#[derive(Clone, Default)]
pub(crate) struct Said(Arc<Mutex<Vec<u8>>>);

impl Said {
    const LONGEST: usize = 16 << 10;

    pub(crate) fn listen(&self, mut from: impl Read + Send + 'static) {
        let said = self.clone();
        std::thread::spawn(move || {
            let mut buffer = [0; 1024];
            while let Ok(count @ 1..) = from.read(&mut buffer) {
                let mut said = said.0.lock().unwrap_or_else(PoisonError::into_inner);
                let room = Self::LONGEST.saturating_sub(said.len());
                said.extend(&buffer[..count.min(room)]);
            }
        });
    }

    pub(crate) fn text(&self) -> String {
        let said = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        text::printable(&String::from_utf8_lossy(&said)).into_owned()
    }

    /// The last line, once there is one; waits for it a little.
    pub(crate) fn last_line(&self, limit: Duration) -> Option<String> {
        let since = Instant::now();
        loop {
            let text = self.text();
            let line = text.lines().rev().find(|line| !line.trim().is_empty());
            if line.is_some() || since.elapsed() > limit {
                return line.map(|line| line.trim().to_owned());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
