//! Connection to an authenticated page: messages in both directions without blocking.
//!
//! Used by the pages of a session and of a recording. Knows nothing of their content.

use std::io::ErrorKind;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use tungstenite::protocol::CloseFrame;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Bytes, Error, Message, WebSocket};

use super::message::{self, ClientMessage};

/// Polling interval for messages of the page.
pub(super) const LISTEN: Duration = Duration::from_millis(8);
/// Interval between two pings to the page, and time limit for the reply.
const PING: Duration = Duration::from_secs(5);
const SILENT: Duration = Duration::from_secs(30);
/// Time limit for a page to receive the end.
const END_LIMIT: Duration = Duration::from_secs(2);

/// Connection to a page.
pub(super) struct Wire {
    socket: WebSocket<TcpStream>,
    /// `true` while the socket's buffer is full.
    is_full: bool,
    heard_at: Instant,
    ping_at: Instant,
}

impl Wire {
    pub(super) fn new(socket: WebSocket<TcpStream>) -> Self {
        let now = Instant::now();
        Self {
            socket,
            is_full: false,
            heard_at: now,
            ping_at: now + PING,
        }
    }

    /// Returns `true` while the socket's buffer is full.
    pub(super) const fn is_full(&self) -> bool {
        self.is_full
    }

    /// Sends a message now or as soon as the socket accepts it.
    pub(super) fn say(&mut self, message: Message) -> Result<(), Error> {
        match self.socket.send(message) {
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                self.is_full = true;
                Ok(())
            }
            other => other,
        }
    }

    /// Sends what waits, and a ping from time to time.
    ///
    /// # Errors
    /// If the page disconnected, or has been silent for too long.
    pub(super) fn tend(&mut self) -> Result<(), Error> {
        let now = Instant::now();
        if now > self.heard_at + SILENT {
            return Err(Error::ConnectionClosed);
        }
        self.flush()?;
        if now > self.ping_at {
            self.ping_at = now + PING;
            self.say(Message::Ping(Bytes::new()))?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Error> {
        match self.socket.flush() {
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                self.is_full = true;
                Ok(())
            }
            other => {
                self.is_full = false;
                other
            }
        }
    }

    /// Returns the next message of the page, if there is one.
    ///
    /// # Errors
    /// If the page disconnected, or sent something that the panel's own page never sends.
    pub(super) fn next(&mut self) -> Result<Option<ClientMessage>, Error> {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => {
                    self.heard_at = Instant::now();
                    let message = message::parse(&text).map_err(|_| Error::ConnectionClosed)?;
                    return Ok(Some(message));
                }
                Ok(Message::Binary(_)) => return Err(Error::ConnectionClosed),
                Ok(_) => self.heard_at = Instant::now(),
                Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(error) => return Err(error),
            }
        }
    }

    /// Announces the end and waits a limited time for the page to receive it.
    pub(super) fn part(&mut self, text: &str) -> Result<(), Error> {
        self.say(message::over(text).into())?;
        let frame = CloseFrame {
            code: CloseCode::Away,
            reason: "".into(),
        };
        let _ = self.socket.close(Some(frame)); // the rest is flushed below
        let since = Instant::now();
        while since.elapsed() < END_LIMIT {
            self.flush()?;
            while self.next()?.is_some() {}
            std::thread::sleep(LISTEN);
        }
        Ok(())
    }
}
