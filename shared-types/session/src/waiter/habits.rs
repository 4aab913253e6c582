//! Habits of a hybrid wait, learned from previous waits.

use super::{EARLY_NS, LATE_NS, SPINS};

/// Number of polls before anything else.
#[derive(Debug)]
pub(super) struct Polling {
    /// Polls in this wait.
    pub(super) polls: u32,
    /// `true` if polling is disabled, for example because both sides share one core.
    pub(super) never: bool,
    /// Consecutive waits that polls did not end.
    misses: u32,
    /// Number of waits until the next one with polls.
    without: u32,
    /// Value of `without` after the next miss.
    backoff: u32,
}

impl Polling {
    /// Consecutive misses that show that polling does not help.
    const MISSES: u32 = 4;
    /// Maximum number of waits without polls.
    const LONGEST: u32 = 256;

    pub(super) const fn new(never: bool) -> Self {
        Self {
            polls: if never { 0 } else { SPINS },
            never,
            misses: 0,
            without: 0,
            backoff: Self::MISSES,
        }
    }

    /// Records that polls ended a wait.
    pub(super) const fn helped(&mut self) {
        if self.misses > 0 {
            self.misses = 0;
            self.backoff = Self::MISSES;
        }
    }

    /// Records that a wait outlasted its polls.
    pub(super) fn missed(&mut self) {
        if self.never {
            return;
        }
        if self.without > 0 {
            self.without -= 1;
        } else {
            self.misses += 1;
            if self.misses >= Self::MISSES {
                self.misses = Self::MISSES - 1; // the next miss is enough
                self.without = self.backoff;
                self.backoff = (2 * self.backoff).min(Self::LONGEST);
            }
        }
        self.polls = if self.without > 0 { 0 } else { SPINS };
    }
}

/// Expected length of the next wait, estimated from previous waits.
#[derive(Debug, Default)]
pub(super) struct Length {
    /// Lengths of the last waits, unordered.
    last_ns: [u64; 4],
    next: usize,
}

impl Length {
    /// Records the duration of a wait.
    pub(super) const fn waited(&mut self, ns: u64) {
        self.last_ns[self.next] = ns;
        self.next = (self.next + 1) % self.last_ns.len();
    }

    /// Returns the part of the next wait that can be slept through if its last `EARLY_NS` are spent awake. The shortest
    /// of the last waits counts, so that neither a time slice nor the recorder makes a wait seem long.
    pub(super) fn idle_ns(&self) -> u64 {
        let least_ns = self.last_ns.iter().copied().min().unwrap_or(0);
        least_ns.saturating_sub(EARLY_NS)
    }
}

/// Contention with other programs, detected from the absence of the core after a yield or a timed wait.
#[derive(Debug)]
pub(super) struct Company {
    /// `true` if both sides share one core.
    on_one_core: bool,
    /// Recent quick returns; each slow one halves the count.
    quick: u32,
    /// Recent time without the core, less the tolerated share of the elapsed time.
    away_ns: u64,
    /// Time when the core last came back.
    back_ns: u64,
    /// Longest absence of the core in this wait, if a sleep would have cost little.
    longest_ns: u64,
    /// Moving average of the delay at the end of waits.
    late_ns: u64,
    /// End of the period for which contention is assumed.
    pub(super) until_ns: u64,
    /// Length of the next such period.
    backoff_ns: u64,
}

impl Company {
    /// Absence below which nothing is concluded: most likely the other side or another session took the core.
    const SHORT_NS: u64 = 100_000;
    /// Absence, beyond two fifths of the elapsed time, that proves contention. The recorder takes less, even when it
    /// works for several milliseconds at a time; a loop of another session takes half.
    const AWAY_NS: u64 = 6_000_000;
    /// The same limit on one core: less than two consecutive slices of the scheduler.
    const AWAY_ON_ONE_CORE_NS: u64 = 1_500_000;
    /// Number of quick returns below which yields on one core lose a slice too often.
    const FEW: u32 = 32;
    /// Maximum count of quick returns, chosen so that new contention is detected at the fourth slice.
    const MANY: u32 = 4 * Self::FEW;
    /// Number of waits in the moving average. A single wait that ends a slice late brings the average near the limit.
    const WAITS: u64 = 128;
    /// Average delay above which contention is assumed.
    const LATE_ON_AVERAGE_NS: u64 = 20_000;
    /// Duration of another program's turn: a wait that is this late, or a yield of this length on one core, shows that
    /// the contention persists.
    const TURN_NS: u64 = 1_000_000;
    const SHORTEST_NS: u64 = 10_000_000;
    const LONGEST_NS: u64 = 1_000_000_000;

    pub(super) const fn none(on_one_core: bool) -> Self {
        Self {
            on_one_core,
            quick: 0,
            away_ns: 0,
            back_ns: 0,
            longest_ns: 0,
            late_ns: 0,
            until_ns: 0,
            backoff_ns: Self::SHORTEST_NS,
        }
    }

