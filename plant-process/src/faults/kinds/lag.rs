//! Lags of first and second order, exact for an input that is linear between two steps.
//!
//! For a command, which is a staircase, the same value has a second meaning: the output at a step is the mean over that
//! step of the lag's continuous response to the staircase.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use shared_types::describe::{ActsOn, Invalid};
use shared_types::state::StateOf;

mod response;

pub(crate) use response::Response;

use super::towards;
use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

/// `1 - (1 - exp(-z)) / z` for z > 0, by its series where the difference would cancel.
fn ramp_share(z: f64) -> f64 {
    if z < 1e-2 {
        z * (1.0 / 2.0 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z * (1.0 / 120.0 - z * (1.0 / 720.0)))))
    } else {
        1.0 + libm::expm1(-z) / z
    }
}

shared_types::table! {
    /// Parameters of [`Lag`].
    pub struct LagParameters {
        /// Corner frequency f, at which the amplitude is 0.707.
        lag_hz: "Hz" = 1.0 in 1e-9..=1e9,
    }
}

/// A lag of first order.
pub struct Lag {
    /// Share of the distance that is covered in a step, `1 - exp(-2 pi f T)`.
    held: f64,
    /// Share of a change within the step that is covered in the same step.
    ramp: f64,
    /// Input and output of the previous step.
    last: Option<(f64, f64)>,
}

impl Lag {
    /// Creates a lag whose corner turns by an angle in a step.
    fn of(angle: f64) -> Self {
        Self {
            held: -libm::expm1(-angle),
            ramp: ramp_share(angle),
            last: None,
        }
    }
}

impl FaultKind for Lag {
    const NAME: &'static str = "lag";
    const SUMMARY: &'static str = "The value passes a low-pass filter of first order.";
    const EQUATION: &'static str =
        "dv/dt = 2 pi f (x - v), x linear between steps, v = x at first; y = x + (v - x) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = LagParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.last,
            |fault, last| fault.last = last,
        ))
    }

    fn start(setup: &Setup<'_, LagParameters>) -> Result<Self, Invalid> {
        Ok(Self::of(TAU * setup.parameters.lag_hz / setup.rate.hz()))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let (before, v) = self.last.unwrap_or((x.value, x.value));
        // Written as differences: a constant input stays itself to the last bit.
        let v = v + self.held * (before - v) + self.ramp * (x.value - before);
        self.last = Some((x.value, v));
        Reading {
            value: towards(x.value, v, at.gain),
            ..x
        }
    }
}

shared_types::table! {
    /// Parameters of [`SecondOrderLag`].
    pub struct SecondOrderLagParameters {
        /// Natural frequency f.
        lag_hz: "Hz" = 1.0 in 1e-9..=1e9,
        /// Damping ratio d.
        lag_damping: "1" = 1.0 in 1e-6..=1e6,
    }
}

/// A lag of second order. Rates are over `w = 2 pi f`, so that time is an angle.
pub struct SecondOrderLag {
    /// Changes of value and rate in a step, caused by the distance from the input and by the rate.
    of_distance: [f64; 2],
    of_rate: [f64; 2],
    /// The same changes, caused by a change of the input within the step.
    of_ramp: [f64; 2],
    last: Option<Last>,
}

/// Input and output of the previous step.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Last {
    input: f64,
    value: f64,
    rate: f64,
}

/// Changes of `v` and `v'` over an angle `a`, where `v'' + 2 d v' + v = slope t` with the given initial `v` and `v'`.
fn changes([value, rate]: [f64; 2], slope: f64, (angle, damping): (f64, f64)) -> [f64; 2] {
    if angle < 0.5 && 2.0 * damping * angle < 0.5 {
        return series([value, rate], slope, (angle, damping));
    }
    // Behind a ramp the value runs late by `2 d slope`; what is left of the start decays.
    let late = 2.0 * damping * slope;
    let (distance, faster) = (value + late, rate - slope);
    let (c, s) = decay(angle, damping);
    let end = [
        slope * angle - late + (c + damping * s) * distance + s * faster,
        slope - s * distance + (c - damping * s) * faster,
    ];
    [end[0] - value, end[1] - rate]
}

