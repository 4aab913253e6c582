//! Statistics of a working thread: its core, its context switches, its page faults.
//!
//! The engine and the runner sample their own threads. Sampling takes system calls, so it follows a step that took far
//! longer than the others, to explain it, and is repeated now and then for comparison. Samples, commands and records
//! carry the latest statistics as one word, called `surroundings` there.

use nix::sys::resource::{UsageWho, getrusage};
use rustix::thread::sched_getcpu;

/// Steps between two samples when nothing is unusual.
pub const EVERY_STEPS: u32 = 1024;
/// Factor above the mean from which a step is unusual.
const UNUSUAL: u64 = 8;
/// Weight of a step in the running mean: one in N.
const MEAN_OF: u64 = 64;
const COUNT_BITS: u32 = 24;
const COUNT: u64 = (1 << COUNT_BITS) - 1;

/// Statistics of a thread, from one sample. The counts wrap around at 2^24.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ThreadStatistics {
    /// Core that the thread ran on.
    pub core: u16,
    /// Context switches of the thread so far, voluntary and involuntary.
    pub switches: u32,
    /// Page faults of the thread so far.
    pub faults: u32,
}

impl ThreadStatistics {
    /// Samples the calling thread.
    #[must_use]
    pub fn look() -> Self {
        let core = sched_getcpu() as u16;
        let Ok(usage) = getrusage(UsageWho::RUSAGE_THREAD) else {
            return Self {
                core,
                ..Self::default()
            };
        };
        let switches = usage.voluntary_context_switches() + usage.involuntary_context_switches();
        let faults = usage.minor_page_faults() + usage.major_page_faults();
        Self {
            core,
            switches: (switches as u64 & COUNT) as u32,
            faults: (faults as u64 & COUNT) as u32,
        }
    }

    /// Encodes the statistics as one word.
    #[must_use]
    pub const fn to_wire(self) -> u64 {
        (self.core as u64) << (2 * COUNT_BITS)
            | (self.switches as u64 & COUNT) << COUNT_BITS
            | self.faults as u64 & COUNT
    }

    /// Decodes the statistics from a word.
    #[must_use]
    #[inline]
    pub const fn from_wire(word: u64) -> Self {
        Self {
            core: (word >> (2 * COUNT_BITS)) as u16,
            switches: (word >> COUNT_BITS & COUNT) as u32,
            faults: (word & COUNT) as u32,
        }
    }

    /// Returns the switches and faults since an earlier sample of the same thread.
    #[must_use]
    pub fn since(self, earlier: Self) -> (u32, u32) {
        let count = |now: u32, then: u32| now.wrapping_sub(then) & COUNT as u32;
        (
            count(self.switches, earlier.switches),
            count(self.faults, earlier.faults),
        )
    }
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
            self.last = ThreadStatistics::look().to_wire();
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
    fn statistics_survive_the_wire_and_counts_wrap_around() {
        let before = ThreadStatistics {
            core: 511,
            switches: (1 << 24) - 1,
            faults: 7,
        };
        assert_eq!(ThreadStatistics::from_wire(before.to_wire()), before);
        let after = ThreadStatistics {
            core: 3,
            switches: 4,
            faults: 9,
        };
        assert_eq!(after.since(before), (5, 2));
    }

    #[test]
    fn a_sample_shows_that_a_thread_slept() {
        let before = ThreadStatistics::look();
        std::thread::sleep(std::time::Duration::from_millis(1));
        assert!(ThreadStatistics::look().since(before).0 >= 1);
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
