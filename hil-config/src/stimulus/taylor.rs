//! Truncated Taylor arithmetic: a value together with its first five time derivatives.
//!
//! Used by [`evaluate`](super::evaluate), never by a model. The recurrences are those of Griewank and Walther,
//! Evaluating Derivatives, 2nd ed., section 13.2: every operation is exact up to rounding.

use std::ops::{Add, Mul, Neg};

/// Highest derivative.
const ORDER: usize = 5;

/// Repeats a block for each order from 1 on, with the order as a constant: the compiler does not unroll the triangular
/// loop of a recurrence by itself.
macro_rules! for_each_order {
    ($k:ident => $body:block) => {
        for_each_order!($k => $body, 1 2 3 4 5)
    };
    ($k:ident => $body:block, $($order:literal)*) => {
        $({
            let $k: usize = $order;
            $body
        })*
        const { assert!([$($order),*].len() == ORDER) }
    };
}

/// Function near an instant, as the coefficients of `c0 + c1 s + .. + c5 s^5`, where `s` is the time since that
/// instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taylor([f64; ORDER + 1]);

impl Taylor {
    /// Creates time itself, at an instant.
    pub(super) const fn time(time_s: f64) -> Self {
        Self([time_s, 1.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// Returns the value.
    pub(super) const fn value(&self) -> f64 {
        self.0[0]
    }

    /// Returns the value and the derivatives; the n-th derivative is n! times the n-th coefficient.
    pub(super) fn derivatives(&self) -> [f64; ORDER + 1] {
        const FACTORIALS: [f64; ORDER + 1] = [1.0, 1.0, 2.0, 6.0, 24.0, 120.0];
        std::array::from_fn(|n| FACTORIALS[n] * self.0[n])
    }

    /// Computes `s = sin u`, together with `c = cos u`, from `s' = c u'`, `c' = -s u'`.
    #[inline]
    pub(super) fn sin(&self) -> Self {
        let u = &self.0;
        let (mut s, c) = ([0.0; ORDER + 1], &mut [0.0; ORDER + 1]);
        (s[0], c[0]) = libm::sincos(u[0]);
        for_each_order!(k => {
            let (mut s_k, mut c_k) = (0.0, 0.0);
            for j in 1..=k {
                let weight = j as f64 * u[j];
                s_k += weight * c[k - j];
                c_k -= weight * s[k - j];
            }
            (s[k], c[k]) = (s_k / k as f64, c_k / k as f64);
        });
        Self(s)
    }

    /// Computes `e = exp(u) - 1`, from `e' = (e + 1) u'`. Accurate for `u` near 0.
    #[inline]
    pub(super) fn exp_m1(&self) -> Self {
        let u = &self.0;
        // Either the small difference from 1 or the small exponential is computed directly.
        let (less_one, exp) = if u[0].abs() < 0.5 {
            let less_one = libm::expm1(u[0]);
            (less_one, less_one + 1.0)
        } else {
            let exp = libm::exp(u[0]);
            (exp - 1.0, exp)
        };
        let mut e = [exp, 0.0, 0.0, 0.0, 0.0, 0.0];
        for_each_order!(k => {
            let mut e_k = 0.0;
            for j in 1..=k {
                e_k += j as f64 * u[j] * e[k - j];
            }
            e[k] = e_k / k as f64;
        });
        e[0] = less_one;
        Self(e)
    }

    /// Computes `y = atan u`, from `(1 + u^2) y' = u'`.
    #[inline]
    pub(super) fn atan(&self) -> Self {
        let u = &self.0;
        let Self(mut g) = *self * *self;
        g[0] += 1.0;
        let mut y = [libm::atan(u[0]), 0.0, 0.0, 0.0, 0.0, 0.0];
        for_each_order!(k => {
            let mut y_k = k as f64 * u[k];
            for j in 1..k {
                y_k -= j as f64 * y[j] * g[k - j];
            }
            y[k] = y_k / (k as f64 * g[0]);
        });
        Self(y)
    }
}

impl Add for Taylor {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl Add<f64> for Taylor {
    type Output = Self;

    #[inline]
    fn add(mut self, constant: f64) -> Self {
        self.0[0] += constant;
        self
    }
}

impl Mul for Taylor {
    type Output = Self;

    /// Cauchy product, unrolled by hand because the compiler does not unroll the triangular loop.
    #[inline]
    fn mul(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([
            a[0] * b[0],
            a[0] * b[1] + a[1] * b[0],
            a[0] * b[2] + a[1] * b[1] + a[2] * b[0],
            a[0] * b[3] + a[1] * b[2] + a[2] * b[1] + a[3] * b[0],
            a[0] * b[4] + a[1] * b[3] + a[2] * b[2] + a[3] * b[1] + a[4] * b[0],
            a[0] * b[5] + a[1] * b[4] + a[2] * b[3] + a[3] * b[2] + a[4] * b[1] + a[5] * b[0],
        ])
    }
}

impl Mul<f64> for Taylor {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|c| c * factor))
    }
}

impl Neg for Taylor {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self(self.0.map(|c| -c))
    }
}
