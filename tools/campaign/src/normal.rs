//! The normal distribution.
//!
//! The sampler uses these functions to convert a probability into a value, and the intervals of the report use them as
//! well. They draw no random numbers.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Number of standard deviations beyond which the tail is computed in logarithms. The probability there is about
/// 5e-198, so that both sides of the limit are far from underflow.
pub(crate) const FAR: f64 = 30.0;

/// Coefficients of Wichura's rational functions, highest power first: numerator and denominator.
type Ratio = [[f64; 8]; 2];

/// For `|p - 0.5| <= 0.425` (`a` and `b` of AS 241).
const CENTRE: Ratio = [
    [
        2509.0809287301227,
        33430.57558358813,
        67265.7709270087,
        45921.95393154987,
        13731.69376550946,
        1971.5909503065513,
        133.14166789178438,
        3.3871328727963665,
    ],
    [
        5226.495278852854,
        28729.085735721943,
        39307.89580009271,
        21213.794301586597,
        5394.196021424751,
        687.1870074920579,
        42.31333070160091,
        1.0,
    ],
];

/// For `sqrt(-ln p) <= 5` (`c` and `d` of AS 241).
const SIDE: Ratio = [
    [
        0.0007745450142783414,
        0.022723844989269184,
        0.2417807251774506,
        1.2704582524523684,
        3.6478483247632045,
        5.769497221460691,
        4.630337846156546,
        1.4234371107496835,
    ],
    [
        1.0507500716444169e-09,
        0.0005475938084995345,
        0.015198666563616457,
        0.14810397642748008,
        0.6897673349851,
        1.6763848301838038,
        2.053191626637759,
        1.0,
    ],
];

/// For `sqrt(-ln p) > 5` (`e` and `f` of AS 241).
const END: Ratio = [
    [
        2.0103343992922881e-07,
        2.7115555687434876e-05,
        0.0012426609473880784,
        0.026532189526576124,
        0.29656057182850487,
        1.7848265399172913,
        5.463784911164114,
        6.657904643501103,
    ],
    [
        2.0442631033899397e-15,
        1.421511758316446e-07,
        1.8463183175100548e-05,
        0.0007868691311456133,
        0.014875361290850615,
        0.1369298809227358,
        0.599832206555888,
        1.0,
    ],
];

/// Probability that a standard normal value is at most `z`.
///
/// `Phi(z) = erfc(-z / sqrt(2)) / 2` (Abramowitz and Stegun, Handbook of Mathematical Functions, 1964,
/// eq. 26.2.29; valid for any `z`). The relative error grows as `1e-16 z^2` in the lower tail; below
/// -38.5 the result is 0. NaN gives NaN.
pub(crate) fn cumulative(z: f64) -> f64 {
    0.5 * libm::erfc(-z * FRAC_1_SQRT_2)
}

/// Quantile of the standard normal distribution: the value below which a share `p` of all values lies.
///
/// `z = Phi^-1(p)` by three rational functions (M. J. Wichura, Algorithm AS 241, routine PPND16, Applied Statistics
/// 37 (1988) 477-484; valid for `0 < p < 1`, with a relative error of 1e-15). 0 gives minus infinity, 1 gives
/// infinity, and other values give NaN.
pub(crate) fn quantile(p: f64) -> f64 {
    if !(0.0..=1.0).contains(&p) {
        return f64::NAN;
    }
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        return q * ratio(&CENTRE, 0.180625 - q * q);
    }
    let r = if q < 0.0 { p } else { 1.0 - p };
    if r == 0.0 {
        return if q < 0.0 {
            -f64::INFINITY
        } else {
            f64::INFINITY
        };
    }
    let r = (-libm::log(r)).sqrt();
    let z = if r <= 5.0 {
        ratio(&SIDE, r - 1.6)
    } else {
        ratio(&END, r - 5.0)
    };
    if q < 0.0 { -z } else { z }
}

/// Upper tail of the standard normal distribution divided by its density (Mills ratio).
///
/// `M(z) = (1 - Phi(z)) / phi(z) = 1/(z + 1/(z + 2/(z + 3/(z + ..))))` (Abramowitz and Stegun, eq. 26.2.14, truncated
/// after 30 terms; valid for `z >= 30`, to the last bits). Infinity gives 0; the fraction would need more terms below
/// 30.
pub(crate) fn mills(z: f64) -> f64 {
    let terms = (1..=30).rev().map(f64::from);
    1.0 / terms.fold(z, |rest, term| z + term / rest)
}

/// Logarithm of the upper tail of the standard normal distribution.
///
/// `ln(1 - Phi(z))`, beyond 30 as `-z^2/2 - ln(2 pi)/2 + ln M(z)` (Abramowitz and Stegun, section 26.2;
/// valid for any `z`). Infinity gives minus infinity, and NaN gives NaN.
pub(crate) fn ln_above(z: f64) -> f64 {
    if z > FAR {
        return -0.5 * z * z - 0.5 * libm::log(2.0 * PI) + libm::log(mills(z));
    }
    if z < 0.0 {
        return libm::log1p(-cumulative(z));
    }
    libm::log(cumulative(-z))
}

fn ratio([above, below]: &Ratio, x: f64) -> f64 {
    let value = |powers: &[f64; 8]| powers.iter().fold(0.0, |sum, power| sum * x + power);
    value(above) / value(below)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    pub(crate) fn assert_near(actual: f64, expected: f64, share: f64) {
        let is_near = (actual - expected).abs() <= share * expected.abs();
        assert!(is_near, "{actual:e}, not {expected:e}");
    }

    #[test]
    fn both_tails_keep_their_digits() {
        // scipy.special.ndtr(z)
        for (z, expected, share) in [
            (-37.0, 5.7255712225239266e-300, 3e-13),
            (-20.0, 2.7536241186061556e-89, 5e-14),
            (-8.0, 6.22096057427174e-16, 1e-14),
            (-3.0, 0.0013498980316300933, 1e-15),
            (-1.0, 0.15865525393145707, 1e-15),
            (0.0, 0.5, 0.0),
            (0.5, 0.6914624612740131, 1e-15),
            (2.0, 0.9772498680518208, 1e-15),
            (5.0, 0.9999997133484281, 1e-15),
            (8.0, 0.9999999999999993, 1e-15),
        ] {
            assert_near(cumulative(z), expected, share);
        }
        assert_eq!((cumulative(-INF), cumulative(INF)), (0.0, 1.0));
    }

    #[test]
    fn quantiles_agree_with_scipy_to_the_last_bits() {
        // scipy.special.ndtri(p)
        for (p, expected) in [
            (1e-300, -37.0470962993612),
            (1e-100, -21.273453560965322),
            (1e-20, -9.262340089798409),
            (1e-10, -6.361340902404056),
            (0.001, -3.090232306167813),
            (0.07, -1.4757910281791706),
            (0.1, -1.2815515655446004),
            (0.3, -0.5244005127080409),
            (0.6, 0.2533471031357997),
            (0.95, 1.6448536269514722),
            (0.999, 3.090232306167813),
        ] {
            assert_near(quantile(p), expected, 1e-15);
        }
        assert_eq!((quantile(0.0), quantile(1.0)), (-INF, INF));
        assert_eq!(quantile(0.5), 0.0);
        for outside in [-1e-300, 1.0 + f64::EPSILON, f64::NAN, INF] {
            assert!(quantile(outside).is_nan());
        }
    }
}
