//! Frames of one kind in transit on one network. Allocates only at construction; content is bytes, never signals.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use hil_codec::checksum::Algorithm;

use crate::faults::kind::Passage;

/// Bytes of the sequence number and the frame check of a network.
const OVERHEAD: usize = 1 + CHECK;
/// Bytes of the frame check.
const CHECK: usize = 4;
/// Frame check of a network, as of Ethernet.
const FRAME_CHECK: &str = "crc-32/iso-hdlc";

/// Facts of a sent frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sent {
    /// Number of frames before it.
    pub count: u64,
    /// Sequence number.
    pub number: u8,
    /// Age of its content in steps when it was sent.
    pub age_steps: u32,
}

/// Frames in transit.
#[derive(Debug)]
pub(super) struct Transit {
    stride: usize,
    /// Bytes of the last frames, by count modulo the number of slots.
    bytes: Vec<u8>,
    sent: Vec<(Sent, usize)>,
    /// Copies by step of arrival: in order first, then by count.
    arrivals: BinaryHeap<Reverse<(u64, bool, u64)>>,
    /// Count below which frames, once delayed by an ended fault, no longer replace newer ones.
    overruled: u64,
    /// Count behind that of the newest frame that arrived.
    newest: u64,
    /// Frames that the check of the network refused.
    pub refused: u64,
    /// Buffer for a corrupted frame.
    broken: Vec<u8>,
    check: Algorithm,
}

impl Transit {
    /// Creates a network for frames of at most this many bytes, with room for this many in transit.
    pub(super) fn new(longest: usize, slots: usize) -> Self {
        Self {
            stride: longest,
            bytes: vec![0; longest * slots],
            sent: vec![(Sent::default(), 0); slots],
            arrivals: BinaryHeap::with_capacity(slots * Passage::MOST_COPIES),
            overruled: 0,
            newest: 0,
            refused: 0,
            broken: Vec::with_capacity(longest + OVERHEAD),
            check: Algorithm::named(FRAME_CHECK).expect("a CRC of the catalogue"),
        }
    }

    /// Returns the number of bits of a frame of N bytes on the network.
    pub(super) const fn bits(length: usize) -> u64 {
        8 * (length + OVERHEAD) as u64
    }

    /// Returns `true` if nothing is in transit.
    pub(super) fn is_empty(&self) -> bool {
        self.arrivals.is_empty()
    }

    /// Notes a frame that arrives as it is sent.
    pub(super) const fn pass(&mut self, count: u64) {
        self.newest = count + 1;
    }

    /// Ends a fault before a frame of this count is sent.
    pub(super) const fn overrule(&mut self, count: u64) {
        self.overruled = count;
    }

    /// Sends a frame at a step.
    pub(super) fn send(&mut self, step: u64, passage: &Passage, sent: Sent, bytes: &[u8]) {
        let slot = (sent.count % self.sent.len() as u64) as usize;
        let (mut sent, mut length) = (sent, bytes.len());
        let place = slot * self.stride;
        if passage.flipped > 0 {
            let Some(number) = self.corrupted(passage, sent.number, bytes) else {
                self.refused += passage.copies.iter().flatten().count() as u64;
                return;
            };
            sent.number = number;
            length = self.broken.len() - OVERHEAD;
            self.bytes[place..place + length].copy_from_slice(&self.broken[1..=length]);
        } else {
            self.bytes[place..place + length].copy_from_slice(bytes);
        }
        self.sent[slot] = (sent, length);
        for (late_steps, overtaken) in passage.copies.into_iter().zip(passage.overtaken) {
            if let Some(late_steps) = late_steps.filter(|&late| late <= Passage::LATEST_STEPS) {
                let at = step + u64::from(late_steps);
                let overtaken = overtaken && late_steps > 0;
                self.arrivals.push(Reverse((at, overtaken, sent.count)));
            }
        }
    }

    /// Inverts bits of a frame with sequence number and check; returns the sequence number if the check still fits.
    fn corrupted(&mut self, passage: &Passage, number: u8, bytes: &[u8]) -> Option<u8> {
        let frame = &mut self.broken;
        frame.clear();
        frame.push(number);
        frame.extend_from_slice(bytes);
        let sum = self.check.compute(frame, &[]) as u32;
        frame.extend_from_slice(&sum.to_le_bytes());
        for bit in &passage.flips[..passage.flipped] {
            frame[(bit / 8) as usize] ^= 1 << (bit % 8);
        }
        let (content, sum) = frame.split_at(frame.len() - CHECK);
        let is_intact = (self.check.compute(content, &[]) as u32).to_le_bytes() == *sum;
        is_intact.then(|| content[0])
    }

    /// Takes the next frame that arrives at a step.
    pub(super) fn receive(&mut self, step: u64) -> Option<(Sent, &[u8])> {
        loop {
            let Reverse((at, _, count)) = *self.arrivals.peek()?;
            if at > step {
                return None;
            }
            self.arrivals.pop();
            if count < self.overruled && count + 1 < self.newest {
                continue;
            }
            self.newest = self.newest.max(count + 1);
            let slot = (count % self.sent.len() as u64) as usize;
            let (sent, length) = self.sent[slot];
            return Some((sent, &self.bytes[slot * self.stride..][..length]));
        }
    }

    /// Appends the state: counts, then each copy in transit with its frame.
    pub(super) fn save(&self, state: &mut Vec<u64>) {
        let copies = self.arrivals.len() as u64;
        state.extend([self.overruled, self.newest, self.refused, copies]);
        let mut arrivals: Vec<_> = self.arrivals.iter().map(|Reverse(copy)| *copy).collect();
        arrivals.sort_unstable();
        for (at, overtaken, count) in arrivals {
            let slot = (count % self.sent.len() as u64) as usize;
            let (sent, length) = self.sent[slot];
            let (number, age_steps) = (sent.number.into(), sent.age_steps.into());
            let facts = [
                at,
                overtaken.into(),
                count,
                number,
                age_steps,
                length as u64,
            ];
            state.extend(facts);
            let bytes = &self.bytes[slot * self.stride..][..length];
            state.extend(bytes.chunks(8).map(|chunk| {
                let mut word = [0; 8];
                word[..chunk.len()].copy_from_slice(chunk);
                u64::from_le_bytes(word)
            }));
        }
    }

    /// Restores a state from the begin of these words and moves behind it; `None` if it is one of another network.
    pub(super) fn restore(&mut self, words: &mut &[u64]) -> Option<()> {
        let (head, mut rest) = words.split_first_chunk::<4>()?;
        let [overruled, newest, refused, copies] = *head;
        (self.overruled, self.newest, self.refused) = (overruled, newest, refused);
        self.arrivals.clear();
        for _ in 0..copies {
            let (facts, behind) = rest.split_first_chunk::<6>()?;
            let [at, overtaken, count, number, age_steps, length] = *facts;
            let length = usize::try_from(length)
                .ok()
                .filter(|length| *length <= self.stride)?;
            let (bytes, behind) = behind.split_at_checked(length.div_ceil(8))?;
            rest = behind;
            let slot = (count % self.sent.len() as u64) as usize;
            let sent = Sent {
                count,
                number: u8::try_from(number).ok()?,
                age_steps: u32::try_from(age_steps).ok()?,
            };
            self.sent[slot] = (sent, length);
            let place = &mut self.bytes[slot * self.stride..][..length];
            for (to, word) in place.chunks_mut(8).zip(bytes) {
                to.copy_from_slice(&word.to_le_bytes()[..to.len()]);
            }
            self.arrivals.push(Reverse((at, overtaken == 1, count)));
        }
        *words = rest;
        Some(())
    }
}