    /// Records the return of the core after a yield; `sleep_is_cheap` if a sleep would have cost little in that wait.
    pub(super) fn came_back(&mut self, now_ns: u64, took_ns: u64, sleep_is_cheap: bool) {
        if took_ns < Self::SHORT_NS {
            self.quick = (self.quick + 1).min(Self::MANY);
            return;
        }
        // A lost slice, however rare, could then have been avoided. On one core it may be due to a slow law.
        if sleep_is_cheap && !self.on_one_core {
            self.longest_ns = self.longest_ns.max(took_ns);
            return;
        }
        let passed_ns = now_ns.saturating_sub(match self.is_there(now_ns) {
            true => self.back_ns,
            // Until then contention was assumed, and the core was not yielded.
            false => self.back_ns.max(self.until_ns),
        });
        self.away_ns = (self.away_ns + took_ns).saturating_sub(passed_ns / 5 * 2);
        self.back_ns = now_ns;
        let are_few = self.quick < Self::FEW;
        self.quick /= 2;
        // On one core programs of another session take their share whether the sides yield or sleep, and a yield costs
        // less; against programs of the same session each yield loses a slice. Where a sleep costs little, a slice is
        // too much.
        let (limit_ns, counts) = match self.on_one_core {
            true => (
                Self::AWAY_ON_ONE_CORE_NS,
                are_few || (sleep_is_cheap && took_ns >= Self::TURN_NS),
            ),
            false => (Self::AWAY_NS, true),
        };
        // Nearly a slice, and most of the time: a slow law takes less of it.
        let are_still_there = self.on_one_core
            && !self.are_gone(now_ns)
            && took_ns >= Self::TURN_NS
            && took_ns >= passed_ns / 5 * 3;
        if self.away_ns >= limit_ns || are_still_there {
            self.away_ns = 0;
            if counts {
                self.met(now_ns);
            }
        }
    }

    /// Records the end of a wait in which a sleep costs little.
    pub(super) fn ended(&mut self, now_ns: u64) {
        if !self.on_one_core {
            let longest_ns = std::mem::take(&mut self.longest_ns);
            self.woke(now_ns, longest_ns);
        }
    }

    /// Records how late a wait ended. During assumed contention only a late end counts: a punctual end does not prove
    /// that the contention is over, because the side slept.
    pub(super) fn woke(&mut self, now_ns: u64, late_ns: u64) {
        let late_ns = late_ns.saturating_sub(LATE_NS);
        if late_ns == 0 && self.is_there(now_ns) {
            return;
        }
        self.late_ns = self.late_ns - self.late_ns / Self::WAITS + late_ns / Self::WAITS;
        let are_still_there = !self.are_gone(now_ns) && late_ns >= Self::TURN_NS;
        if are_still_there || self.late_ns > Self::LATE_ON_AVERAGE_NS {
            self.late_ns = self.late_ns.min(Self::LATE_ON_AVERAGE_NS / 4 * 3);
            self.met(now_ns);
        }
    }

    /// Assumes contention for a while.
    fn met(&mut self, now_ns: u64) {
        if self.are_gone(now_ns) {
            self.backoff_ns = Self::SHORTEST_NS;
        }
        self.until_ns = now_ns + self.backoff_ns;
        self.backoff_ns = (4 * self.backoff_ns).min(Self::LONGEST_NS);
    }

    /// Returns `true` if the last assumed contention ended longer ago than the next period of it would last.
    const fn are_gone(&self, now_ns: u64) -> bool {
        now_ns > self.until_ns.saturating_add(self.backoff_ns)
    }

