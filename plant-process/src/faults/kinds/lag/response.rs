//! Transfer functions of lags between steps, from the coefficients with which they run.
//!
//! Used for the [figures](crate::instruments::Figures) of instruments. Runs no lag, so a figure takes no longer for a
//! lag that is slow or barely damped.

use std::f64::consts::TAU;

use shared_types::time::Rate;

use super::{Lag, SecondOrderLag};

/// Transfer function of a lag, with the delay w of one step and q = 1 - w:
///
/// `H = (n0 q^2 + n1 q w + n2 w^2) / (q^2 + d1 q w + n2 w^2)`
///
/// In powers of q and w instead of w alone no coefficient of a slow lag is a difference of large numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Response {
    numerator: [f64; 3],
    /// Coefficient d1.
    middle: f64,
    /// Delay of slow signals in s, equal to that of the continuous lag: a ramp passes without an error of sampling.
    pub delay_s: f64,
    /// Sum of the squares of the impulse response, by which white noise is reduced.
    pub power: f64,
}

impl Response {
    /// Computes the transfer function of a lag of first order.
    pub(crate) fn first_order(lag_hz: f64, rate: Rate) -> Self {
        let Lag { held, ramp, .. } = Lag::of(TAU * lag_hz / rate.hz());
        // v_k = (1 - h) v_(k-1) + r x_k + (h - r) x_(k-1), both sides times q + w = 1.
        let later = held - ramp;
        let squares = ramp * ramp + later * later + 2.0 * ramp * later * (1.0 - held);
        Self {
            numerator: [ramp, ramp + held, held],
            middle: 1.0 + held,
            delay_s: 1.0 / (TAU * lag_hz),
            power: squares / (held * (2.0 - held)),
        }
    }

    /// Computes the transfer function of a lag of second order.
    pub(crate) fn second_order(lag_hz: f64, damping: f64, rate: Rate) -> Self {
        let angle = TAU * lag_hz / rate.hz();
        let lag = SecondOrderLag::of(angle, damping);
        let ([a, c], [b, d], [r, s]) = (lag.of_distance, lag.of_rate, lag.of_ramp);
        // Distance and rate are multiplied by 1 + [[a, b], [c, d]], whose determinant is exp(-2 damping angle).
        let (trace, product) = (a + d, a * d - b * c);
        let middle = b * s - d * r - a;
        // Sum of squares of a transfer function of second order: Astrom, Introduction to Stochastic Control Theory,
        // 1970, chapter 5, with the denominator as a product.
        let [b0, b1, b2] = [r, middle - 2.0 * r, r - middle + product];
        let (a1, a2) = (-2.0 - trace, libm::exp(-2.0 * damping * angle));
        let squares = (b0 * b0 + b1 * b1 + b2 * b2) * (1.0 + a2) - 2.0 * (b0 * b1 + b1 * b2) * a1
            + 2.0 * b0 * b2 * (a1 * a1 - a2 * (1.0 + a2));
        let lost = -libm::expm1(-2.0 * damping * angle);
        Self {
            numerator: [r, middle, product],
            middle: -trace,
            delay_s: 2.0 * damping / (TAU * lag_hz),
            power: squares / (lost * (1.0 + a2 - a1) * product),
        }
    }

    /// Computes the phase loss at a frequency, in rad.
    pub(crate) fn phase_loss_rad(&self, frequency_hz: f64, rate: Rate) -> f64 {
        // With half the angle of a step, q / w = 2 i sin(half) exp(i half).
        let half = std::f64::consts::PI * frequency_hz / rate.hz();
        let (sine, cosine) = (libm::sin(half), libm::cos(half));
        let ratio = [-2.0 * sine * sine, 2.0 * sine * cosine];
        let square = [
            ratio[0] * ratio[0] - ratio[1] * ratio[1],
            2.0 * ratio[0] * ratio[1],
        ];
        let phase = |[two, one, none]: [f64; 3]| {
            let real = two * square[0] + one * ratio[0] + none;
            let imaginary = two * square[1] + one * ratio[1];
            libm::atan2(imaginary, real)
        };
        let [_, _, last] = self.numerator;
        let loss = phase([1.0, self.middle, last]) - phase(self.numerator);
        let loss = libm::remainder(loss, TAU);
        // Far above a resonance the loss is half a turn, whose sign is a matter of rounding.
        if loss < -3.0 { loss + TAU } else { loss }
    }
}

