//! McNemar's exact test of two controllers over the same runs.
//!
//! The comparison of two campaigns calls [`exact`] with the runs on which they differ. Runs on which
//! both agree say nothing about the difference, and are not asked for.

use crate::tail::at_least;

/// Probability, if both are equally good, of counts at least as uneven as these.
///
/// `P = 2 P(X >= max(b, c))`, at most 1, for a binomial `X` of `b + c` trials with the probability 0.5,
/// where `b` and `c` are the runs that only the first or only the second passed (Q. McNemar,
/// Psychometrika 12 (1947) 153-157, in the exact form of W. J. Conover, Practical Nonparametric
/// Statistics, 3rd ed. 1999, sections 3.4 and 3.5; valid for any counts). Equal counts, and none, give
/// 1; probabilities below 5e-324 give 0, and a sum of the counts beyond 2^64 counts as 2^64 - 1.
#[must_use]
pub fn exact(first_only: u64, second_only: u64) -> f64 {
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
        for (b, c, wanted) in [
            (0, 1, 1.0),
            (0, 6, 0.03125),
            (3, 9, 0.14599609375),
            (10, 4, 0.1795654296875),
            (120, 90, 0.045114087864840696),
            (50_000, 50_700, 0.02761286943193814),
            (1_000_000, 997_000, 0.033820459839196446),
            (1_000_000, 999_999, 1.0),
        ] {
            let found = exact(b, c);
            assert!(
                (found - wanted).abs() <= 1e-11 * wanted,
                "{found}, not {wanted}"
            );
            assert_eq!(found, exact(c, b));
        }
    }

    #[test]
    fn equal_counts_show_no_difference() {
        for count in [0, 1, 1000, u64::MAX] {
            assert_eq!(exact(count, count), 1.0);
        }
    }

    #[test]
    fn only_one_winner_is_a_power_of_two() {
        for n in [1, 2, 10, 52, 100] {
            let wanted = libm::exp2(1.0 - n as f64);
            assert!((exact(n, 0) - wanted).abs() <= 1e-13 * wanted);
        }
    }

    #[test]
    fn impossible_differences_have_no_probability() {
        assert_eq!(exact(1_000_000, 0), 0.0);
        assert_eq!(exact(u64::MAX, 1), 0.0);
    }
}
