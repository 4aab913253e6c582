//! PID: the core that the laws named `pid` share, and those laws, one file per plant.
//!
//! [`Pid`] turns an error into a command, once per sample. It has no units and knows no plant: the
//! laws in [`drhas`] and [`spring_mass`] name the signals, the units and the gains.

pub mod drhas;
pub mod spring_mass;

use serde::{Deserialize, Serialize};

use super::limit::limited;

/// Gains, in units of the command per unit of the error (and per second or times second).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// k_p.
    pub proportional: f64,
    /// k_i.
    pub integral: f64,
    /// k_d.
    pub derivative: f64,
    /// Largest magnitude of the command; infinite means no limit.
    pub limit: f64,
}

/// One PID loop.
///
/// `u = k_p e + k_i integral(e) + k_d de/dt`, held within the limit. The integral is the sum of
/// trapezoids and starts at 0, the derivative is the backward difference and is 0 at the first
/// sample. While the command is at its limit the integral does not move further into it
/// (conditional integration), so that it leaves the limit as soon as the error turns.
#[derive(Clone, Copy, Debug)]
pub struct Pid {
    gains: Gains,
    period_s: f64,
    state: PidState,
}

/// State that a loop keeps from sample to sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PidState {
    integral: f64,
    last_error: Option<f64>,
    /// Samples without a valid error since the last valid one.
    missed: u32,
    command: f64,
}

impl Pid {
    /// A loop before its first sample; its command is 0 until then.
    #[must_use]
    pub fn new(gains: Gains, period_s: f64) -> Self {
        Self {
            gains,
            period_s,
            state: PidState::default(),
        }
    }

    /// Returns the state that the loop keeps.
    #[must_use]
    pub const fn state(&self) -> PidState {
        self.state
    }

    /// Goes on with what it remembered.
    pub const fn restore(&mut self, state: PidState) {
        self.state = state;
    }

    /// The command that answers an error.
    pub fn update(&mut self, error: f64) -> f64 {
        let state = &mut self.state;
        let elapsed_s = f64::from(state.missed.saturating_add(1)) * self.period_s;
        let (area, rate) = match state.last_error {
            Some(last) => (0.5 * (last + error) * elapsed_s, (error - last) / elapsed_s),
            None => (0.0, 0.0),
        };
        state.last_error = Some(error);
        state.missed = 0;

        let Gains {
            proportional: k_p,
            integral: k_i,
            derivative: k_d,
            limit,
        } = self.gains;
        let rest = k_p * error + k_d * rate;
        let wanted = rest + k_i * (state.integral + area);
        let pushes_further = wanted * k_i * area > 0.0;
        if !(wanted.abs() > limit && pushes_further) {
            state.integral += area;
        }
        let command = rest + k_i * state.integral;
        state.command = limited(command, limit);
        state.command
    }

    /// The command when the sample is not valid: the last one. Integral and derivative bridge the
    /// gap at the next valid sample.
    pub fn hold(&mut self) -> f64 {
        self.state.missed = self.state.missed.saturating_add(1);
        self.state.command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use libm::exp;

    const P_ONLY: Gains = Gains {
        proportional: 0.0,
        integral: 0.0,
        derivative: 0.0,
        limit: f64::INFINITY,
    };

    /// Largest deviation from `error_at` over 5 s of the loop around `n` integrators in a row,
    /// which are exact under a held command; the error starts at 1.
    fn deviation(gains: Gains, period_s: f64, n: usize, error_at: fn(f64) -> f64) -> f64 {
        let mut pid = Pid::new(gains, period_s);
        let (mut position, mut velocity) = (0.0, 0.0);
        let mut largest = 0.0;
        for k in 0..(5.0 / period_s) as u32 {
            let error = 1.0 - position;
            let off = (error - error_at(f64::from(k) * period_s)).abs();
            if off > largest {
                largest = off;
            }
            let u = pid.update(error);
            if n == 1 {
                position += u * period_s;
            } else {
                position += velocity * period_s + 0.5 * u * period_s * period_s;
                velocity += u * period_s;
            }
        }
        largest
    }

    #[test]
    fn a_pi_loop_around_an_integrator_converges_to_the_closed_form() {
        // e'' + k_p e' + k_i e = 0, e(0) = 1, e'(0) = -k_p; k_p = 3, k_i = 2 has the roots -1, -2.
        let gains = Gains {
            proportional: 3.0,
            integral: 2.0,
            ..P_ONLY
        };
        let closed = |t: f64| 2.0 * exp(-2.0 * t) - exp(-t);
        let (coarse, fine) = (
            deviation(gains, 1e-3, 1, closed),
            deviation(gains, 5e-4, 1, closed),
        );
        assert!(fine < 1e-3, "{fine}");
        assert!((coarse / fine - 2.0).abs() < 0.05, "{}", coarse / fine);
    }

    #[test]
    fn a_pd_loop_around_two_integrators_converges_to_the_closed_form() {
        // e'' + k_d e' + k_p e = 0, e(0) = 1, e'(0) = 0; k_d = 3, k_p = 2 has the roots -1, -2.
        let gains = Gains {
            proportional: 2.0,
            derivative: 3.0,
            ..P_ONLY
        };
        let closed = |t: f64| 2.0 * exp(-t) - exp(-2.0 * t);
        let (coarse, fine) = (
            deviation(gains, 1e-3, 2, closed),
            deviation(gains, 5e-4, 2, closed),
        );
        assert!(fine < 2e-3, "{fine}");
        assert!((coarse / fine - 2.0).abs() < 0.05, "{}", coarse / fine);
    }

    #[test]
    fn a_ramp_of_the_error_is_integrated_without_error() {
        let gains = Gains {
            integral: 8.0,
            ..P_ONLY
        };
        let mut pid = Pid::new(gains, 0.25);
        let commands: Vec<f64> = (0..4).map(|k| pid.update(f64::from(k) * 0.25)).collect();
        assert_eq!(commands, [0.0, 0.25, 1.0, 2.25]); // 8 t^2 / 2
    }

    #[test]
    fn the_command_leaves_its_limit_as_soon_as_the_error_turns() {
        let gains = Gains {
            proportional: 1.0,
            integral: 10.0,
            limit: 2.0,
            ..P_ONLY
        };
        let mut pid = Pid::new(gains, 0.01);
        for _ in 0..1000 {
            assert!(pid.update(1.0) <= 2.0);
        }
        assert!(pid.update(1.0) > 1.85);
        // Ten seconds of windup would hold the limit for ten seconds more.
        assert!(pid.update(-1.0) < 0.0);
    }

    #[test]
    fn the_limit_holds_on_both_sides() {
        let gains = Gains {
            proportional: 5.0,
            limit: 1.0,
            ..P_ONLY
        };
        let mut pid = Pid::new(gains, 0.01);
        assert_eq!((pid.update(3.0), pid.update(-3.0)), (1.0, -1.0));
    }

    #[test]
    fn samples_that_are_not_valid_hold_the_command_and_are_bridged() {
        let gains = Gains {
            integral: 4.0,
            derivative: 1.0,
            ..P_ONLY
        };
        let mut pid = Pid::new(gains, 0.5);
        assert_eq!(pid.hold(), 0.0);
        pid.update(1.0);
        let before = pid.update(1.0); // 4 * 0.5
        assert_eq!(before, 2.0);
        assert_eq!(pid.hold(), before);
        // A second later: 4 * (0.5 + 1.5) + (2 - 1) / 1.
        assert_eq!(pid.update(2.0), 9.0);
    }
}
