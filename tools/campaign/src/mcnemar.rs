//! McNemar's exact test of two controllers over the same runs.
//!
//! The comparison of two campaigns calls [`exact`] with the number of runs on which they differ. Runs with equal
//! verdicts carry no information about the difference and are not needed.

use crate::tail::at_least;

/// Probability of counts at least as uneven as these if both controllers are equally good.
///
/// `P = 2 P(X >= max(b, c))`, at most 1, for a binomial `X` of `b + c` trials with the probability 0.5, where `b` and
/// `c` are the numbers of runs that only the first or only the second passed (Q. McNemar, Psychometrika 12 (1947)
/// 153-157, in the exact form of W. J. Conover, Practical Nonparametric Statistics, 3rd ed. 1999, sections 3.4 and
/// 3.5; valid for any counts). Equal counts, including zero, give 1; probabilities below 5e-324 give 0, and a sum of
/// the counts beyond 2^64 is taken as 2^64 - 1.
pub(crate) fn exact(first_only: u64, second_only: u64) -> f64 {
    if first_only == second_only {
        return 1.0;
    }
    let all = first_only.saturating_add(second_only);
    let p = 2.0 * at_least(first_only.max(second_only), all, 0.5, 0.5);
    if p < 1.0 { p } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_are_those_of_the_binomial_test() {
        // scipy.stats.binomtest(b, b + c, 0.5).pvalue
        for (b, c, expected) in [
            (0, 1, 1.0),
            (0, 6, 0.03125),
            (3, 9, 0.14599609375),
            (10, 4, 0.1795654296875),
            (120, 90, 0.045114087864840696),
            (50_000, 50_700, 0.02761286943193814),
            (1_000_000, 997_000, 0.033820459839196446),
            (1_000_000, 999_999, 1.0),
        ] {
            let actual = exact(b, c);
            assert!(
                (actual - expected).abs() <= 1e-11 * expected,
                "{actual}, not {expected}"
            );
            assert_eq!(actual, exact(c, b));
        }
    }

    #[test]
    fn equal_counts_show_no_difference() {
        for count in [0, 1, 1000, u64::MAX] {
            assert_eq!(exact(count, count), 1.0);
        }
    }

    #[test]
    fn a_one_sided_difference_gives_a_power_of_two() {
        for n in [1, 2, 10, 52, 100] {
            let expected = libm::exp2(1.0 - n as f64);
            assert!((exact(n, 0) - expected).abs() <= 1e-13 * expected);
        }
    }

    #[test]
    fn impossible_differences_have_no_probability() {
        assert_eq!(exact(1_000_000, 0), 0.0);
        assert_eq!(exact(u64::MAX, 1), 0.0);
    }
}
