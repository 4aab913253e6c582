//! The record stream: from the plant to its recorder and other observers.
//!
//! The plant's end is a [`RecordSink`], the observer's a [`RecordSource`]. The observer returns credit, the number of
//! its last contiguous item; a plant that must not lose records checks the credit at intervals and holds the loop back
//! when the buffer could overflow. Two implementations exist: a ring within one process, and iceoryx2 shared memory in
//! `hil-session`.
//! Both pass a public suite, [`conformance`](mod@crate::conformance).

pub mod in_process;

use crate::link::LinkError;
use crate::record::{Event, RecordLayout};

/// Maximum size of an event in bytes; the event of a fault with the longest permitted table is smaller.
const LONGEST_EVENT: usize = 64 << 20;

/// Kind of an item, a number on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum ItemKind {
    /// A record.
    Record = 1,
    /// A piece of an event's JSON; the last piece completes it.
    EventPart = 2,
    /// The last piece of an event.
    EventEnd = 3,
}

impl ItemKind {
    const fn from_wire(number: u64) -> Option<Self> {
        match number {
            1 => Some(Self::Record),
            2 => Some(Self::EventPart),
            3 => Some(Self::EventEnd),
            _ => None,
        }
    }
}

/// Backpressure that a plant accepts from its recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backpressure {
    /// No wait; no recorder is needed.
    None,
    /// Wait only until the recorder is attached. A recorder that is too slow loses records and counts them.
    AtStart,
    /// Wait at every step rather than lose a record.
    Always,
}

/// The plant's end.
pub trait RecordSink {
    /// Opens the stream for records of this layout, before step 0.
    ///
    /// # Errors
    /// If the transport failed.
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError>;

    /// Returns `true` if all items of a step can be published without losing one.
    ///
    /// # Errors
    /// If the transport failed.
    fn has_room(&mut self) -> Result<bool, LinkError>;

    /// Returns the numbers of items sent and of items acknowledged by the recorder. Always equal unless the recorder is
    /// another process.
    ///
    /// # Errors
    /// If the transport failed.
    fn sent_and_taken(&mut self) -> Result<(u64, u64), LinkError> {
        Ok((0, 0))
    }

    /// Publishes a record.
    ///
    /// # Errors
    /// If the transport failed.
    fn record(&mut self, words: &[u64]) -> Result<(), LinkError>;

    /// Publishes an event.
    ///
    /// # Errors
    /// If the transport failed.
    fn event(&mut self, event: &Event) -> Result<(), LinkError>;
}

/// Implements [`RecordSink`] for a pointer to the plant's end.
macro_rules! by_pointer {
    ($pointer:ty) => {
        impl<S: RecordSink + ?Sized> RecordSink for $pointer {
            fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
                (**self).open(layout)
            }

            fn has_room(&mut self) -> Result<bool, LinkError> {
                (**self).has_room()
            }

            fn sent_and_taken(&mut self) -> Result<(u64, u64), LinkError> {
                (**self).sent_and_taken()
            }

            #[inline]
            fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
                (**self).record(words)
            }

            fn event(&mut self, event: &Event) -> Result<(), LinkError> {
                (**self).event(event)
            }
        }
    };
}

by_pointer!(&mut S);
by_pointer!(Box<S>);

/// Item received by an observer.
#[derive(Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "one item at a time is in memory, and the end of a run comes once"
)]
pub enum Item<'a> {
    /// A record's words.
    Record(&'a [u64]),
    /// An event.
    Event(Event),
    /// Number of items lost before the next one.
    Lost(u64),
    /// Unreadable item, with the reason.
    Broken(String),
}

/// The observer's end.
pub trait RecordSource {
    /// Takes all available items in order and returns credit for them.
    ///
    /// # Errors
    /// If the transport failed.
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError>;
}

/// Largest plausible loss: nine years of items at a million a second.
const LARGEST_LOSS: u64 = 1 << 48;

/// Assembles events from their pieces and counts losses; used by every source, including those of custom transports.
/// Trusts no input, because all input comes from another process.
#[derive(Debug, Default)]
pub struct Assembler {
    last: u64,
    event: Vec<u8>,
}

impl Assembler {
    /// Returns the number of the latest item; 0 if none arrived.
    #[must_use]
    #[inline]
    pub const fn last(&self) -> u64 {
        self.last
    }

    /// Takes one item: its number, kind, length in bytes and words.
    pub fn take(
        &mut self,
        (sequence, kind, bytes): (u64, u64, u64),
        words: &[u64],
        take: &mut dyn FnMut(Item<'_>),
    ) {
        if sequence <= self.last {
            let last = self.last;
            return take(Item::Broken(format!(
                "item {sequence} came after item {last}"
            )));
        }
        let lost = sequence - self.last - 1;
        if lost > LARGEST_LOSS {
            let last = self.last;
            return take(Item::Broken(format!(
                "item {sequence} came after item {last}, which is an impossible loss: the stream's memory was overwritten"
            )));
        }
        if lost > 0 {
            take(Item::Lost(lost));
            self.event.clear();
        }
        self.last = sequence;
        let part = || {
            let bytes_of_words = zerocopy::IntoBytes::as_bytes(words);
            &bytes_of_words[..(bytes as usize).min(bytes_of_words.len())]
        };
        match ItemKind::from_wire(kind) {
            Some(ItemKind::Record) => take(Item::Record(words)),
            Some(ItemKind::EventPart) if self.event.len() > LONGEST_EVENT => {
                self.event.clear();
                take(Item::Broken(format!(
                    "an event of more than {LONGEST_EVENT} bytes"
                )));
            }
            Some(ItemKind::EventPart) => self.event.extend(part()),
            Some(ItemKind::EventEnd) => {
                self.event.extend(part());
                match serde_json::from_slice(&self.event) {
                    Ok(event) => take(Item::Event(event)),
                    Err(error) => take(Item::Broken(format!("an event: {error}"))),
                }
                self.event.clear();
            }
            None => take(Item::Broken(format!("an item of unknown kind {kind}"))),
        }
    }
}

/// Cuts an event into items of at most `words` words and sends each: its kind, bytes and words. Used by every sink,
/// including those of custom transports.
///
/// # Errors
/// The first failure to send.
pub fn send_in_parts<E>(
    event: &Event,
    words: usize,
    mut send: impl FnMut(ItemKind, usize, &[u64]) -> Result<(), E>,
) -> Result<(), E> {
    let json = serde_json::to_vec(event).unwrap_or_default();
    let mut parts = json.chunks(8 * words.max(1)).peekable();
    while let Some(part) = parts.next() {
        let mut padded = vec![0_u64; part.len().div_ceil(8)];
        zerocopy::IntoBytes::as_mut_bytes(&mut padded[..])[..part.len()].copy_from_slice(part);
        let last = parts.peek().is_none();
        let kind = if last {
            ItemKind::EventEnd
        } else {
            ItemKind::EventPart
        };
        send(kind, part.len(), &padded)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