#[cfg(test)]
mod tests {
    use shared_types::describe::{Invalid, Settings};

    use super::*;
    use crate::faults::kind::{AnySetup, Moment, Reading};
    use crate::faults::kinds;

    fn rate() -> Rate {
        Rate::new(1000.0).expect("legal")
    }

    /// Runs a stage and returns its impulse response.
    fn impulse(kind: &str, parameters: &[(&str, f64)], steps: u64) -> Result<Vec<f64>, Invalid> {
        let mut settings = Settings::default();
        for (key, value) in parameters {
            settings.set(key, *value);
        }
        let entries = kinds::all();
        let entry = entries.iter().find(|entry| entry.description.kind == kind);
        let mut stage = (entry.expect("a kind").start)(&AnySetup {
            parameters: &settings,
            list: &[],
            rate: rate(),
            signals: 0,
            is_instrument: true,
        })?;
        let mut answer = |step: u64| {
            let at = Moment {
                step,
                since_steps: step,
                since_s: rate().seconds(shared_types::time::Step(step)),
                gain: 1.0,
            };
            let value = f64::from(u8::from(step == 1));
            stage.number(&at, Reading { value, valid: true }).value
        };
        answer(0);
        Ok((1..steps).map(answer).collect())
    }

    fn assert_near(value: f64, expected: f64, tolerance: f64) {
        let error = (value - expected).abs();
        assert!(error <= tolerance * expected.abs(), "{value} {expected}");
    }

    /// Compares the transfer function with the stage that runs.
    fn compare(response: Response, kind: &str, parameters: &[(&str, f64)]) {
        let values = impulse(kind, parameters, 20_000).expect("a lag");
        let steps = || values.iter().zip(0_u32..);
        let power: f64 = values.iter().map(|value| value * value).sum();
        assert_near(response.power, power, 1e-9);
        let delay: f64 = steps().map(|(value, step)| f64::from(step) * value).sum();
        assert_near(response.delay_s, delay / rate().hz(), 1e-8);
        for frequency_hz in [0.1, 3.0, 50.0, 300.0, 490.0] {
            let angle = TAU * frequency_hz / rate().hz();
            let sum = |part: fn(f64) -> f64| -> f64 {
                let terms = steps().map(|(value, step)| value * part(angle * f64::from(step)));
                terms.sum()
            };
            let expected = libm::atan2(sum(libm::sin), sum(libm::cos));
            let loss = response.phase_loss_rad(frequency_hz, rate());
            let error = libm::remainder(loss - expected, TAU);
            assert!(error.abs() < 1e-7, "{frequency_hz} Hz: {loss} {expected}");
        }
    }

    #[test]
    fn the_transfer_function_is_that_of_the_lag_which_runs() {
        for lag_hz in [5.0, 20.0, 400.0, 3000.0] {
            let response = Response::first_order(lag_hz, rate());
            compare(response, "lag", &[("lag_hz", lag_hz)]);
            for damping in [0.05, 0.7, 1.0, 4.0] {
                let response = Response::second_order(lag_hz, damping, rate());
                let parameters = [("lag_hz", lag_hz), ("lag_damping", damping)];
                compare(response, "second-order-lag", &parameters);
            }
        }
    }

    #[test]
    fn lags_that_fade_over_days_have_the_figures_of_the_continuous_lag() {
        // Continuous lags: power pi f T and pi f T / (2 damping), phase atan(f / lag_hz) and that of the resonance.
        for lag_hz in [1e-9, 1e-5, 1e-3] {
            let response = Response::first_order(lag_hz, rate());
            let power = std::f64::consts::PI * lag_hz / rate().hz();
            assert_near(response.power, power, 1e-5);
            let loss = response.phase_loss_rad(2.0 * lag_hz, rate());
            assert_near(loss, libm::atan(2.0), 1e-5);
            for damping in [1e-6, 1e-3, 1.0, 100.0] {
                let response = Response::second_order(lag_hz, damping, rate());
                assert_near(response.power, power / (2.0 * damping), 1e-5);
                for ratio in [0.5_f64, 2.0, 1000.0] {
                    let expected = libm::atan2(2.0 * damping * ratio, 1.0 - ratio * ratio);
                    let loss = response.phase_loss_rad(ratio * lag_hz, rate());
                    assert!(
                        (loss - expected).abs() < 1e-5,
                        "{lag_hz} {damping}: {loss} {expected}"
                    );
                }
            }
        }
    }
}
