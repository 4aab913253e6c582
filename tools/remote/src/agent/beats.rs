//! Signs of life of an agent that works on an answer or waits for its turn: a desk that receives none knows that the
//! agent is stopped, not just slow.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::channel::Mouth;
use crate::message::ToDesk;

/// Time between two signs.
const INTERVAL: Duration = Duration::from_millis(250);

/// Signs of life, sent until this value is dropped.
pub(super) struct Beats {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Beats {
    /// Starts sending signs of life.
    pub(super) fn start(mouth: &Mouth) -> Self {
        let (end, ended) = channel();
        let mouth = mouth.clone();
        let thread = std::thread::spawn(move || {
            while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                mouth.try_say(&ToDesk::Beat);
            }
        });
        Self {
            end: Some(end),
            thread: Some(thread),
        }
    }
}

impl Drop for Beats {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // it cannot panic
        }
    }
}
