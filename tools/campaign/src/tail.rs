//! Tails of the binomial distribution, as logarithms.
//!
//! [`crate::binomial`], [`crate::order`] and [`crate::mcnemar`] use the function [`above`]. Every tail is a sum of
//! positive terms, starting with the largest, so that no digits cancel.

use std::f64::consts::PI;

use crate::normal::ln_above;

/// Variance beyond which a tail is approximated instead of summed; the sum has terms for about eight standard
/// deviations, which is 80,000 here.
const LARGE_VARIANCE: f64 = 1e8;

/// Tail of the binomial distribution.
pub(crate) struct Tail {
    /// Logarithm of the probability.
    pub(crate) ln: f64,
    /// Probability of the first count of the tail, relative to the whole tail.
    pub(crate) first: f64,
}

/// Probability that at least `k` of `n` trials succeed, each with the probability `p = 1 - q`.
///
/// `P(X >= k) = b(k) (1 + (n-k)/(k+1) p/q + (n-k)(n-k-1)/((k+1)(k+2)) (p/q)^2 + ..)`, where `b` is the probability of
/// exactly `k` (N. L. Johnson, A. W. Kemp and S. Kotz, Univariate Discrete Distributions, 3rd ed. 2005, chapter 3).
/// Valid for `0 < k < n`, `0 < p < 1` and `k >= n p`; below that the terms rise at first, and the sum becomes long.
/// Variances above 1e8 use [`saddlepoint`] instead.
pub(crate) fn above(k: u64, n: u64, p: f64, q: f64) -> Tail {
    let (k, n) = (k as f64, n as f64);
    let rest = n - k;
    let density = ln_density(k, n, p, q);
    if k * (rest / n) > LARGE_VARIANCE {
        let ln = saddlepoint(k, n, p, q);
        let first = libm::exp(density - ln);
        return Tail { ln, first };
    }
    let odds = p / q;
    let (mut sum, mut term, mut j) = (1.0, 1.0, 0.0);
    while j < rest && term > 1e-17 * sum {
        term *= (rest - j) / (k + 1.0 + j) * odds;
        sum += term;
        j += 1.0;
    }
    Tail {
        ln: density + libm::log(sum),
        first: 1.0 / sum,
    }
}

/// Probability, from 0 to 1, that at least `k` of `n` trials succeed, for any `k`.
///
/// `P(X >= k) = 1 - P(n - X >= n - k + 1)` selects the shorter tail (valid for `0 <= p <= 1`, with `q = 1 - p`). 1
/// for `k = 0`, and 0 for `k > n`.
pub(crate) fn at_least(k: u64, n: u64, p: f64, q: f64) -> f64 {
    if k == 0 || k > n {
        return if k == 0 { 1.0 } else { 0.0 };
    }
    if k as f64 <= n as f64 * p {
        return 1.0 - at_least_above(n - k + 1, n, q, p);
    }
    at_least_above(k, n, p, q)
}

fn at_least_above(k: u64, n: u64, p: f64, q: f64) -> f64 {
    if k == n {
        return libm::exp(n as f64 * libm::log(p));
    }
    libm::exp(above(k, n, p, q).ln)
}

/// Logarithm of the probability of exactly `k` of `n`.
///
/// `ln b = d(n) - d(k) - d(n-k) - D(k, n p) - D(n-k, n q) + ln(n / (2 pi k (n-k))) / 2` with the error `d` of
/// Stirling's formula and the deviance `D` (C. Loader, Fast and Accurate Computation of Binomial Probabilities, 2000;
/// valid for `0 < k < n` and `0 < p < 1`). The terms are infinite at both ends.
fn ln_density(k: f64, n: f64, p: f64, q: f64) -> f64 {
    let rest = n - k;
    stirling_error(n)
        - stirling_error(k)
        - stirling_error(rest)
        - deviance(k, n * p)
        - deviance(rest, n * q)
        - 0.5 * libm::log(2.0 * PI * k * (rest / n))
}

/// Error of Stirling's formula for the logarithm of a factorial.
///
/// `d(n) = ln n! - (n ln n - n + ln(2 pi n) / 2) = 1/(12 n) - 1/(360 n^3) + 1/(1260 n^5) - ..` (Loader, 2000; valid
/// for `n >= 1`). Below 16 it is computed from the logarithm of the factorial itself.
fn stirling_error(n: f64) -> f64 {
    if n < 16.0 {
        let formula = n * libm::log(n) - n + 0.5 * libm::log(2.0 * PI * n);
        return libm::lgamma(n + 1.0) - formula;
    }
    let s = 1.0 / (n * n);
    let terms = [
        1.0 / 1188.0,
        -1.0 / 1680.0,
        1.0 / 1260.0,
        -1.0 / 360.0,
        1.0 / 12.0,
    ];
    terms.iter().fold(0.0, |sum, term| sum * s + term) / n
}

