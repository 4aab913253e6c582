//! Statistics of a working thread: its core, its context switches, its page faults.
//!
//! Samples, commands and records carry the latest statistics as one word, called `surroundings` there. Threads are
//! sampled in `hil-session`, never here.

const COUNT_BITS: u32 = 24;
/// Number of values of a count in a word; a count wraps around at this number.
const COUNT: u64 = (1 << COUNT_BITS) - 1;

/// Statistics of a thread, from one sample. The counts wrap around at 2^24.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ThreadStatistics {
    /// Core on which the thread ran.
    pub core: u16,
    /// Context switches of the thread so far, voluntary and involuntary.
    pub switches: u32,
    /// Page faults of the thread so far.
    pub faults: u32,
}

impl ThreadStatistics {
    /// Samples the calling thread.
    #[must_use]
    pub const fn new(core: u16, switches: u64, faults: u64) -> Self {
        Self {
            core,
            switches: (switches & COUNT) as u32,
            faults: (faults & COUNT) as u32,
        }
    }

    /// Encodes the statistics as one word.
    #[must_use]
    #[inline]
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
}