/// The same changes by the Taylor series, whose terms decrease at least as fast as powers of 1/2; for small angles no
/// difference of large numbers remains.
fn series([value, rate]: [f64; 2], slope: f64, (angle, damping): (f64, f64)) -> [f64; 2] {
    let (mut before, mut last, mut power) = (value, rate, angle);
    let mut change = [rate * angle, 0.0];
    for n in 0..40 {
        let (m, forcing) = (f64::from(n) + 1.0, if n == 1 { slope } else { 0.0 });
        let next = (forcing - 2.0 * damping * m * last - before) / (m * (m + 1.0));
        change[1] += (m + 1.0) * next * power;
        power *= angle;
        change[0] += next * power;
        (before, last) = (last, next);
    }
    change
}

/// `exp(-d a) (cos(b a), sin(b a) / b)` with `b = sqrt(1 - d^2)`, in their hyperbolic forms above d = 1.
fn decay(angle: f64, damping: f64) -> (f64, f64) {
    let square = (1.0 - damping) * (1.0 + damping);
    let b = square.abs().sqrt();
    let turned = b * angle;
    if turned < 1e-4 {
        // Both forms have one series in b^2 a^2; its third term is below 1e-17.
        let x = square * angle * angle;
        let left = libm::exp(-damping * angle);
        let (c, s) = (1.0 - x / 2.0 + x * x / 24.0, 1.0 - x / 6.0 + x * x / 120.0);
        return (left * c, left * s * angle);
    }
    if square > 0.0 {
        let left = libm::exp(-damping * angle);
        return (left * libm::cos(turned), left * libm::sin(turned) / b);
    }
    // d - b without cancelling: its product with d + b is 1.
    let slow = libm::exp(-angle / (damping + b));
    let fast = libm::exp(-angle * (damping + b));
    ((slow + fast) / 2.0, (slow - fast) / (2.0 * b))
}

impl SecondOrderLag {
    /// Creates a lag whose natural frequency turns by an angle in a step.
    fn of(angle: f64, damping: f64) -> Self {
        let step = (angle, damping);
        Self {
            of_distance: changes([1.0, 0.0], 0.0, step),
            of_rate: changes([0.0, 1.0], 0.0, step),
            of_ramp: changes([0.0, 0.0], 1.0 / angle, step),
            last: None,
        }
    }
}

impl FaultKind for SecondOrderLag {
    const NAME: &'static str = "second-order-lag";
    const SUMMARY: &'static str =
        "The value passes a low-pass filter of second order, as a damped resonance.";
    const EQUATION: &'static str = "d2v/dt2 = w^2 (x - v) - 2 d w dv/dt, w = 2 pi f, x linear between steps, v = x and dv/dt = 0 at first; y = x + (v - x) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = SecondOrderLagParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.last,
            |fault, last| fault.last = last,
        ))
    }

    fn start(setup: &Setup<'_, SecondOrderLagParameters>) -> Result<Self, Invalid> {
        let angle = TAU * setup.parameters.lag_hz / setup.rate.hz();
        Ok(Self::of(angle, setup.parameters.lag_damping))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let last = self.last.unwrap_or(Last {
            input: x.value,
            value: x.value,
            rate: 0.0,
        });
        let (distance, ramp) = (last.value - last.input, x.value - last.input);
        let change = |of: usize| {
            self.of_distance[of] * distance + self.of_rate[of] * last.rate + self.of_ramp[of] * ramp
        };
        let next = Last {
            input: x.value,
            value: last.value + change(0),
            rate: last.rate + change(1),
        };
        self.last = Some(next);
        Reading {
            value: towards(x.value, next.value, at.gain),
            ..x
        }
    }
}
