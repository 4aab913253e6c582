//! Performance indicator V_3, its bound V_r and the detection of a fault (eqs. 59, 60).
//!
//! Called by the law at every valid sample. Time is counted in samples from the first one.

use libm::{ceil, exp};
use serde::{Deserialize, Serialize};

use super::gains::Gains;
use super::steps::Errors;

/// Evaluates V_3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Indicator {
    lambda_per_s: f64,
    mu_per_s: f64,
    period_s: f64,
    hold_samples: u64,
    state: IndicatorState,
}

/// State that the indicator keeps from sample to sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IndicatorState {
    initial_v3: Option<f64>,
    /// Samples since the first one.
    sample: u64,
    /// Sample since which V_3 has been above its bound without interruption.
    above_since: Option<u64>,
}

/// V_3 at a sample, compared with its bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// V_3.
    pub v3: f64,
    /// V_r.
    pub bound: f64,
    /// `true` if V_3 is above V_r now, so that the estimate adapts.
    pub degraded: bool,
    /// `true` if V_3 has been above V_r for the whole hold time.
    pub detected: bool,
}

/// Computes `V_3 = 1/2 (z_1^T z_1 + z_2^T z_2 + z_3^T z_3)` (before eqs. 41, 44, 51).
#[must_use]
pub fn lyapunov_v3(errors: &Errors) -> f64 {
    0.5 * (errors.z_1.norm_squared() + errors.z_2.norm_squared() + errors.z_3.norm_squared())
}

impl Indicator {
    /// Creates the indicator before the first sample.
    ///
    /// `lambda = 2 min(k_11, k_12, k_2s11, k_2s12, k_3s11, k_3s12)` (eq. 61; the minus sign printed after eq. 60 is a
    /// misprint), `mu = epsilon_1 + epsilon_2 + xi_1 + xi_2` (eqs. 49, 57, 60).
    #[must_use]
    pub fn new(gains: &Gains, period_s: f64) -> Self {
        let mut smallest = f64::INFINITY;
        let mut mu_per_s = 0.0;
        for own in gains.components {
            for gain in [
                own.position_gain_per_s,
                own.velocity_gain_per_s,
                own.force_gain_per_s,
            ] {
                if gain < smallest {
                    smallest = gain;
                }
            }
            mu_per_s += own.disturbance_margin_n2_per_s3 + own.leakage_margin_n2_per_s5;
        }
        // The quotient of two decimal numbers may lie just above the intended whole number.
        let hold_samples = ceil(gains.performance.detection_hold_s / period_s - 1e-6);
        Self {
            lambda_per_s: 2.0 * smallest,
            mu_per_s,
            period_s,
            hold_samples: hold_samples as u64,
            state: IndicatorState::default(),
        }
    }

    /// Applies other gains; the counts remain.
    pub fn retune(&mut self, gains: &Gains) {
        let state = self.state;
        *self = Self {
            state,
            ..Self::new(gains, self.period_s)
        };
    }

    /// Returns the state of the indicator.
    #[must_use]
    pub const fn state(&self) -> IndicatorState {
        self.state
    }

    /// Restores a saved state.
    pub const fn restore(&mut self, state: IndicatorState) {
        self.state = state;
    }

    /// Bound at a sample.
    ///
    /// `V_r(t) = exp(-lambda t) V_3(0) + mu / lambda [1 - exp(-lambda t)]` (eq. 60).
    fn bound(&self, initial_v3: f64) -> f64 {
        let decay = exp(-self.lambda_per_s * (self.state.sample as f64 * self.period_s));
        decay * initial_v3 + self.mu_per_s / self.lambda_per_s * (1.0 - decay)
    }

