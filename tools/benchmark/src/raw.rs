//! The raw limit: two rows of atomics between two threads, each written by one side only.
//!
//! What any exchange through memory must do and nothing else: store the payload, publish its number,
//! see the number, load the payload. Plain safe Rust; between processes the same memory traffic costs
//! the same.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::exchange::End;

/// A number on a cache line of its own; some processors fetch lines in pairs.
#[repr(align(128))]
struct Line(AtomicU64);

/// A payload and the number that announces it.
struct Cell {
    number: Line,
    words: Box<[AtomicU64]>,
}

impl Cell {
    fn new(words: usize) -> Arc<Self> {
        Arc::new(Self {
            number: Line(AtomicU64::new(0)),
            words: (0..words).map(|_| AtomicU64::new(0)).collect(),
        })
    }
}

/// End of a bare exchange.
pub struct Raw {
    outgoing: Arc<Cell>,
    incoming: Arc<Cell>,
    /// Last payload.
    payload: Box<[u64]>,
    last: u64,
}

impl Raw {
    fn new(outgoing: &Arc<Cell>, incoming: &Arc<Cell>) -> Self {
        Self {
            outgoing: Arc::clone(outgoing),
            payload: vec![0; incoming.words.len()].into(),
            incoming: Arc::clone(incoming),
            last: 0,
        }
    }
}

impl End for Raw {
    fn send(&mut self, number: u64) {
        for word in &self.outgoing.words {
            word.store(number, Ordering::Relaxed);
        }
        self.outgoing.number.0.store(number, Ordering::Release);
    }

    /// Both sides take turns, so that nobody writes while the other reads.
    fn receive(&mut self) -> Option<u64> {
        let number = self.incoming.number.0.load(Ordering::Acquire);
        if number == self.last {
            return None;
        }
        self.last = number;
        for (to, from) in self.payload.iter_mut().zip(&self.incoming.words) {
            *to = from.load(Ordering::Relaxed);
        }
        std::hint::black_box(&self.payload).last().copied()
    }
}

/// Two ends with N words there, from the first to the second, and back.
#[must_use]
pub fn pair(there: usize, back: usize) -> (Raw, Raw) {
    let (there, back) = (Cell::new(there), Cell::new(back));
    (Raw::new(&there, &back), Raw::new(&back, &there))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_comes_once_and_whole() {
        let (mut plant, mut controller) = pair(5, 3);
        assert_eq!(controller.receive(), None);
        plant.send(7);
        assert_eq!(controller.receive(), Some(7));
        assert_eq!(controller.payload[..], [7; 5]);
        assert_eq!(controller.receive(), None);
        controller.send(8);
        assert_eq!(plant.receive(), Some(8));
        assert_eq!(plant.payload[..], [8; 3]);
    }
}
