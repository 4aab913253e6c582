//! Input of the view: keys, and the new size of the terminal.
//!
//! It is read on a thread of its own, because crossterm never stops looking for keys in a terminal that
//! is gone. Whether it is gone, the loop of the view looks itself.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// The thread as its owner sees it.
pub(crate) struct Keys {
    events: Receiver<io::Result<Event>>,
}

impl Keys {
    /// Reads the terminal from now on. It must be in raw mode.
    #[must_use]
    pub(crate) fn start() -> Self {
        let (sender, events) = channel();
        // Not joined: nothing wakes it but a key.
        std::thread::spawn(move || {
            loop {
                let event = event::read();
                let is_last = event.is_err();
                if sender.send(event).is_err() || is_last {
                    return;
                }
            }
        });
        Self { events }
    }

    /// The next event, if one comes in time.
    ///
    /// # Errors
    /// If the terminal cannot be read, or is gone.
    pub(crate) fn next(&self, timeout: Duration) -> io::Result<Option<Event>> {
        match self.events.recv_timeout(timeout) {
            Ok(event) => event.map(Some),
            Err(RecvTimeoutError::Timeout) if !input_is_gone() => Ok(None),
            Err(_) => Err(Errno::IO.into()), // as when it is written to
        }
    }
}

/// Reports a standard input, a terminal or a pipe, whose other end is closed.
#[must_use]
pub(crate) fn input_is_gone() -> bool {
    let input = io::stdin();
    let mut looked = [PollFd::new(&input, PollFlags::empty())];
    let found = poll(&mut looked, Some(&Timespec::default()));
    found.is_ok_and(|with_something_to_tell| with_something_to_tell > 0)
}
