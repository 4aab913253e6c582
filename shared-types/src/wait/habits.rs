//! Habits of a hybrid wait, learned from the waits before.

use super::{LATE_NS, SPINS};

/// Number of polls before anything else.
#[derive(Debug)]
pub(super) struct Polling {
    /// Polls in this wait.
    pub(super) polls: u32,
    /// True if there are no polls at all, as where both sides have one core.
    never: bool,
    /// Waits in a row that polls did not end.
    misses: u32,
    /// Waits before the next one with polls.
    without: u32,
    /// Value of `without` after the next miss.
    backoff: u32,
}

impl Polling {
    /// Misses in a row that show that polling does not help.
    const MISSES: u32 = 4;
    /// Most waits without polls.
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

    /// Notes that polls ended a wait.
    pub(super) const fn helped(&mut self) {
        if self.misses > 0 {
            self.misses = 0;
            self.backoff = Self::MISSES;
        }
    }

    /// Notes that a wait outlasted its polls.
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

/// Other programs that need the core, known by the time that it was away when it was given away or waited for.
#[derive(Debug)]
pub(super) struct Company {
    /// Moving average of the time that the core was away.
    away_ns: u64,
    /// Time until which others are taken for granted.
    pub(super) until_ns: u64,
    /// Time for which they are taken for granted when they come next.
    backoff_ns: u64,
}

impl Company {
    /// Returns that the average is made of. One that took a slice of the scheduler brings it near the limit,
    /// and the recorder's short work between many quick ones does not.
    const RETURNS: u64 = 128;
    /// Average above which others need the core.
    const LIMIT_NS: u64 = 20_000;
    /// Time away that only a slice of the scheduler takes.
    const TURN_NS: u64 = 1_000_000;
    const SHORTEST_NS: u64 = 10_000_000;
    const LONGEST_NS: u64 = 1_000_000_000;

    pub(super) const NONE: Self = Self {
        away_ns: 0,
        until_ns: 0,
        backoff_ns: Self::SHORTEST_NS,
    };

    /// Notes that the core came back.
    pub(super) fn came_back(&mut self, now_ns: u64, took_ns: u64) {
        self.away_ns = self.away_ns - self.away_ns / Self::RETURNS + took_ns / Self::RETURNS;
        // They are gone when they were not met for as long as they would be taken for granted next, however
        // often the core was given away meanwhile: a yield comes back at once where all others are in another
        // session.
        let are_gone = now_ns > self.until_ns.saturating_add(self.backoff_ns);
        if are_gone {
            self.backoff_ns = Self::SHORTEST_NS;
        }
        if self.away_ns > Self::LIMIT_NS || (!are_gone && took_ns >= Self::TURN_NS) {
            self.away_ns = self.away_ns.min(Self::LIMIT_NS - Self::LIMIT_NS / 4);
            self.until_ns = now_ns + self.backoff_ns;
            self.backoff_ns = (4 * self.backoff_ns).min(Self::LONGEST_NS);
        }
    }

    /// Notes by how much a wait for a time ended later than that. Beside others only a late end counts: one
    /// in time does not show that they went, as the side slept.
    pub(super) fn woke(&mut self, now_ns: u64, late_ns: u64) {
        let took_ns = late_ns.saturating_sub(LATE_NS);
        if took_ns > 0 || !self.is_there(now_ns) {
            self.came_back(now_ns, took_ns);
        }
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
    fn a_slice_for_others_is_company_and_a_recorders_work_is_not() {
        let mut company = Company::NONE;
        for step in 0..100_000 {
            // 4 ms of yields to the other side, then half a millisecond for the recorder.
            company.came_back(step, if step % 1000 == 0 { 500_000 } else { 4_000 });
            assert!(!company.is_there(step));
        }
        let mut now_ns = 1000 * MS;
        company.came_back(now_ns, 3 * MS);
        // Still there: each time for four times as long, up to a second, however many quick returns are between.
        for for_ms in [10, 40, 160, 640, 1000, 1000] {
            assert_eq!(company.until_ns, now_ns + for_ms * MS);
            assert!(company.is_there(now_ns) && !company.is_there(company.until_ns));
            now_ns = company.until_ns + 5 * MS;
            (0..10_000).for_each(|_| company.came_back(now_ns, 500));
            assert!(!company.is_there(now_ns));
            company.came_back(now_ns, 2 * MS);
        }
        // They went; when they come again, it is for a short time at first.
        now_ns = company.until_ns + 1001 * MS;
        (0..10_000).for_each(|_| company.came_back(now_ns, 500));
        company.came_back(now_ns, 2 * MS);
        assert!(!company.is_there(now_ns));
        company.came_back(now_ns, 3 * MS);
        assert_eq!(company.until_ns, now_ns + 10 * MS);
    }

    #[test]
    fn waits_that_end_late_are_company_and_those_in_time_do_not_make_it_go() {
        let mut company = Company::NONE;
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
    fn polls_that_do_not_help_are_left_out_more_and_more() {
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