    /// Evaluates the errors of a sample (eq. 59).
    pub fn judge(&mut self, errors: &Errors) -> Verdict {
        let v3 = lyapunov_v3(errors);
        let initial_v3 = *self.state.initial_v3.get_or_insert(v3);
        let bound = self.bound(initial_v3);
        let degraded = v3 > bound;
        self.state.above_since = if degraded {
            self.state.above_since.or(Some(self.state.sample))
        } else {
            None
        };
        let above_since = self.state.above_since;
        let detected =
            above_since.is_some_and(|first| self.state.sample - first >= self.hold_samples);
        self.state.sample += 1;
        Verdict {
            v3,
            bound,
            degraded,
            detected,
        }
    }

    /// Counts a sample that cannot be evaluated.
    pub fn skip(&mut self) {
        if self.state.initial_v3.is_some() {
            self.state.sample += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::gains::tests::table_2;
    use super::super::trajectory::tests::assert_close;
    use super::*;
    use nalgebra::Vector2;

    fn errors(z_31: f64) -> Errors {
        Errors {
            z_3: Vector2::new(z_31, 0.0),
            ..Errors::default()
        }
    }

    #[test]
    fn v3_is_half_the_sum_of_all_squares() {
        let errors = Errors {
            z_1: Vector2::new(1.0, 2.0),
            z_2: Vector2::new(3.0, 4.0),
            z_3: Vector2::new(5.0, 6.0),
        };
        assert_eq!(lyapunov_v3(&errors), 45.5);
    }

    #[test]
    fn the_bound_decays_from_the_first_v3_to_mu_over_lambda() {
        let mut indicator = Indicator::new(&table_2(), 1e-4);
        let first = indicator.judge(&errors(2e10));
        assert_eq!((first.v3, first.bound), (2e20, 2e20));
        assert!(!first.degraded);
        // lambda = 2000 1/s, mu = 2e14 + 2e21; one sample later exp(-0.2) = 0.818730753077982.
        let limit = (2e14 + 2e21) / 2000.0;
        let second = indicator.judge(&errors(0.0));
        let expected = 0.818_730_753_077_982 * 2e20 + (1.0 - 0.818_730_753_077_982) * limit;
        assert_close(second.bound, expected, 1e-14);
        for _ in 0..1000 {
            indicator.judge(&errors(0.0));
        }
        assert_close(indicator.judge(&errors(0.0)).bound, limit, 1e-15);
    }

    #[test]
    fn the_smallest_gain_sets_the_decay() {
        let mut gains = table_2();
        gains.components[1].velocity_gain_per_s = 10.0;
        let indicator = Indicator::new(&gains, 1e-4);
        assert_eq!(indicator.lambda_per_s, 20.0);
    }

    #[test]
    fn a_fault_is_detected_only_if_the_bound_is_exceeded_without_interruption() {
        // mu / lambda = 1e18: z_31 = 2e9 makes V_3 = 2e18.
        let mut indicator = Indicator::new(&table_2(), 1e-4);
        for _ in 0..1000 {
            indicator.judge(&errors(0.0));
        }
        for _ in 0..100 {
            let verdict = indicator.judge(&errors(2e9));
            assert!(verdict.degraded && !verdict.detected);
        }
        assert!(!indicator.judge(&errors(0.0)).degraded);
        // 10 ms lie between the first and the 101st sample above the bound.
        let detected: Vec<bool> = (0..102)
            .map(|_| indicator.judge(&errors(2e9)).detected)
            .collect();
        assert_eq!(detected.iter().position(|&now| now), Some(100));
        assert!(!indicator.judge(&errors(0.0)).detected);
    }

    #[test]
    fn samples_that_cannot_be_evaluated_count_as_time() {
        let (mut straight, mut gappy) = (
            Indicator::new(&table_2(), 1e-4),
            Indicator::new(&table_2(), 1e-4),
        );
        gappy.skip(); // before the first sample: time has not begun
        straight.judge(&errors(2e10));
        gappy.judge(&errors(2e10));
        straight.judge(&errors(0.0));
        gappy.skip();
        assert_eq!(straight.judge(&errors(0.0)), gappy.judge(&errors(0.0)));
    }
}
