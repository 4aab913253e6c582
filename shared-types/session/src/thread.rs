//! Statistics of the calling thread, and the decision when to sample them.
//!
//! The engine and the runner watch their own threads. Sampling needs system calls, so it happens only after a step that
//! took far longer than the others, to explain the delay, and occasionally to provide a basis for comparison.

use nix::sys::resource::{UsageWho, getrusage};
use rustix::thread::sched_getcpu;

use shared_types::thread::ThreadStatistics;

/// Steps between two samples when nothing is unusual.
pub const EVERY_STEPS: u32 = 1024;
/// Factor above the mean from which a step is unusual.
const UNUSUAL: u64 = 8;
/// Weight of a step in the running mean: one in N.
const MEAN_OF: u64 = 64;

/// Samples the calling thread.
#[must_use]
pub fn look() -> ThreadStatistics {
    let core = sched_getcpu() as u16;
    let Ok(usage) = getrusage(UsageWho::RUSAGE_THREAD) else {
        return ThreadStatistics {
            core,
            ..ThreadStatistics::default()
        };
    };
    let switches = usage.voluntary_context_switches() + usage.involuntary_context_switches();
    let faults = usage.minor_page_faults() + usage.major_page_faults();
    ThreadStatistics::new(core, switches as u64, faults as u64)
}

/// Decides when to sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct ThreadSampler {
    /// Mean duration of the steps, in ns times [`MEAN_OF`].
    mean: u64,
    steps: u32,
    last: u64,
}

impl ThreadSampler {
    /// Processes the duration of a step and returns the latest statistics as one word.
    #[must_use]
    pub fn after(&mut self, took_ns: u64) -> u64 {
        let mean_ns = self.mean / MEAN_OF;
        // A single step of milliseconds must not hide the following ones: it counts as twice the mean.
        let counted_ns = if mean_ns > 0 && took_ns > 2 * mean_ns {
            2 * mean_ns
        } else {
            took_ns
        };
        let is_unusual = mean_ns > 0 && took_ns > UNUSUAL * mean_ns;
        self.mean = if mean_ns == 0 {
            MEAN_OF * took_ns
        } else {
            self.mean + counted_ns - mean_ns
        };
        if is_unusual || self.steps == 0 {
            self.last = look().to_wire();
            self.steps = EVERY_STEPS;
        }
        self.steps -= 1;
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_shows_that_a_thread_slept() {
        let before = look();
        std::thread::sleep(std::time::Duration::from_millis(1));
        assert!(look().since(before).0 >= 1);
    }

    #[test]
    fn samples_follow_unusual_steps_and_recur_regularly() {
        let mut sampler = ThreadSampler::default();
        let mut looks = |took_ns, steps: u32| {
            (0..steps)
                .filter(|_| {
                    sampler.last = u64::MAX; // no look gives this
                    sampler.after(took_ns) != u64::MAX
                })
                .count()
        };
        assert_eq!(looks(1_000, EVERY_STEPS), 1);
        assert_eq!(looks(1_000, 3 * EVERY_STEPS), 3);
        assert_eq!(looks(1_000, 1), 1); // the next is due
        assert_eq!(looks(7_900, 1), 0);
        assert_eq!(looks(50_000_000, 1), 1);
        assert_eq!(looks(1_000, 100), 0);
        assert_eq!(looks(9_000, 1), 1); // the long one did not move the mean far
    }
}
