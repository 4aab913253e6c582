//! Exact discrete open loops, and their margins by bisection: none of it shares code with the tool.

use std::f64::consts::TAU;
use std::ops::{Add, Div, Mul, Sub};

/// Sample period of every loop here.
pub(super) const PERIOD_S: f64 = 1e-3;

/// Complex number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Complex(pub(super) f64, pub(super) f64);

impl Complex {
    pub(super) fn size(self) -> f64 {
        libm::hypot(self.0, self.1)
    }

    /// Phase in degrees, from -360 to 0.
    fn phase_deg(self) -> f64 {
        let phase = libm::atan2(self.1, self.0).to_degrees();
        if phase > 0.0 { phase - 360.0 } else { phase }
    }
}

impl From<f64> for Complex {
    fn from(re: f64) -> Self {
        Self(re, 0.0)
    }
}

impl Add for Complex {
    type Output = Self;

    fn add(self, b: Self) -> Self {
        Self(self.0 + b.0, self.1 + b.1)
    }
}

impl Sub for Complex {
    type Output = Self;

    fn sub(self, b: Self) -> Self {
        Self(self.0 - b.0, self.1 - b.1)
    }
}

impl Mul for Complex {
    type Output = Self;

    fn mul(self, b: Self) -> Self {
        Self(self.0 * b.0 - self.1 * b.1, self.0 * b.1 + self.1 * b.0)
    }
}

impl Div for Complex {
    type Output = Self;

    fn div(self, b: Self) -> Self {
        let square = b.0 * b.0 + b.1 * b.1;
        let product = self * Self(b.0, -b.1);
        Self(product.0 / square, product.1 / square)
    }
}

/// `z^n` at a frequency.
pub(super) fn z(hz: f64, n: f64) -> Complex {
    let (sin, cos) = libm::sincos(TAU * hz * PERIOD_S * n);
    Complex(cos, sin)
}

/// Loop of the teaching plant: `m = 1`, `c = 2`, `k = 100` behind a hold, under a `pid` with 300, 2000 and 30 whose
/// integral is by trapezoids and whose derivative is a backward difference.
pub(super) fn teaching(hz: f64) -> Complex {
    let (sigma, damped) = (1.0, libm::sqrt(99.0));
    let (sin, cos) = libm::sincos(damped * PERIOD_S);
    let alpha = libm::exp(-sigma * PERIOD_S);
    let z1 = z(hz, 1.0);
    let b1 = 0.01 * (1.0 - alpha * (cos + sigma / damped * sin));
    let b2 = 0.01 * (alpha * alpha + alpha * (sigma / damped * sin - cos));
    let above = z1 * b1.into() + b2.into();
    let plant = above / (z(hz, 2.0) - z1 * (2.0 * alpha * cos).into() + (alpha * alpha).into());
    let integral = (z1 + 1.0.into()) / (z1 - 1.0.into()) * (0.5 * PERIOD_S).into();
    let derivative = (z1 - 1.0.into()) / (z1 * PERIOD_S.into());
    let law = Complex::from(300.0) + integral * 2000.0.into() + derivative * 30.0.into();
    plant * law
}

/// Channel of `crossed.c` behind a hold: `(1 - T s) / (1 + tau s)^2` with T = 0.05 s and tau = 0.1 s.
pub(super) fn channel(hz: f64) -> Complex {
    let (zero, h) = (0.5, PERIOD_S / 0.1);
    let e = libm::exp(-h);
    let z1 = z(hz, 1.0);
    let a = Complex::from(1.0 - e) / (z1 - e.into());
    let b = (a * (h * e).into() + (1.0 - e - h * e).into()) / (z1 - e.into());
    b * (1.0 + zero).into() - a * zero.into()
}

/// Loop of the pendulum on its head behind a hold, whose law cancels gravity: `m = 1`, `l = 0.5`, `c = 0.05`, gains 9 and
/// 2.95. The plant's map is the series of `exp(A h)`.
pub(super) fn pendulum(hz: f64) -> Complex {
    let (inertia, weight) = (0.25, 9.80665 * 0.5);
    // Rows of [[A, B], [0, 0]] h.
    let block = [
        [0.0, 1.0, 0.0],
        [weight / inertia, -0.05 / inertia, 1.0 / inertia],
        [0.0; 3],
    ]
    .map(|row| row.map(|value| value * PERIOD_S));
    let mut power = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut map = power;
    for n in 1..20 {
        power = std::array::from_fn(|i| {
            std::array::from_fn(|k| {
                let products = (0..3).map(|j| power[i][j] * block[j][k]);
                products.sum::<f64>() / f64::from(n)
            })
        });
        for (to, row) in map.iter_mut().zip(power) {
            for (to, value) in to.iter_mut().zip(row) {
                *to += value;
            }
        }
    }
    let [[a, b, f], [c, d, g], _] = map.map(|row| row.map(Complex::from));
    let z1 = z(hz, 1.0);
    let determinant = (z1 - a) * (z1 - d) - b * c;
    let angle = ((z1 - d) * f + b * g) / determinant;
    let rate = ((z1 - a) * g + c * f) / determinant;
    angle * (weight + 9.0).into() + rate * 2.95.into()
}

/// Margins of a loop.
#[derive(Debug)]
pub(super) struct Expected {
    pub(super) crossover_hz: f64,
    pub(super) phase_margin_deg: f64,
    pub(super) gain_margin_db: f64,
    /// Least `|1 + L|`.
    pub(super) disc_margin: f64,
}

/// Computes the margins of a loop that crosses a gain of 1 and a phase of -180 degrees once each between these ends.
pub(super) fn margins(l: impl Fn(f64) -> Complex, gain: [f64; 2], phase: [f64; 2]) -> Expected {
    let crossover_hz = bisected(gain, |hz| l(hz).size() > 1.0);
    let phase_hz = bisected(phase, |hz| l(hz).phase_deg() > -180.0);
    let distance = |hz: f64| (l(hz) + 1.0.into()).size();
    let all = (0..200_000).map(|n| 0.5 * libm::pow(900.0, f64::from(n) / 2e5));
    Expected {
        crossover_hz,
        phase_margin_deg: l(crossover_hz).phase_deg() + 180.0,
        gain_margin_db: -20.0 * libm::log10(l(phase_hz).size()),
        disc_margin: (all.map(distance).min_by(f64::total_cmp)).expect("frequencies"),
    }
}

fn bisected([mut low, mut high]: [f64; 2], is_before: impl Fn(f64) -> bool) -> f64 {
    assert!(is_before(low) && !is_before(high), "no crossing in range");
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if is_before(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}
