//! Busy cores, as caused by other programs: threads that alternate between computing and sleeping.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use hil_session::clock::monotonic_ns;
use shared_types::random::RandomStream;

/// Longest uninterrupted time that a thread computes or sleeps, in s.
const LONGEST_S: f64 = 4e-3;

/// Threads that keep the cores busy until this value is dropped.
pub(super) struct Noise {
    over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Noise {
    /// Starts one thread more than there are cores.
    pub(super) fn begin() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let over = Arc::new(AtomicBool::new(false));
        let threads = (0..=cores).map(|number| {
            let over = Arc::clone(&over);
            std::thread::spawn(move || disturb(number, &over))
        });
        Self {
            threads: threads.collect(),
            over,
        }
    }
}

fn disturb(number: usize, over: &AtomicBool) {
    let mut random = RandomStream::new(monotonic_ns(), &format!("noise/{number}"));
    while !over.load(Ordering::Relaxed) {
        let until_ns = monotonic_ns() + (1e9 * LONGEST_S * random.uniform()) as u64;
        while monotonic_ns() < until_ns {
            std::hint::spin_loop();
        }
        std::thread::sleep(Duration::from_secs_f64(LONGEST_S * random.uniform()));
    }
}

impl Drop for Noise {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join(); // it has nothing to say
        }
    }
}
