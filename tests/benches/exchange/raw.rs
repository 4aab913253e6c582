//! The raw limit: two cells of atomics between two threads, each written by one side only.
//!
//! What any exchange through memory must do and nothing else: store the payload, publish its
//! number, see the number, load the payload. Plain safe Rust; between processes the same memory
//! traffic costs the same.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::patterns::{COMMAND_WORDS, End, SAMPLE_WORDS};

/// A number on a cache line of its own and the payload that it announces.
#[repr(C, align(128))]
struct Cell<const N: usize> {
    number: Line,
    words: [AtomicU64; N],
}

#[repr(align(128))]
struct Line(AtomicU64);

impl<const N: usize> Cell<N> {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            number: Line(AtomicU64::new(0)),
            words: std::array::from_fn(|_| AtomicU64::new(0)),
        })
    }

    fn put(&self, payload: [u64; N]) {
        for (word, value) in self.words.iter().zip(payload) {
            word.store(value, Ordering::Relaxed);
        }
        self.number.0.store(payload[0], Ordering::Release);
    }

    /// The payload, if its number is not the last one seen. Both sides take turns, so that nobody
    /// writes while the other reads.
    fn take(&self, last: &mut u64) -> Option<[u64; N]> {
        let number = self.number.0.load(Ordering::Acquire);
        if number == *last {
            return None;
        }
        *last = number;
        Some(std::array::from_fn(|i| {
            self.words[i].load(Ordering::Relaxed)
        }))
    }
}

struct Raw<const OUT: usize, const IN: usize> {
    outgoing: Arc<Cell<OUT>>,
    incoming: Arc<Cell<IN>>,
    last: u64,
}

impl<const OUT: usize, const IN: usize> End for Raw<OUT, IN> {
    fn send(&mut self, number: u64) {
        self.outgoing.put([number; OUT]);
    }

    fn receive(&mut self) -> Option<u64> {
        let payload = self.incoming.take(&mut self.last)?;
        Some(std::hint::black_box(payload)[IN - 1])
    }
}

/// The plant's end and the controller's.
pub(crate) fn pair() -> (impl End, impl End + Send) {
    let (samples, commands) = (Cell::<SAMPLE_WORDS>::new(), Cell::<COMMAND_WORDS>::new());
    let plant = Raw {
        outgoing: Arc::clone(&samples),
        incoming: Arc::clone(&commands),
        last: 0,
    };
    let controller = Raw {
        outgoing: commands,
        incoming: samples,
        last: 0,
    };
    (plant, controller)
}
