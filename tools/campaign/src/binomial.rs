//! Exact bounds of a probability after a count of successes (Clopper and Pearson).
//!
//! The report calls [`bounds`] for every rate that it shows, and the verdict calls [`lower`] and [`upper`] for a
//! requirement such as "at least 0.999 with 95 % confidence". All bounds are exact: their coverage is at least the
//! stated confidence for any true probability.

use crate::tail::above;

/// Bounds of a probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    /// Smallest probability that is consistent with the count.
    pub lower: f64,
    /// Largest probability that is consistent with the count.
    pub upper: f64,
}

/// Two-sided bounds of the probability of success, with half of the risk on each side.
///
/// With `a = 1 - confidence`: the one-sided bounds at `a/2`, which are `0..1 - (a/2)^(1/n)` without a success and
/// `(a/2)^(1/n)..1` without a failure (C. J. Clopper and E. S. Pearson, Biometrika 26 (1934) 404-413; valid for
/// `successes <= trials` and `0 < confidence < 1`). `None` outside this range and for zero trials.
///
/// The risk is split equally even if all trials or none succeed: choosing the side by the data would reduce the coverage
/// to 92.7 % at 95 %.
pub(crate) fn bounds(successes: u64, trials: u64, confidence: f64) -> Option<Bounds> {
    if !is_valid(successes, trials, confidence) {
        return None;
    }
    let half = 0.5 * (1.0 - confidence);
    Some(Bounds {
        lower: lowest(successes, trials, half)[0],
        upper: lowest(trials - successes, trials, half)[1],
    })
}

/// Lower bound of the probability of success, with the whole risk on this side.
///
/// The `p` with `P(X >= successes) = 1 - confidence`, which is the quantile at `1 - confidence` of the beta
/// distribution with parameters `successes` and `trials - successes + 1` (Clopper and Pearson, 1934; G. J. Hahn and
/// W. Q. Meeker, Statistical Intervals, 1991, section 6.2; valid for `successes <= trials` and `0 < confidence < 1`).
/// 0 without a success; NaN outside this range and for zero trials.
pub(crate) fn lower(successes: u64, trials: u64, confidence: f64) -> f64 {
    if !is_valid(successes, trials, confidence) {
        return f64::NAN;
    }
    lowest(successes, trials, 1.0 - confidence)[0]
}

/// Upper bound of the probability of success, with the whole risk on this side.
///
/// The `p` with `P(X <= successes) = 1 - confidence`, which is the quantile at `confidence` of the beta distribution
/// with parameters `successes + 1` and `trials - successes` (Clopper and Pearson, 1934; Hahn and Meeker, 1991,
/// section 6.2; valid for `successes <= trials` and `0 < confidence < 1`). 1 without a failure; NaN outside this
/// range and for zero trials.
#[must_use]
pub fn upper(successes: u64, trials: u64, confidence: f64) -> f64 {
    if !is_valid(successes, trials, confidence) {
        return f64::NAN;
    }
    // "At most `successes` successes" is the same event as "at least `trials - successes` failures".
    lowest(trials - successes, trials, 1.0 - confidence)[1]
}

fn is_valid(successes: u64, trials: u64, confidence: f64) -> bool {
    // Neither end is allowed, not even by the rounding of 1 - confidence.
    trials > 0
        && successes <= trials
        && confidence > 0.0
        && 1.0 - confidence < 1.0
        && confidence < 1.0
}

/// Solves `P(X >= k) = risk` for `p`; returns `p` and `1 - p`.
///
/// Both are returned because computing the smaller one as a difference from 1 would lose its digits.
fn lowest(k: u64, n: u64, risk: f64) -> [f64; 2] {
    if k == 0 {
        return [0.0, 1.0];
    }
    if k == n {
        let ln = libm::log(risk) / n as f64;
        return [libm::exp(ln), -libm::expm1(ln)];
    }
    if risk <= 0.5 {
        return solved(k, n, libm::log(risk));
    }
    // The opposite tail is smaller: P(n - X >= n - k + 1) = 1 - risk.
    let (k, risk) = (n - k + 1, 1.0 - risk);
    let [q, p] = if k == n {
        lowest(k, n, risk)
    } else {
        solved(k, n, libm::log(risk))
    };
    [p, q]
}

/// Solves `ln P(X >= k) = ln_target` for `p`, with `ln_target` at most `ln 0.5`; returns `p` and `1 - p`.
///
/// Newton's method over `s = ln(p / (1 - p))`, where the derivative is `k (1 - p) b(k) / P(X >= k)` with the
/// probability `b` of exactly `k`. The logarithm of the tail is concave in `s`, so every step after the first
/// approaches the solution from below. The start `k/n` lies above the solution, since `n p` is the median whenever it
/// is an integer (R. Kaas and J. M. Buhrman, Statistica Neerlandica 34 (1980) 13-18).
fn solved(k: u64, n: u64, ln_target: f64) -> [f64; 2] {
    let (count, rest) = (k as f64, (n - k) as f64);
    let highest = libm::log(count / rest);
    let mut s = highest;
    let pair = |s: f64| [1.0 / (1.0 + libm::exp(-s)), 1.0 / (1.0 + libm::exp(s))];
    for _ in 0..100 {
        let [p, q] = pair(s);
        let tail = above(k, n, p, q);
        let step = (ln_target - tail.ln) / (count * q * tail.first);
        let next = s + step;
        // Rounding of the density must not move the solution to the rising side of the sum.
        s = if next < highest { next } else { highest };
        if step.abs() < 1e-12 {
            break;
        }
    }
    pair(s)
}

