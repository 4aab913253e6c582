//! Quantiles of a sample, and confidence bounds for the quantiles of its distribution.
//!
//! The report calls both functions for every result of a campaign. The functions assume no distribution and accept
//! infinite values.

use crate::tail::at_least;

/// Relative excess over half of the risk that a tail may have due to rounding.
const ROUNDING: f64 = 1e-12;

/// Quantile of values in ascending order, by linear interpolation between neighbours.
///
/// `x = x_j + (x_(j+1) - x_j) g` with `j + g = (n - 1) p`, counted from 0 (R. J. Hyndman and Y. Fan, Sample Quantiles
/// in Statistical Packages, Am. Stat. 50 (1996) 361-365, definition 7, the default of numpy.quantile; valid for `0 <=
/// p <= 1`). An infinite neighbour gives infinity, unless the quantile coincides with the other neighbour; a quantile
/// between minus infinity and infinity is NaN. An empty slice, a NaN neighbour, and `p` outside 0 to 1 give NaN.
/// Values in any other order give a meaningless result.
pub(crate) fn quantile(sorted: &[f64], p: f64) -> f64 {
    if sorted.is_empty() || !(0.0..=1.0).contains(&p) {
        return f64::NAN;
    }
    let last = sorted.len() - 1;
    let place = last as f64 * p;
    // The conversion saturates; only rounding for a length beyond 2^53 could exceed the last index.
    let j = (place as usize).clamp(0, last);
    let g = place - libm::floor(place);
    let a = sorted[j];
    if g == 0.0 || j == last {
        return a;
    }
    between(a, sorted[j + 1], g)
}

fn between(a: f64, b: f64, g: f64) -> f64 {
    if a == b {
        return a;
    }
    let gap = b - a;
    if gap.is_infinite() {
        // Either an end is infinite, or only the difference of two large values of opposite sign is.
        return a * (1.0 - g) + b * g;
    }
    // Interpolating from the nearer end, as numpy does, is exact at both ends.
    if g < 0.5 {
        a + gap * g
    } else {
        b - gap * (1.0 - g)
    }
}

/// Indices, counted from 0, of the two values of a sorted sample that bound a quantile of its distribution.
///
/// The largest `l` with `P(X <= l) <= a/2` and the smallest `u` with `P(X > u) <= a/2` for a binomial `X` of `count`
/// trials with the probability `p`, and `a = 1 - confidence` (G. J. Hahn and W. Q. Meeker, Statistical Intervals,
/// 1991, section 5.2; W. J. Conover, Practical Nonparametric Statistics, 3rd ed. 1999, section 3.2; valid for any
/// distribution and independent values, `0 < p < 1` and `0 < confidence < 1`). `None` outside this range, and for a
/// sample too small to have half of the risk on each side.
pub(crate) fn quantile_bounds(count: u64, p: f64, confidence: f64) -> Option<(u64, u64)> {
    let is_share = |share: f64| share > 0.0 && share < 1.0;
    if !is_share(p) || !is_share(confidence) {
        return None;
    }
    let q = 1.0 - p;
    let risk = 0.5 * (1.0 - confidence) * (1.0 + ROUNDING);
    // The lower bound follows from the count of failures, the upper bound from that of successes.
    let fewest_failures = smallest(count, q, p, risk)?;
    let fewest_successes = smallest(count, p, q, risk)?;
    Some((count - fewest_failures, fewest_successes - 1))
}

/// Finds the smallest `k` from 1 to `n` with `P(X >= k) <= risk`.
fn smallest(n: u64, p: f64, q: f64, risk: f64) -> Option<u64> {
    if n == 0 || at_least(n, n, p, q) > risk {
        return None;
    }
    // Zero successes are always reached, `n` rarely often enough.
    let (mut above, mut below) = (0, n);
    while below - above > 1 {
        let middle = above + (below - above) / 2;
        if at_least(middle, n, p, q) > risk {
            above = middle;
        } else {
            below = middle;
        }
    }
    Some(below)
}

#[cfg(test)]
mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn quantiles_agree_with_numpy() {
        let values = [-3.0, -1.5, 0.0, 0.1, 2.0, 7.0, 7.0, 11.0];
        // numpy.quantile(values, p)
        for (p, expected) in [
            (0.0, -3.0),
            (0.05, -2.475),
            (0.1, -1.95),
            (0.25, -0.375),
            (1.0 / 3.0, 0.033333333333333305),
            (0.5, 1.05),
            (0.9, 8.2),
            (0.99, 10.719999999999999),
            (1.0, 11.0),
        ] {
            assert_eq!(quantile(&values, p), expected, "{p}");
        }
    }

    #[test]
    fn an_infinite_value_affects_only_adjacent_quantiles() {
        let values = [-INF, 1.0, 2.0, 3.0, INF];
        assert_eq!(quantile(&values, 0.0), -INF);
        assert_eq!(quantile(&values, 0.1), -INF);
        assert_eq!(quantile(&values, 0.25), 1.0);
        assert_eq!(quantile(&values, 0.5), 2.0);
        assert_eq!(quantile(&values, 0.75), 3.0);
        assert_eq!(quantile(&values, 0.9), INF);
        assert_eq!(quantile(&[INF, INF], 0.3), INF);
        assert!(quantile(&[-INF, INF], 0.3).is_nan());
    }

    #[test]
    fn an_empty_sample_or_an_invalid_share_gives_nan() {
        assert!(quantile(&[], 0.5).is_nan());
        assert!(quantile(&[1.0], 1.1).is_nan() && quantile(&[1.0], f64::NAN).is_nan());
        assert!(quantile(&[1.0, f64::NAN], 0.5).is_nan());
        assert_eq!(quantile(&[1.0, 2.0, f64::NAN], 0.5), 2.0);
        assert_eq!(quantile(&[-f64::MAX, f64::MAX], 0.5), 0.0);
    }

    #[test]
    fn quantile_bounds_leave_half_of_the_risk_on_each_side() {
        // scipy.stats.binom.cdf(l, n, p) and binom.sf(u, n, p), both at most (1 - confidence) / 2
        for (count, p, confidence, expected) in [
            (100, 0.5, 0.95, Some((39, 60))),
            (1000, 0.9, 0.95, Some((880, 918))),
            (10_000, 0.01, 0.99, Some((74, 127))),
            (71, 0.95, 0.95, None),
            (72, 0.95, 0.95, Some((63, 71))),
            (73, 0.95, 0.95, Some((64, 72))),
            (6, 0.5, 0.95, Some((0, 5))),
            (5, 0.5, 0.95, None),
        ] {
            assert_eq!(
                quantile_bounds(count, p, confidence),
                expected,
                "{count} {p}"
            );
        }
    }

    #[test]
    fn a_tail_of_exactly_half_of_the_risk_is_accepted() {
        // 2 / 2^5 is 1 - 0.9375.
        assert_eq!(quantile_bounds(5, 0.5, 0.9375), Some((0, 4)));
    }

    #[test]
    fn bounds_of_invalid_arguments_are_none() {
        for (p, confidence) in [
            (0.0, 0.9),
            (1.0, 0.9),
            (0.5, 1.0),
            (0.5, 0.0),
            (f64::NAN, 0.9),
        ] {
            assert_eq!(quantile_bounds(1000, p, confidence), None);
        }
        assert_eq!(quantile_bounds(0, 0.5, 0.9), None);
        assert_eq!(quantile_bounds(1, 0.5, 0.9), None);
        // Checks only that the search ends for a count beyond any sample.
        assert!(quantile_bounds(u64::MAX, 0.5, 0.9).is_some());
    }
}