/// Deviance of a count `x` with the mean `m`.
///
/// `D = x ln(x/m) + m - x`, near the mean as `(x-m) v + 2 x (v^3/3 + v^5/5 + ..)` with
/// `v = (x-m) / (x+m)` (Loader, 2000; valid for `x > 0` and `m > 0`).
fn deviance(x: f64, m: f64) -> f64 {
    let v = (x - m) / (x + m);
    if v.abs() >= 0.1 {
        return x * libm::log(x / m) + m - x;
    }
    let s = v * v;
    // 0.1^20 / 21 is below the last bit.
    let series = (1..=10).rev().map(|j| 1.0 / f64::from(2 * j + 1));
    (x - m) * v + 2.0 * x * v * series.fold(0.0, |sum, term| (sum + term) * s)
}

/// Logarithm of the probability that at least `k` of `n` trials succeed, for large variances.
///
/// `P = 1 - Phi(r) + phi(r) (1/u - 1/r)` at `x = k - 1/2`, with `r^2/2` the sum of both deviances, `u = 2 sinh(s/2)
/// sqrt(x (n-x) / n)` and `s = ln(x q / ((n-x) p))` (H. E. Daniels, Tail Probability Approximations, Int. Stat. Rev.
/// 55 (1987) 37-48, with his second continuity correction; valid for a variance above 1e8, where the relative error
/// is below 1e-8). Up to `r = 1`, where the difference of the two fractions would lose its digits, its limit is used:
/// `(p - q) / (6 sqrt(n p q))`.
fn saddlepoint(k: f64, n: f64, p: f64, q: f64) -> f64 {
    let (x, rest) = (k - 0.5, n - k + 0.5);
    let half = deviance(x, n * p) + deviance(rest, n * q);
    let r = (2.0 * half).sqrt();
    let r = if x < n * p { -r } else { r };
    let s = libm::log(x / (n * p)) - libm::log(rest / (n * q));
    let u = 2.0 * libm::sinh(0.5 * s) * (x * (rest / n)).sqrt();
    let correction = if r.abs() < 1.0 {
        (p - q) / (6.0 * (n * p * q).sqrt())
    } else {
        1.0 / u - 1.0 / r
    };
    let ln_above = ln_above(r);
    let ln_density = -0.5 * r * r - 0.5 * libm::log(2.0 * PI);
    ln_above + libm::log1p(libm::exp(ln_density - ln_above) * correction)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::normal::tests::assert_near;

    #[test]
    fn tails_on_both_sides_of_the_mean_agree_with_scipy() {
        // scipy.stats.binom.sf(k - 1, n, p)
        for (k, n, p, expected) in [
            (3, 10, 0.2, 0.32220047360000015),
            (7, 10, 0.9, 0.9872048016),
            (520, 1000, 0.5, 0.10872414660207075),
            (1, 1_000_000, 1e-9, 0.0009995001671245088),
            (999_997, 1_000_000, 0.999999, 0.9810119044353335),
            (20, 40, 0.01, 1.138397833862598e-29),
        ] {
            assert_near(at_least(k, n, p, 1.0 - p), expected, 1e-12);
        }
    }

    #[test]
    fn the_ends_of_the_distribution_match_closed_forms() {
        assert_eq!(at_least(0, 10, 0.3, 0.7), 1.0);
        assert_eq!(at_least(11, 10, 0.3, 0.7), 0.0);
        assert_near(at_least(10, 10, 0.5, 0.5), 1.0 / 1024.0, 1e-15);
        assert_near(at_least(1, 10, 0.5, 0.5), 1023.0 / 1024.0, 1e-15);
    }

    #[test]
    fn large_variances_are_approximated_closely() {
        // summed(k, n, p) in judge.py: a first term by mpmath.loggamma, its ratios by numpy.
        let n = 1_000_000_000;
        for (k, p, expected) in [
            (250_000_100, 0.25, 0.49709870264883765),
            (250_012_000, 0.25, 0.19042777878451658),
            (250_020_000, 0.25, 0.07206947782720208),
            (250_200_000, 0.25, 1.31246372952002e-48),
            (500_000_100, 0.5, 0.4974894997105304),
            (500_012_000, 0.5, 0.22395169799286763),
            (500_020_000, 0.5, 0.1029572740506828),
            (500_200_000, 0.5, 5.6596842737767884e-37),
        ] {
            assert_near(at_least(k, n, p, 1.0 - p), expected, 1e-9);
        }
    }
}
