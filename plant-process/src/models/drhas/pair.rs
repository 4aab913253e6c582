//! Pairs of numbers: the same quantity of both actuators.
//!
//! Used by the equations of the hydraulic system, which treat both actuators alike. One instruction computes both
//! numbers, each rounded as it would be alone: IEEE 754 defines sums, products, quotients and roots exactly, so a pair
//! has the same bits on every machine.

use std::ops::{Add, Div, Mul, Neg, Sub};

use wide::f64x2;

/// Quantity of both actuators, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair(f64x2);

impl Pair {
    /// Creates a pair of equal numbers.
    #[inline]
    #[must_use]
    pub const fn both(value: f64) -> Self {
        Self(f64x2::splat(value))
    }

    /// Returns the square roots.
    #[inline]
    #[must_use]
    pub fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    /// Returns the magnitudes.
    #[inline]
    #[must_use]
    pub fn abs(self) -> Self {
        Self(self.0.abs())
    }

    /// Returns these magnitudes with the signs of another pair.
    #[inline]
    #[must_use]
    pub fn with_sign_of(self, other: Self) -> Self {
        Self(self.0.copysign(other.0))
    }

    /// Negates the numbers for which another pair is negative.
    #[inline]
    #[must_use]
    pub fn flipped_where_negative(self, other: Self) -> Self {
        Self(self.0.flip_signs(other.0))
    }

    /// Replaces negative numbers by 0.
    #[inline]
    #[must_use]
    pub fn or_zero_if_negative(self) -> Self {
        Self(self.0.fast_max(f64x2::splat(0.0)))
    }

    /// Applies a function to each number.
    #[inline]
    #[must_use]
    pub fn map(self, function: impl FnMut(f64) -> f64) -> Self {
        Self::from(self.to_array().map(function))
    }

    /// Marks the numbers below those of another pair, and never NaN.
    #[inline]
    #[must_use]
    pub fn is_below(self, other: Self) -> Which {
        Which(self.0.simd_lt(other.0))
    }

    /// Marks the numbers above those of another pair, and never NaN.
    #[inline]
    #[must_use]
    pub fn is_above(self, other: Self) -> Which {
        Which(self.0.simd_gt(other.0))
    }

    /// Marks the numbers equal to those of another pair.
    #[inline]
    #[must_use]
    pub fn is_equal(self, other: Self) -> Which {
        Which(self.0.simd_eq(other.0))
    }

    /// Returns both numbers.
    #[inline]
    #[must_use]
    pub const fn to_array(self) -> [f64; 2] {
        self.0.to_array()
    }
}

impl From<[f64; 2]> for Pair {
    #[inline]
    fn from(numbers: [f64; 2]) -> Self {
        Self(f64x2::new(numbers))
    }
}

/// Mask that selects actuators.
#[derive(Clone, Copy, Debug)]
pub struct Which(f64x2);

impl Which {
    /// Returns `true` if the mask has at least one actuator.
    #[inline]
    #[must_use]
    pub fn any(self) -> bool {
        self.0.any()
    }

    /// Selects for each actuator the first number if it is marked, otherwise the second.
    #[inline]
    #[must_use]
    pub fn choose(self, where_true: Pair, elsewhere: Pair) -> Pair {
        Pair(self.0.bitselect(where_true.0, elsewhere.0))
    }
}

impl Add for Pair {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for Pair {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl Mul for Pair {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }
}

impl Mul<f64> for Pair {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        self * Self::both(factor)
    }
}

impl Div for Pair {
    type Output = Self;

    #[inline]
    fn div(self, other: Self) -> Self {
        Self(self.0 / other.0)
    }
}

impl Neg for Pair {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers whose signs, zeros and limits are easily lost.
    const NUMBERS: [f64; 12] = [
        0.0,
        -0.0,
        1.0,
        -3.0,
        0.1,
        7e-5,
        -28e6,
        1e-310,
        f64::MIN_POSITIVE,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];

    fn assert_same(pair: Pair, alone: [f64; 2]) {
        for (one, alone) in pair.to_array().into_iter().zip(alone) {
            let both_none = one.is_nan() && alone.is_nan();
            assert!(both_none || one.to_bits() == alone.to_bits(), "{pair:?}");
        }
    }

    #[test]
    fn every_number_is_computed_as_if_alone() {
        for a in NUMBERS {
            for b in NUMBERS {
                let (p, q) = (Pair::from([a, b]), Pair::from([b, a]));
                assert_same(p + q, [a + b, b + a]);
                assert_same(p - q, [a - b, b - a]);
                assert_same(p * q, [a * b, b * a]);
                assert_same(p / q, [a / b, b / a]);
                assert_same(p * 0.1, [a * 0.1, b * 0.1]);
                assert_same(-p, [-a, -b]);
                assert_same(p.abs(), [a.abs(), b.abs()]);
                assert_same(p.sqrt(), [a.sqrt(), b.sqrt()]);
                assert_same(p.with_sign_of(q), [a.copysign(b), b.copysign(a)]);
                let flipped = |x: f64, by: f64| if by.is_sign_negative() { -x } else { x };
                assert_same(p.flipped_where_negative(q), [flipped(a, b), flipped(b, a)]);
                assert_same(p.map(|x| x - 1.0), [a - 1.0, b - 1.0]);
            }
        }
    }

    #[test]
    fn numbers_that_are_not_positive_become_zero() {
        for (a, expected) in [
            (2.5, 2.5),
            (1e-310, 1e-310),
            (f64::INFINITY, f64::INFINITY),
            (0.0, 0.0),
            (-0.0, 0.0),
            (-28e6, 0.0),
        ] {
            let p = Pair::from([a, 1.0]).or_zero_if_negative();
            assert_same(p, [expected, 1.0]);
        }
    }

    #[test]
    fn each_number_is_chosen_independently() {
        let (yes, no) = (Pair::from([1.0, 2.0]), Pair::from([3.0, 4.0]));
        let choice = |truth: bool, i: usize| if truth { yes } else { no }.to_array()[i];
        for a in NUMBERS {
            for b in NUMBERS {
                let (p, q) = (Pair::from([a, b]), Pair::from([b, a]));
                for (which, [one, two]) in [
                    (p.is_below(q), [a < b, b < a]),
                    (p.is_above(q), [a > b, b > a]),
                    (p.is_equal(q), [a == b, b == a]),
                ] {
                    assert_same(which.choose(yes, no), [choice(one, 0), choice(two, 1)]);
                    assert_eq!(which.any(), one || two);
                }
            }
        }
    }
}
