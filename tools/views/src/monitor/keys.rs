//! Terminal input of the view: keys and size changes.
//!
//! Input is read on its own thread, because crossterm polls forever on a terminal that has been closed. The view's loop
//! checks for a closed terminal itself.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// Handle of the thread.
pub(crate) struct Keys {
    events: Receiver<io::Result<Event>>,
}

impl Keys {
    /// Starts reading the terminal, which must be in raw mode.
    pub(crate) fn start() -> Self {
        let (sender, events) = channel();
        // Not joined: only a key wakes it.
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

    /// Returns the next event if one arrives within the timeout.
    ///
    /// # Errors
    /// If the terminal cannot be read or has been closed.
    pub(crate) fn next(&self, timeout: Duration) -> io::Result<Option<Event>> {
        match self.events.recv_timeout(timeout) {
            Ok(event) => event.map(Some),
            Err(RecvTimeoutError::Timeout) if !input_is_gone() => Ok(None),
            Err(_) => Err(Errno::IO.into()), // the same error as writing gives
        }
    }
}

/// Returns `true` if standard input is a terminal or pipe whose other end is closed.
pub(crate) fn input_is_gone() -> bool {
    let input = io::stdin();
    let mut polled = [PollFd::new(&input, PollFlags::empty())];
    let ready = poll(&mut polled, Some(&Timespec::default()));
    ready.is_ok_and(|number| number > 0)
}