    pub(super) const fn is_there(&self, now_ns: u64) -> bool {
        now_ns < self.until_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn neither_the_other_side_nor_the_recorder_counts_as_contention() {
        // Time of the first detection if the core is away for this long at this interval.
        let others = |took_ns, every_ns| {
            let mut company = Company::none(false);
            (1..=100_000_u64).find(|time| {
                company.came_back(time * every_ns, took_ns, false);
                company.is_there(time * every_ns)
            })
        };
        assert_eq!(
            others(5_000, 6_000),
            None,
            "the other side on the same core"
        );
        assert_eq!(others(90_000, 91_000), None, "one at work for longer");
        assert_eq!(others(MS, 4 * MS), None, "the recorder");
        assert_eq!(others(7 * MS, 20 * MS), None, "the recorder on a slow disk");
        assert_eq!(others(4 * MS / 10, MS), None, "two fifths of the time");
        assert_eq!(others(50 * MS, 200 * MS), None, "long, and rare");
        // A tenth of a millisecond beyond two fifths of the time, until that is 6 ms.
        assert_eq!(others(MS / 2, MS), Some(60));
        // A program that takes half, in slices of 3 ms: 0.6 ms at each.
        assert_eq!(others(3 * MS, 6 * MS), Some(10));
        // A slice at each yield: 1.8 ms at each.
        assert_eq!(others(3 * MS, 3 * MS), Some(4));
    }

    #[test]
    fn repeated_contention_is_assumed_for_longer() {
        // Ten consecutive milliseconds without the core are 6 ms beyond two fifths.
        fn meet(company: &mut Company, now_ns: &mut u64) {
            company.back_ns = *now_ns;
            *now_ns += 10 * MS;
            company.came_back(*now_ns, 10 * MS, false);
        }
        let mut company = Company::none(false);
        let mut now_ns = 1000 * MS;
        meet(&mut company, &mut now_ns);
        // Each period is four times as long, up to a second, however many quick returns lie between.
        for for_ms in [10, 40, 160, 640, 1000, 1000] {
            assert_eq!(company.until_ns, now_ns + for_ms * MS);
            assert!(company.is_there(now_ns) && !company.is_there(company.until_ns));
            now_ns = company.until_ns;
            (0..10_000).for_each(|_| company.came_back(now_ns, 500, false));
            assert!(!company.is_there(now_ns));
            meet(&mut company, &mut now_ns);
        }
        // Contention ended; when it returns, the first period is short again.
        now_ns = company.until_ns + 1001 * MS;
        meet(&mut company, &mut now_ns);
        assert_eq!(company.until_ns, now_ns + 10 * MS);
    }

    #[test]
    fn on_one_core_only_a_slice_at_nearly_each_yield_is_contention() {
        // Slow return of the first detection, with so many quick ones before each.
        let others = |quick: u32, took_ns: u64, every_ns: u64| {
            let mut company = Company::none(true);
            (1..1000_u64).find(|time| {
                let now_ns = 1000 * MS + time * every_ns;
                (0..quick).for_each(|_| company.came_back(now_ns - took_ns, 5_000, false));
                company.came_back(now_ns, took_ns, false);
                company.is_there(now_ns)
            })
        };
        let half = |quick| others(quick, 3 * MS, 6 * MS);
        assert_eq!(half(500), None, "a loop of another session");
        assert_eq!(half(32), None);
        assert_eq!(half(15), Some(4), "0.6 ms at each but the first");
        let slices = others(0, 3 * MS, 3 * MS);
        assert_eq!(slices, Some(2), "a loop of the same session");
        let law = others(0, 3 * MS, 10 * MS);
        assert_eq!(law, None, "a slow law in real time");
    }

    #[test]
    fn on_one_core_consecutive_slices_count_by_the_quick_returns_before_them() {
        // A loop of another session, whose slices are sometimes close together.
        let mut company = Company::none(true);
        let mut now_ns = 1000 * MS;
        for (quick, took_us) in
            [(200, 500), (70, 500), (20, 2900), (250, 2000), (5, 2900)].repeat(100)
        {
            (0..quick).for_each(|_| company.came_back(now_ns, 5_000, false));
            now_ns += 1000 * (5 * quick + took_us);
            company.came_back(now_ns, 1000 * took_us, false);
            assert!(!company.is_there(now_ns));
        }
        // A loop of the same session that starts then.
        (0..200).for_each(|_| company.came_back(now_ns, 5_000, false));
        let first = (1..100).find(|_| {
            now_ns += 3 * MS;
            company.came_back(now_ns, 3 * MS, false);
            company.is_there(now_ns)
        });
        assert_eq!(first, Some(4));
        // A partial slice shows that it persists, and for longer.
        now_ns = company.until_ns + MS;
        company.came_back(now_ns, MS, false);
        assert_eq!(company.until_ns, now_ns + 40 * MS);
        // A slow law that takes a third of the time does not, however soon it comes.
        let until_ns = company.until_ns;
        now_ns = until_ns + 8 * MS;
        for _ in 0..100 {
            company.came_back(now_ns, 4 * MS, false);
            now_ns += 12 * MS;
        }
        assert_eq!(company.until_ns, until_ns);
    }

    #[test]
    fn one_lost_slice_is_contention_where_a_sleep_would_have_cost_little() {
        // Wait of the first detection, if one in a hundred has so slow a yield.
        let others = |took_ns| {
            let mut company = Company::none(false);
            (1..1000_u64).find(|wait| {
                let now_ns = wait * 100 * MS;
                company.came_back(now_ns, took_ns, true);
                (0..100).for_each(|_| company.ended(now_ns));
                company.is_there(now_ns)
            })
        };
        assert_eq!(others(3 * MS), Some(1), "a slice");
        assert_eq!(others(MS), None, "the recorder now and then");
        // On one core half of the time is, however many yields are quick.
        let others = |took_ns, every_ns| {
            let mut company = Company::none(true);
            (1..1000_u64).find(|time| {
                let now_ns = 1000 * MS + time * every_ns;
                (0..500).for_each(|_| company.came_back(now_ns - took_ns, 5_000, true));
                company.came_back(now_ns, took_ns, true);
                company.is_there(now_ns)
            })
        };
        assert_eq!(
            others(3 * MS, 6 * MS),
            Some(4),
            "0.6 ms at each but the first"
        );
        assert_eq!(others(4 * MS, 12 * MS), None, "a slow law in real time");
        assert_eq!(
            others(210_000, 400_000),
            None,
            "a plant that spins before its release"
        );
    }

    #[test]
    fn on_one_core_only_timed_waits_count_by_their_end() {
        // Later than the 0.3 ms by 30 us each, with a wait for the other side after each.
        let mut company = Company::none(true);
        let first = (1..1000_u64).find(|wait| {
            let now_ns = wait * 100 * MS;
            company.woke(now_ns, LATE_NS + 30_000);
            company.ended(now_ns);
            company.is_there(now_ns)
        });
        // 30 us times 1 - (127/128)^N exceeds 20 us from N = 141 on.
        let first = first.expect("others");
        assert!(first.abs_diff(141) <= 1, "{first}");
    }

    #[test]
    fn only_four_long_waits_in_a_row_make_the_next_one_long() {
        for long_ns in [MS, 7 * MS, 1000 * MS] {
            let mut length = Length::default();
            for _ in 0..3 {
                length.waited(long_ns);
                assert_eq!(length.idle_ns(), 0);
            }
            length.waited(long_ns + 1);
            assert_eq!(length.idle_ns(), long_ns - 200_000);
            length.waited(MS / 2);
            assert_eq!(length.idle_ns(), 300_000, "one that came early");
            length.waited(3_000);
            assert_eq!(length.idle_ns(), 0);
        }
    }

    #[test]
    fn yields_during_assumed_contention_show_no_more_than_at_other_times() {
        for on_one_core in [false, true] {
            let mut company = Company::none(on_one_core);
            company.met(1000 * MS);
            let until_ns = company.until_ns;
            for step in 0..1000 {
                company.came_back(1000 * MS + step * MS / 2, 150_000, false);
            }
            assert_eq!(company.until_ns, until_ns);
        }
    }

    #[test]
    fn late_waits_show_contention_and_punctual_ones_do_not_end_it() {
        let mut company = Company::none(false);
        (0..100_000).for_each(|_| company.woke(0, LATE_NS));
        assert!(!company.is_there(0));
        company.woke(0, 3 * MS);
        assert_eq!(company.until_ns, 10 * MS);
        for until_ms in [50, 210, 850, 1850] {
            let now_ns = company.until_ns;
            (0..1000).for_each(|_| company.woke(now_ns - 1, 60_000));
            assert!(!company.is_there(now_ns));
            company.woke(now_ns, 3 * MS);
            assert_eq!(company.until_ns, until_ms * MS);
        }
    }

    #[test]
    fn late_waits_show_contention_by_their_average() {
        // Long after the last detection, so that each late wait counts by the average alone.
        let first = |late_ns: u64| {
            let mut company = Company::none(false);
            (1..10_000_u64).find(|wait| {
                let now_ns = (1000 + wait) * MS;
                company.woke(now_ns, LATE_NS + late_ns);
                company.is_there(now_ns)
            })
        };
        assert_eq!(first(20_000), None, "the limit itself");
        // The average is late (1 - (127/128)^N): over 20 us once (127/128)^N < 0.98, 0.8 and 0.5.
        let near =
            |waits: u64, estimate: Option<u64>| estimate.is_some_and(|n| n.abs_diff(waits) <= 1);
        assert!(near(3, first(MS)), "{:?}", first(MS));
        assert!(near(29, first(100_000)), "{:?}", first(100_000));
        assert!(near(89, first(40_000)), "{:?}", first(40_000));
        assert_eq!(first(3 * MS), Some(1), "a slice");
    }

    #[test]
    fn useless_polls_are_skipped_more_and_more() {
        let mut polling = Polling::new(false);
        let waits_without = |polling: &mut Polling| {
            let mut waits = 0;
            loop {
                polling.missed();
                if polling.polls > 0 {
                    return waits;
                }
                waits += 1;
            }
        };
        assert_eq!([(); 3].map(|()| waits_without(&mut polling)), [0, 0, 0]);
        for waits in [4, 8, 16, 32, 64, 128, 256, 256] {
            assert_eq!(waits_without(&mut polling), waits);
        }
        polling.helped();
        assert_eq!([(); 3].map(|()| waits_without(&mut polling)), [0, 0, 0]);
        assert_eq!(waits_without(&mut polling), 4);
    }
}
