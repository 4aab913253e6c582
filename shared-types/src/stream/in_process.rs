//! The record stream within one process: a ring of words between two threads.

use rtrb::{Consumer, Producer, RingBuffer, chunks::ChunkError};

use super::{Assembler, Item, ItemKind, RecordSink, RecordSource, send_in_parts};
use crate::link::LinkError;
use crate::record::{Event, RecordLayout};

/// Words in the ring: 8 MiB.
const RING_WORDS: usize = 1 << 20;
/// Words before each item: its length, number, kind and number of bytes.
const HEAD_WORDS: usize = 4;
/// Number of free words below which the loop is held back. An event may take tens of thousands of words, for example
/// the event of a fault with a long table.
const RESERVE_WORDS: usize = RING_WORDS / 2;

/// Creates a connected sink and source.
#[must_use]
pub fn pair() -> (InProcessSink, InProcessSource) {
    let (producer, consumer) = RingBuffer::new(RING_WORDS);
    let sink = InProcessSink {
        ring: producer,
        words: 1,
        sent: 0,
    };
    let source = InProcessSource {
        ring: consumer,
        item: Vec::new(),
        items: Assembler::default(),
    };
    (sink, source)
}

/// The plant's end within one process.
pub struct InProcessSink {
    ring: Producer<u64>,
    words: usize,
    sent: u64,
}

impl InProcessSink {
    /// Returns `true` if so many words are free. Reads the recorder's end of the ring only if the last known number of
    /// free words is too low, because each read takes a cache line from the recorder.
    #[inline]
    fn fits(&self, words: usize) -> bool {
        self.ring.cached_slots() >= words || self.ring.slots() >= words
    }

    #[inline]
    fn send(&mut self, kind: ItemKind, bytes: usize, words: &[u64]) -> Result<(), LinkError> {
        let full = || LinkError::Transport {
            service: "record ring".into(),
            reason: "it is full".into(),
        };
        if !self.fits(HEAD_WORDS + words.len()) {
            return Err(full());
        }
        self.sent += 1;
        let head = [words.len() as u64, self.sent, kind as u64, bytes as u64];
        let pushed =
            (self.ring.push_entire_slice(&head)).and_then(|()| self.ring.push_entire_slice(words));
        pushed.map_err(|_: ChunkError| full())
    }
}

impl RecordSink for InProcessSink {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.words = layout.words();
        Ok(())
    }

    #[inline]
    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(self.fits(RESERVE_WORDS))
    }

    #[inline]
    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.send(ItemKind::Record, 8 * words.len(), words)
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        let words = self.words;
        send_in_parts(event, words, |kind, bytes, part| {
            self.send(kind, bytes, part)
        })
    }
}

/// The observer's end within one process.
pub struct InProcessSource {
    ring: Consumer<u64>,
    item: Vec<u64>,
    items: Assembler,
}

impl RecordSource for InProcessSource {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        let mut count = 0;
        // The header gives the length; an incomplete item is taken next time.
        while let Ok(length) = self.ring.peek().copied() {
            let Ok(chunk) = self.ring.read_chunk(HEAD_WORDS + length as usize) else {
                break;
            };
            self.item.clear();
            let (front, back) = chunk.as_slices();
            self.item.extend_from_slice(front);
            self.item.extend_from_slice(back);
            chunk.commit_all();
            let (head, words) = self.item.split_at(HEAD_WORDS);
            self.items.take((head[1], head[2], head[3]), words, take);
            count += 1;
        }
        Ok(count)
    }
}
