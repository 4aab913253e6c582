//! Channel between desk and agent: messages, parts of files and, where no datagrams get through, packets, in order,
//! over any byte stream.
//!
//! A frame is its length (32 bits, little-endian), its kind, and its content. Over `ssh` nothing is added; over a plain
//! connection each frame is encrypted and authenticated. Received data is bounded before it is read, and validated
//! before it is used.

use std::io::{self, BufReader, Read, Write};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::seal::Seal;

/// Maximum content of a frame in bytes.
const LONGEST_FRAME: usize = 32 << 10;
/// Maximum length of a message of several frames; the description of 100 plants with 512 signals is shorter.
const LONGEST_MESSAGE: usize = 17 << 20;
/// Maximum number of bytes added by encryption and the kind.
const AROUND: usize = 64;
/// Capacity of the receive queue; a full queue blocks the sender.
const HEARD: usize = 16;
/// Capacity of the send queue in frames. A packet is dropped if the queue is full, like a datagram.
const WAITING: usize = 256;

/// Kind of a frame. The highest bit marks a frame that is continued by another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum FrameContent {
    Message = 1,
    Part = 2,
    Packet = 3,
}

const MORE: u8 = 0x80;

/// Item received through the channel.
#[derive(Debug)]
pub(crate) enum Heard<M> {
    /// A message.
    Message(M),
    /// Part of a file.
    Part(Vec<u8>),
    /// Packet, as in a datagram.
    Packet(Vec<u8>),
    /// End of the channel, with the reason.
    Closed(String),
}

/// Receiving end, on a thread of its own.
pub(crate) struct Ear<M>(Receiver<Heard<M>>);

/// Sending end, on a thread of its own, so that senders never wait for the other end.
#[derive(Clone)]
pub(crate) struct Mouth(SyncSender<(FrameContent, Vec<u8>)>);

impl<M: DeserializeOwned + Send + 'static> Ear<M> {
    /// Starts receiving; `ring` is called after each received item.
    pub(crate) fn listen(
        from: impl Read + Send + 'static,
        seal: Option<Arc<Seal>>,
        ring: impl Fn() + Send + 'static,
    ) -> Self {
        let (sender, receiver) = sync_channel(HEARD);
        std::thread::spawn(move || {
            let mut reader = Reader {
                from: BufReader::new(from),
                seal,
                number: 0,
            };
            loop {
                let next = reader
                    .next()
                    .unwrap_or_else(|error| Heard::Closed(error.to_string()));
                let is_closed = matches!(next, Heard::Closed(_));
                let is_gone = sender.send(next).is_err();
                ring();
                if is_closed || is_gone {
                    return;
                }
            }
        });
        Self(receiver)
    }

    /// Returns the next item, if there is one.
    #[must_use]
    pub(crate) fn next(&self) -> Option<Heard<M>> {
        self.0.try_recv().ok()
    }

    /// Waits for the next item, up to the limit.
    #[must_use]
    pub(crate) fn wait(&self, limit: std::time::Duration) -> Option<Heard<M>> {
        self.0.recv_timeout(limit).ok()
    }
}

struct Reader<R> {
    from: R,
    seal: Option<Arc<Seal>>,
    number: u64,
}

impl<R: Read> Reader<R> {
    fn next<M: DeserializeOwned>(&mut self) -> io::Result<Heard<M>> {
        let mut whole = Vec::new();
        loop {
            let (kind, content) = self.frame()?;
            if whole.len() + content.len() > LONGEST_MESSAGE {
                return Err(wrong("message too long"));
            }
            whole.extend(content);
            if kind & MORE != 0 {
                continue;
            }
            const MESSAGE: u8 = FrameContent::Message as u8;
            const PART: u8 = FrameContent::Part as u8;
            const PACKET: u8 = FrameContent::Packet as u8;
            return match kind {
                MESSAGE => serde_json::from_slice(&whole)
                    .map(Heard::Message)
                    .map_err(|_| wrong("malformed message")),
                PART => Ok(Heard::Part(whole)),
                PACKET => Ok(Heard::Packet(whole)),
                _ => Err(wrong("unknown kind of frame")),
            };
        }
    }

    fn frame(&mut self) -> io::Result<(u8, Vec<u8>)> {
        let mut length = [0; 4];
        self.from
            .read_exact(&mut length)
            .map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof => {
                    io::Error::new(error.kind(), "closed by the other end")
                }
                _ => error,
            })?;
        let length = u32::from_le_bytes(length) as usize;
        if length == 0 || length > LONGEST_FRAME + AROUND {
            return Err(wrong("impossible frame length"));
        }
        let mut frame = vec![0; length];
        self.from.read_exact(&mut frame)?;
        if let Some(seal) = &self.seal {
            let mut content = Vec::new();
            let opened = seal.open(self.number, &frame, &mut content);
            opened.map_err(|unsealed| wrong(&unsealed.to_string()))?;
            self.number += 1;
            frame = content;
        }
        match frame.split_first() {
            Some((kind, content)) => Ok((*kind, content.to_vec())),
            None => Err(wrong("empty frame")),
        }
    }
}

