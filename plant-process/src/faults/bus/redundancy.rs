//! Redundancy of two networks, in the manner of ARINC 664 part 7: sequence numbers, a check of their order on each
//! network, and "first valid wins". Sees no content.

/// Largest advance of a sequence number that counts as newer: half of the cycle.
const NEWER: u8 = 127;

/// Sequence number behind another: 1 to 255 in a circle; 0 occurs only after a reset of the sender.
pub(super) const fn next(number: u8) -> u8 {
    match number {
        u8::MAX => 1,
        number => number + 1,
    }
}

/// Fate of a received frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The first of its number: passed on.
    First,
    /// Out of order on its own network.
    OutOfOrder,
    /// A copy of one that was passed on, or older.
    Redundant,
}

/// Receiver of one frame on two networks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Redundancy {
    /// Last number on each network.
    last: [Option<u8>; 2],
    /// Number passed on last, and its step.
    passed: Option<(u8, u64)>,
    skew_steps: u64,
}

impl Redundancy {
    pub(super) const fn new(skew_steps: u64) -> Self {
        Self {
            last: [None; 2],
            passed: None,
            skew_steps,
        }
    }

    /// Judges a frame that arrives intact.
    pub(super) fn judge(&mut self, network: usize, number: u8, step: u64) -> Verdict {
        let last = self.last[network].replace(number);
        // One missing frame is accepted, as the standard does.
        let is_in_order = last
            .is_none_or(|last| number == 0 || number == next(last) || number == next(next(last)));
        if !is_in_order {
            return Verdict::OutOfOrder;
        }
        let is_first = self
            .passed
            .is_none_or(|(passed, at)| step - at > self.skew_steps || is_newer(number, passed));
        if !is_first {
            return Verdict::Redundant;
        }
        self.passed = Some((number, step));
        Verdict::First
    }

    /// Returns the state: the last number on each network, the number passed on last and its step, each number plus 1,
    /// and 0 for none.
    pub(super) fn state(&self) -> [u64; 4] {
        let number = |number: Option<u8>| number.map_or(0, |number| u64::from(number) + 1);
        let [a, b] = self.last.map(number);
        let (passed, at) = self.passed.unzip();
        [a, b, number(passed), at.unwrap_or(0)]
    }

    pub(super) fn restore(&mut self, state: [u64; 4]) {
        let number = |number: u64| u8::try_from(number.checked_sub(1)?).ok();
        let [a, b, passed, at] = state;
        self.last = [number(a), number(b)];
        self.passed = number(passed).map(|number| (number, at));
    }
}

/// Returns `true` if a number is ahead of another by at most half a cycle, or is that of a reset.
const fn is_newer(number: u8, than: u8) -> bool {
    match (number, than) {
        (0, than) => than != 0,
        (number, 0) => number <= NEWER,
        (number, than) => {
            let ahead = (number as i16 - than as i16).rem_euclid(255);
            ahead >= 1 && ahead <= NEWER as i16
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdicts(skew_steps: u64, arrivals: &[(usize, u8, u64)]) -> Vec<Verdict> {
        let mut redundancy = Redundancy::new(skew_steps);
        let judge = |&(network, number, step): &(usize, u8, u64)| {
            // A restored receiver goes on as the saved one.
            let mut copy = Redundancy::new(skew_steps);
            copy.restore(redundancy.state());
            assert_eq!(copy, redundancy);
            redundancy.judge(network, number, step)
        };
        arrivals.iter().map(judge).collect()
    }

    #[test]
    fn numbers_run_from_1_to_255_and_0_follows_a_reset_only() {
        assert_eq!((next(0), next(1), next(254), next(255)), (1, 2, 255, 1));
        assert!(is_newer(1, 255) && is_newer(127, 0) && !is_newer(128, 0));
        assert!(is_newer(0, 9) && !is_newer(0, 0) && !is_newer(9, 9));
        assert!(is_newer(128, 1) && !is_newer(129, 1) && is_newer(100, 228));
    }

    #[test]
    fn the_first_valid_frame_of_both_networks_wins() {
        use Verdict::{First, OutOfOrder, Redundant};
        type Case<'a> = (&'a str, u64, &'a [(usize, u8, u64)], &'a [Verdict]);
        #[rustfmt::skip] // a table
        let cases: &[Case<'_>] = &[
            ("the second copy is redundant", 1, &[(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 1)], &[First, Redundant, First, Redundant]),
            ("the other network fills a gap", 1, &[(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 2, 2), (1, 2, 2)], &[First, Redundant, First, First, Redundant]),
            ("two frames missing on a network make the next one invalid", 9, &[(0, 0, 0), (0, 3, 3), (0, 4, 4)], &[First, OutOfOrder, First]),
            ("a repeated frame is invalid on its network", 9, &[(0, 4, 0), (0, 4, 1), (0, 5, 1)], &[First, OutOfOrder, First]),
            ("an old frame is invalid on its network", 9, &[(0, 4, 0), (0, 5, 1), (0, 4, 1)], &[First, First, OutOfOrder]),
            ("a reset is accepted at once, and its copy is redundant", 9, &[(0, 77, 0), (1, 77, 0), (0, 0, 1), (1, 0, 1), (0, 1, 2)], &[First, Redundant, First, Redundant, First]),
            ("beyond the skew limit an old frame counts as new", 2, &[(0, 9, 0), (1, 8, 2), (1, 9, 3)], &[First, Redundant, First]),
        ];
        for (what, skew_steps, arrivals, expected) in cases {
            assert_eq!(verdicts(*skew_steps, arrivals), *expected, "{what}");
        }
    }
}
