//! The raw limit: two rows of atomics between two threads, each written by one side only.
//!
//! Does only what any exchange through memory must do: store the payload, publish its number, detect the number,
//! load the payload. The code is safe Rust; between processes the same memory traffic costs the same.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::exchange::End;

/// Number on its own cache line, padded because some processors fetch lines in pairs.
#[repr(align(128))]
struct Line(AtomicU64);

/// Payload with the number that announces it.
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

    /// Both sides alternate, so that no side writes while the other reads.
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

/// Creates two connected ends, with payloads of `there` words from the first to the second, and of `back` words in
/// the other direction.
#[must_use]
pub fn pair(there: usize, back: usize) -> (Raw, Raw) {
    let (there, back) = (Cell::new(there), Cell::new(back));
    (Raw::new(&there, &back), Raw::new(&back, &there))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_payload_arrives_once_and_complete() {
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
