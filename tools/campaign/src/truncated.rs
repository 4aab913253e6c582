//! The truncated normal distribution, for any interval of the real axis.
//!
//! Used by the sampler. Values are not clamped to the interval except to correct rounding: clamping would put a step
//! at each end of the distribution.

use crate::normal::{FAR, cumulative, mills, quantile};

/// Quantile at `u` of a normal distribution truncated to the interval from `min` to `max`.
///
/// `x = mean + deviation Phi^-1((1 - u) Phi(a) + u Phi(b))` with `a = (min - mean) / deviation` and `b = (max - mean)
/// / deviation` (N. L. Johnson, S. Kotz and N. Balakrishnan, Continuous Univariate Distributions, vol. 1, 2nd ed.
/// 1994, chapter 13; valid for `deviation > 0` and `min < max`, either of which may be infinite). An interval above
/// the mean is mirrored into the lower tail; an interval more than 30 standard deviations away is solved in
/// logarithms.
///
/// The result never leaves the interval. A `u` of 0 or 1 gives `min` or `max`; a deviation of 0 gives the value of
/// the interval nearest to the mean. A `u` outside 0 to 1, a negative or infinite deviation, an infinite mean, `min >
/// max` and NaN give NaN.
pub(crate) fn truncated(mean: f64, deviation: f64, min: f64, max: f64, u: f64) -> f64 {
    let is_valid = mean.is_finite()
        && deviation.is_finite()
        && deviation >= 0.0
        && min <= max
        && (0.0..=1.0).contains(&u);
    if !is_valid {
        return f64::NAN;
    }
    if u == 0.0 || u == 1.0 {
        return if u == 0.0 { min } else { max };
    }
    if deviation == 0.0 {
        return within(mean, min, max);
    }
    let (a, b) = ((min - mean) / deviation, (max - mean) / deviation);
    let x = if a > FAR {
        min + deviation * beyond(a, b - a, 1.0 - u)
    } else if b < -FAR {
        max - deviation * beyond(-b, b - a, u)
    } else {
        mean + deviation * between(a, b, u)
    };
    within(x, min, max)
}

/// Quantile at `u` of the standard normal distribution between `a` and `b`, with neither end in the far upper tail.
fn between(a: f64, b: f64, u: f64) -> f64 {
    // The weights 1 - u and u keep digits that a difference of probabilities would lose.
    let lower = (1.0 - u) * cumulative(a) + u * cumulative(b);
    if lower <= 0.5 {
        return quantile(lower);
    }
    -quantile((1.0 - u) * cumulative(-a) + u * cumulative(-b))
}

/// Distance from `a` beyond which the share `share_beyond` of the tail from `a` to `a + width` lies.
///
/// Newton's method for `ln Q(a + t) - ln Q(a) = ln(share_beyond + (1 - share_beyond) Q(a + width) / Q(a))`, where `Q = 1 - Phi` and
/// the derivative is `-1 / M(a + t)`. `ln Q` is concave, so every step after the first approaches the solution from
/// the same side.
fn beyond(a: f64, width: f64, share_beyond: f64) -> f64 {
    let start = mills(a);
    let ln_share = |t: f64| -t * (a + 0.5 * t) + libm::log(mills(a + t) / start);
    let ln_rest = ln_share(width);
    // Computed from whichever share is small, the one before or the one beyond the solution, to keep its digits.
    let share_before = (1.0 - share_beyond) * -libm::expm1(ln_rest);
    let ln_ratio = if share_before < 0.5 {
        libm::log1p(-share_before)
    } else {
        libm::log(share_beyond + (1.0 - share_beyond) * libm::exp(ln_rest))
    };
    // The root of -t (a + t/2) = ln_ratio.
    let mut t = -2.0 * ln_ratio / (a + (a * a - 2.0 * ln_ratio).sqrt());
    for _ in 0..6 {
        t += (ln_share(t) - ln_ratio) * mills(a + t);
    }
    t
}

/// Clamps a value to the interval; NaN, which an overflow may produce, becomes the lower end.
fn within(x: f64, min: f64, max: f64) -> f64 {
    if x > max {
        max
    } else if x >= min {
        x
    } else {
        min
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::normal::tests::assert_near;
    use proptest::prelude::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn truncated_values_agree_with_scipy() {
        // scipy.stats.truncnorm.ppf(u, a, b, loc=mean, scale=deviation)
        for ([mean, deviation, min, max, u], expected) in [
            ([0.0, 1.0, -1.0, 2.0, 0.3], -0.2424038178892269),
            ([5.0, 2.0, 4.0, INF, 0.9], 7.964359356881815),
            ([5.0, 2.0, -INF, 4.0, 0.01], -0.47713482885411906),
            ([0.0, 1.0, 10.0, 11.0, 0.5], 10.068409369547618),
            ([0.0, 1.0, -11.0, -10.0, 0.5], -10.068409369547618),
            ([0.0, 1.0, 25.0, INF, 1e-6], 25.000000039936328),
        ] {
            let actual = truncated(mean, deviation, min, max, u);
            assert_near(actual, expected, 4e-15);
        }
    }

    #[test]
    fn intervals_far_from_the_mean_keep_full_precision() {
        // mpmath.findroot with 50 digits, in judge.py.
        for (min, max, u, expected) in [
            (31.0, INF, 0.5, 31.022328367148035),
            (50.0, 51.0, 0.999, 50.13790987010764),
            (50.0, 50.001, 0.25, 50.00024535164034),
            (200.0, 201.0, 0.75, 200.0069311784347),
        ] {
            assert_near(truncated(0.0, 1.0, min, max, u), expected, 1e-15);
            assert_near(truncated(0.0, 1.0, -max, -min, 1.0 - u), -expected, 1e-15);
        }
    }

    #[test]
    fn zero_deviation_gives_the_nearest_value_of_the_interval() {
        assert_eq!(truncated(0.0, 0.0, -1.0, 1.0, 0.3), 0.0);
        assert_eq!(truncated(5.0, 0.0, -1.0, 1.0, 0.3), 1.0);
        assert_eq!(truncated(5.0, 1.0, 2.0, 2.0, 0.3), 2.0);
        assert!(truncated(0.0, 1.0, 1.0, -1.0, 0.3).is_nan());
        assert!(truncated(0.0, -1.0, -1.0, 1.0, 0.3).is_nan());
        assert!(truncated(0.0, 1.0, -1.0, 1.0, 1.5).is_nan());
    }

    proptest! {
        #[test]
        fn truncated_values_stay_inside(
            mean: f64, deviation in 0.0..f64::MAX, one: f64, other: f64, u in 0.0..=1.0
        ) {
            let (min, max) = if one < other { (one, other) } else { (other, one) };
            let x = truncated(mean, deviation, min, max, u);
            prop_assert!(min <= x && x <= max, "{}", x);
        }

        #[test]
        fn truncated_values_rise_with_their_probability(
            mean in -40.0..40.0, width in 1e-3..20.0, u in 0.01..0.98
        ) {
            let at = |u| truncated(mean, 1.0, 0.0, width, u);
            prop_assert!(at(u) < at(u + 0.01));
        }
    }
}