fn wrong(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

impl Mouth {
    /// Starts sending to a writer.
    pub(crate) fn speak(into: impl Write + Send + 'static, seal: Option<Arc<Seal>>) -> Self {
        let (sender, frames) = sync_channel::<(FrameContent, Vec<u8>)>(WAITING);
        std::thread::spawn(move || {
            let mut writer = Writer {
                into,
                seal,
                number: 0,
            };
            while let Ok((kind, content)) = frames.recv() {
                if writer.write(kind, &content).is_err() {
                    return; // the receiving end reports the closed channel
                }
            }
        });
        Self(sender)
    }

    /// Sends a message; waits while the queue is full.
    ///
    /// # Panics
    /// Never: messages are plain data, which always serialises.
    pub(crate) fn say(&self, message: &impl Serialize) {
        let content = serde_json::to_vec(message).expect("plain data serialises");
        let _ = self.0.send((FrameContent::Message, content)); // if closed, the receiving end reports it
    }

    /// Sends a message unless the queue is full; returns `false` if the queue is full.
    ///
    /// # Panics
    /// Never: messages are plain data, which always serialises.
    pub(crate) fn try_say(&self, message: &impl Serialize) -> bool {
        let content = serde_json::to_vec(message).expect("plain data serialises");
        !matches!(
            self.0.try_send((FrameContent::Message, content)),
            Err(TrySendError::Full(_))
        )
    }

    /// Sends a part of a file.
    pub(crate) fn part(&self, part: Vec<u8>) {
        let _ = self.0.send((FrameContent::Part, part)); // if closed, the receiving end reports it
    }

    /// Sends a packet, or drops it if the queue is full.
    pub(crate) fn packet(&self, packet: &[u8]) {
        let _ = self.0.try_send((FrameContent::Packet, packet.to_vec()));
    }
}

struct Writer<W> {
    into: W,
    seal: Option<Arc<Seal>>,
    number: u64,
}

impl<W: Write> Writer<W> {
    fn write(&mut self, kind: FrameContent, content: &[u8]) -> io::Result<()> {
        let mut pieces = content.chunks(LONGEST_FRAME).peekable();
        if pieces.peek().is_none() {
            self.frame(kind as u8, &[])?;
        }
        while let Some(piece) = pieces.next() {
            let more = if pieces.peek().is_some() { MORE } else { 0 };
            self.frame(kind as u8 | more, piece)?;
        }
        self.into.flush()
    }

    fn frame(&mut self, kind: u8, piece: &[u8]) -> io::Result<()> {
        let mut plain = Vec::with_capacity(piece.len() + AROUND);
        plain.push(kind);
        plain.extend(piece);
        if let Some(seal) = &self.seal {
            let mut sealed = Vec::with_capacity(plain.len() + AROUND);
            seal.close(self.number, &plain, &mut sealed)
                .map_err(io::Error::other)?;
            self.number += 1;
            plain = sealed;
        }
        // In one write: two would wait for each other on a connection.
        let mut frame = (plain.len() as u32).to_le_bytes().to_vec();
        frame.extend(plain);
        self.into.write_all(&frame)
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;
    use std::time::Duration;

    use super::*;
    use crate::seal::{Key, answer, begin};

    const LONG: Duration = Duration::from_secs(20);

    fn text(ear: &Ear<String>) -> String {
        match ear.wait(LONG) {
            Some(Heard::Message(text)) => format!("message of {}", text.len()),
            Some(Heard::Part(part)) => format!("part of {}", part.len()),
            Some(Heard::Packet(packet)) => format!("packet of {}", packet.len()),
            Some(Heard::Closed(why)) => format!("closed: {why}"),
            None => "nothing".into(),
        }
    }

    fn seals() -> [Arc<Seal>; 2] {
        let key = Key::random().expect("random");
        let (begun, first) = begin(&key, b"").expect("begins");
        let (theirs, second) = answer(&key, b"", &first).expect("answers");
        [begun.end(&second).expect("ends"), theirs].map(Arc::new)
    }

    fn through(mouth_seal: Option<Arc<Seal>>, ear_seal: Option<Arc<Seal>>) -> (Mouth, Ear<String>) {
        let (one, other) = UnixStream::pair().expect("a pair");
        (
            Mouth::speak(one, mouth_seal),
            Ear::listen(other, ear_seal, || ()),
        )
    }

    #[test]
    fn items_of_any_length_arrive_in_order() {
        let [ours, theirs] = seals();
        for (mouth, ear) in [through(None, None), through(Some(ours), Some(theirs))] {
            mouth.say(&"x".repeat(100_000));
            mouth.part(vec![1; LONGEST_FRAME]);
            mouth.part(Vec::new());
            mouth.packet(&[2; 5]);
            drop(mouth);
            let all: Vec<String> = (0..5).map(|_| text(&ear)).collect();
            let part = format!("part of {LONGEST_FRAME}");
            let expected = [
                "message of 100000",
                &part,
                "part of 0",
                "packet of 5",
                "closed: closed by the other end",
            ];
            assert_eq!(all, expected);
        }
    }

    #[test]
    fn another_seal_closes_the_channel() {
        let ([ours, _], [_, others]) = (seals(), seals());
        let (mouth, ear) = through(Some(ours), Some(others));
        mouth.say(&"a");
        assert!(text(&ear).starts_with("closed: authentication failed"));
    }

    #[test]
    fn garbage_closes_the_channel_and_takes_no_memory() {
        let too_long = [0xff, 0xff, 0xff, 0xff, 1];
        for garbage in [
            &too_long[..],
            &[0, 0, 0, 0],
            &[1, 0, 0, 0, 9],
            &[2, 0, 0, 0, 1, b'{'],
        ] {
            let (mut one, other) = UnixStream::pair().expect("a pair");
            let ear: Ear<String> = Ear::listen(other, None, || ());
            one.write_all(garbage).expect("written");
            assert!(text(&ear).starts_with("closed: "), "{garbage:?}");
        }
    }
}