#[cfg(test)]
mod coverage;
#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn assert_near(actual: f64, expected: f64) {
        let is_near = (actual - expected).abs() <= 1e-9 * expected;
        assert!(is_near, "{actual:e}, not {expected:e}");
    }

    #[test]
    fn zero_and_all_of_ten_thousand_successes_take_half_of_the_risk() {
        // 1 - 0.025^(1/10000), by mpmath.
        let largest = 0.0003688199146187623;
        let none = bounds(0, 10_000, 0.95).expect("bounds");
        assert_near(none.upper, largest);
        assert_eq!(none.lower, 0.0);
        let all = bounds(10_000, 10_000, 0.95).expect("bounds");
        assert_near(all.lower, 1.0 - largest);
        assert_eq!(all.upper, 1.0);
    }

    #[test]
    fn one_sided_bounds_are_quantiles_of_the_beta_distribution() {
        // scipy.stats.beta.ppf(1 - c, k, n - k + 1) and scipy.stats.beta.isf(1 - c, k + 1, n - k)
        #[rustfmt::skip] // a table
        let cases = [
            (1, 1000, 0.95, 5.129197890901785e-05, 0.004734993575499777),
            (1, 1000, 0.3, 0.0012032483198515284, 0.001097295877520459),
            (2, 1000, 0.95, 0.00035547613347759705, 0.006282284546723426),
            (2, 1000, 0.3, 0.002437461809227487, 0.0019138586640042162),
            (333, 1000, 0.95, 0.308373901193985, 0.35835736234732873),
            (333, 1000, 0.3, 0.340396692988991, 0.32576998166356375),
            (999, 1000, 0.95, 0.9952650064245002, 0.999948708021091),
            (999, 1000, 0.3, 0.9989027041224795, 0.9987967516801485),
            (1, 10_000_000, 0.95, 5.129329425600047e-09, 4.743863629843794e-07),
            (1, 10_000_000, 0.3, 1.2039727318484133e-07, 1.0973492053621885e-07),
            (2, 10_000_000, 0.95, 3.553615221526485e-08, 6.295792269428931e-07),
            (2, 10_000_000, 0.3, 2.4392163080636447e-07, 1.9137758023777561e-07),
            (3_333_333, 10_000_000, 0.95, 0.3330880853520737, 0.33357858590062067),
            (3_333_333, 10_000_000, 0.3, 0.33341143161686254, 0.33325518559940875),
            (9_999_999, 10_000_000, 0.95, 0.999999525613637, 0.9999999948706706),
            (9_999_999, 10_000_000, 0.3, 0.9999998902650795, 0.9999998796027268),
        ];
        for (k, n, c, smallest, largest) in cases {
            assert_near(lower(k, n, c), smallest);
            assert_near(upper(k, n, c), largest);
        }
    }

    #[test]
    fn two_sided_bounds_share_the_risk() {
        // scipy.stats.beta.ppf((1 - c) / 2, k, n - k + 1) and beta.isf((1 - c) / 2, k + 1, n - k)
        for (k, n, c, smallest, largest) in [
            (
                1,
                1_000_000,
                0.99,
                5.012541810981499e-9,
                7.430105611978525e-6,
            ),
            (999, 1000, 0.9, 0.9952650064245002, 0.999948708021091),
        ] {
            let actual = bounds(k, n, c).expect("bounds");
            assert_near(actual.lower, smallest);
            assert_near(actual.upper, largest);
        }
    }

    #[test]
    fn the_lower_bound_of_a_single_success_has_a_closed_form() {
        // P(X >= 1) = 1 - (1 - p)^n = a, so that p = 1 - (1 - a)^(1/n).
        for n in [2, 10, 1000, 10_000_000, 1 << 50] {
            let expected = -libm::expm1(libm::log1p(-0.01) / n as f64);
            assert_near(lower(1, n, 0.99), expected);
        }
    }

    #[test]
    fn bounds_of_large_counts_approach_the_normal_distribution() {
        // p - 3.7190164854556804 sqrt(p q / n), with scipy.stats.norm.isf(1e-4).
        let (n, p) = (1_000_000_000_000_000, 0.1);
        let expected = p - 3.7190164854556804 * (p * (1.0 - p) / n as f64).sqrt();
        assert_near(lower(n / 10, n, 0.9999), expected);
        assert!(upper(u64::MAX / 3, u64::MAX, 0.95) > 1.0 / 3.0);
    }

    #[test]
    fn impossible_counts_have_no_bounds() {
        for (k, n, c) in [
            (0, 0, 0.95),
            (2, 1, 0.95),
            (1, 2, 0.0),
            (1, 2, 1.0),
            (1, 2, f64::NAN),
        ] {
            assert_eq!(bounds(k, n, c), None);
            assert!(lower(k, n, c).is_nan() && upper(k, n, c).is_nan());
        }
    }

    proptest! {
        #[test]
        fn bounds_lie_around_the_rate(n in 1u64.., share in 0.0..=1.0, c in 0.5..0.999999) {
            let k = n.min((share * n as f64) as u64);
            let actual = bounds(k, n, c).expect("bounds");
            let rate = k as f64 / n as f64;
            prop_assert!(0.0 <= actual.lower && actual.lower <= rate * (1.0 + 1e-12));
            prop_assert!(rate * (1.0 - 1e-12) <= actual.upper && actual.upper <= 1.0);
        }
    }
}
