//! Whole messages over a UNIX stream that never blocks: bytes that cannot be sent now are sent later.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

use shared_types::link::LinkError;

/// Longest message: far more than any that plant and controller exchange.
const LONGEST: usize = 16 << 20;
/// Size of the length before a message, in bytes.
const HEAD: usize = 4;

/// End of a stream of messages.
pub(crate) struct Socket {
    name: String,
    /// Listener for the other end, until it has connected.
    listener: Option<UnixListener>,
    stream: Option<UnixStream>,
    /// Messages that the system has not accepted yet, each with its head, and the accepted bytes of the first.
    outgoing: VecDeque<Vec<u8>>,
    written: usize,
    /// Received bytes that do not form a whole message yet.
    incoming: Vec<u8>,
}

impl Socket {
    fn new(path: &Path) -> Self {
        Self {
            name: path.display().to_string(),
            listener: None,
            stream: None,
            outgoing: VecDeque::new(),
            written: 0,
            incoming: Vec::new(),
        }
    }

    /// Creates the plant's end, to which one controller may connect.
    pub(crate) fn listen(path: &Path) -> Result<Self, LinkError> {
        let mut socket = Self::new(path);
        let listener = UnixListener::bind(path).map_err(|error| match error.kind() {
            ErrorKind::AddrInUse => LinkError::Taken {
                service: socket.name.clone(),
                role: "plant",
            },
            _ => socket.failed(&error),
        })?;
        let set = listener.set_nonblocking(true);
        set.map_err(|error| socket.failed(&error))?;
        socket.listener = Some(listener);
        Ok(socket)
    }

    /// Creates a controller's end.
    pub(crate) fn connect(path: &Path) -> Result<Self, LinkError> {
        let mut socket = Self::new(path);
        let stream = UnixStream::connect(path).map_err(|error| match error.kind() {
            ErrorKind::NotFound | ErrorKind::ConnectionRefused => LinkError::Absent {
                service: socket.name.clone(),
                reason: error.to_string(),
            },
            _ => socket.failed(&error),
        })?;
        socket.begin(stream)?;
        Ok(socket)
    }

    fn failed(&self, error: &std::io::Error) -> LinkError {
        LinkError::Transport {
            service: self.name.clone(),
            reason: error.to_string(),
        }
    }

    fn begin(&mut self, stream: UnixStream) -> Result<(), LinkError> {
        let set = stream.set_nonblocking(true);
        set.map_err(|error| self.failed(&error))?;
        (self.listener, self.stream) = (None, Some(stream));
        Ok(())
    }

    /// Queues a message behind all others.
    pub(crate) fn queue(&mut self, message: &[u8]) -> Result<(), LinkError> {
        let length = (message.len() as u32).to_le_bytes();
        self.outgoing.push_back([&length, message].concat());
        self.flush()
    }

    /// Sends a message in place of all waiting ones; a message that is partly sent is completed first.
    pub(crate) fn replace(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.outgoing.truncate(usize::from(self.written > 0));
        self.queue(message)
    }

    /// Returns the next received message.
    pub(crate) fn next(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        self.flush()?;
        self.fill()?;
        let Some(head) = self.incoming.first_chunk::<HEAD>() else {
            return Ok(None);
        };
        let end = HEAD + u32::from_le_bytes(*head) as usize;
        if end > LONGEST {
            return Err(LinkError::Transport {
                service: self.name.clone(),
                reason: format!("a message of {end} bytes"),
            });
        }
        if self.incoming.len() < end {
            return Ok(None);
        }
        let message = self.incoming.drain(..end).skip(HEAD).collect();
        Ok(Some(message))
    }

    /// Sends as many bytes as the system accepts now.
    fn flush(&mut self) -> Result<(), LinkError> {
        if let Some(listener) = &self.listener {
            match listener.accept() {
                Ok((stream, _)) => self.begin(stream)?,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(self.failed(&error)),
            }
        }
        while let (Some(stream), Some(first)) = (&mut self.stream, self.outgoing.front()) {
            match stream.write(&first[self.written..]) {
                Ok(count) => self.written += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) if is_death(&error) => self.outgoing.clear(),
                Err(error) => return Err(self.failed(&error)),
            }
            if (self.outgoing.front()).is_none_or(|first| self.written == first.len()) {
                self.outgoing.pop_front();
                self.written = 0;
            }
        }
        Ok(())
    }

    /// Reads available bytes, but not endlessly from an end that sends faster.
    fn fill(&mut self) -> Result<(), LinkError> {
        let mut bytes = [0; 1 << 16];
        while let Some(stream) = &mut self.stream
            && self.incoming.len() <= LONGEST
        {
            match stream.read(&mut bytes) {
                Ok(0) => return Ok(()),
                Ok(count) => self.incoming.extend(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock || is_death(&error) => {
                    return Ok(());
                }
                Err(error) => return Err(self.failed(&error)),
            }
        }
        Ok(())
    }
}

/// Treats the death of the other end as silence: the process that started it notices, and the run may continue.
fn is_death(error: &std::io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::BrokenPipe | ErrorKind::ConnectionReset
    )
}
