//! PID: the core shared by the laws named `pid`, and those laws, one file per plant.
//!
//! [`Pid`] converts an error into a command, once per sample. It has no units and is independent of the plant: the laws
//! in [`drhas`] and [`spring_mass`] define the signals, the units and the gains.

pub mod drhas;
pub mod spring_mass;

use serde::{Deserialize, Serialize};

use super::limit::limited;
use super::transfer::Transfer;
use crate::controller::Transition;

/// Sentence on the effect of changing a gain of the laws named `pid` during a run.
pub const TUNING: &str = "The command goes on from what the old gains would have given: the integral takes up the difference; without an integral gain the difference fades within 0.1 s after a jump.";

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

/// PID loop.
///
/// `u = k_p e + k_i integral(e) + k_d de/dt`, clamped to the limit. The integral is the sum of trapezoids and starts at
/// 0, the derivative is the backward difference and is 0 at the first sample. While the command is at its limit the
/// integral does not move further beyond it (conditional integration), so that the command leaves the limit as soon as
/// the error changes sign.
#[derive(Clone, Copy, Debug)]
pub struct Pid {
    gains: Gains,
    /// Gains before a change that takes effect at the next sample, and its transition.
    former: Option<(Gains, Transition)>,
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
    /// `true` if the gains changed while there was no valid error.
    changed: bool,
    transfer: Transfer,
}

impl Pid {
    /// Creates a loop before its first sample; its command is 0 until then.
    #[must_use]
    pub fn new(gains: Gains, period_s: f64) -> Self {
        Self {
            gains,
            former: None,
            period_s,
            state: PidState::default(),
        }
    }

    /// Applies other gains, from the next update on.
    ///
    /// The next command equals that of the old gains, within the new limit: the integral becomes `(u_old - k_p e - k_d
    /// de/dt) / k_i`. Without an integral gain the difference fades, if the gains jump.
    pub fn retune(&mut self, gains: Gains, transition: Transition) {
        // Before the first sample there is no command to continue from.
        if self.state.last_error.is_some() {
            let before = self.former.map_or(self.gains, |(before, _)| before);
            self.former = Some((before, transition));
        }
        self.gains = gains;
    }

    /// Returns the state of the loop.
    #[must_use]
    pub const fn state(&self) -> PidState {
        self.state
    }

    /// Restores a saved state.
    pub const fn restore(&mut self, state: PidState) {
        self.state = state;
        self.former = None;
    }

    /// Returns the integral and the last error, 0 before the first sample.
    #[must_use]
    pub fn numbers(&self) -> [f64; 2] {
        [self.state.integral, self.state.last_error.unwrap_or(0.0)]
    }

    /// Sets the integral and the last error.
    pub const fn set_numbers(&mut self, [integral, last_error]: [f64; 2]) {
        self.state.integral = integral;
        self.state.last_error = Some(last_error);
    }

    /// Returns the command that answers an error.
    pub fn update(&mut self, error: f64) -> f64 {
        if self.former.is_some() || self.state.changed {
            return self.change_over(error);
        }
        let command = self.answer(error) + self.state.transfer.next();
        self.state.command = limited(command, self.gains.limit);
        self.state.command
    }

    /// Answers an error such that the command continues from the previous gains or from the held command.
    fn change_over(&mut self, error: f64) -> f64 {
        let gains = self.gains;
        let (former, transition) = self.former.take().unwrap_or((gains, Transition::Step));
        let held_command = std::mem::take(&mut self.state.changed).then_some(self.state.command);
        let last_error = self.state.last_error;
        let elapsed_s = f64::from(self.state.missed.saturating_add(1)) * self.period_s;
        self.gains = former;
        let target = self.answer(error);
        let remainder = self.state.transfer.next();
        let old = held_command.unwrap_or_else(|| limited(target + remainder, former.limit));
        let old = limited(old, gains.limit);
        self.gains = gains;

        let rate = last_error.map_or(0.0, |last| (error - last) / elapsed_s);
        let rest = gains.proportional * error + gains.derivative * rate;
        let integral = (old - rest) / gains.integral;
        let new = rest + gains.integral * self.state.integral;
        let command = if integral.is_finite() {
            (self.state.integral, self.state.transfer) = (integral, Transfer::default());
            old
        } else if transition == Transition::Ramp && former.integral == 0.0 {
            new + remainder
        } else {
            self.state.transfer.begin(old, new, self.period_s)
        };
        self.state.command = limited(command, gains.limit);
        self.state.command
    }

    /// Returns the command without the remainder of a change; the integral is limited accordingly.
    fn answer(&mut self, error: f64) -> f64 {
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
        let target = rest + k_i * (state.integral + area);
        let pushes_further = target * k_i * area > 0.0;
        if !(target.abs() > limit && pushes_further) {
            state.integral += area;
        }
        rest + k_i * state.integral
    }

    /// Returns the command for an invalid sample: the last one. Integral and derivative bridge the gap at the next
    /// valid sample.
    pub fn hold(&mut self) -> f64 {
        self.state.changed |= self.former.take().is_some();
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

    /// Largest deviation from `error_at` over 5 s of the loop around `n` cascaded integrators, which are exact under a
    /// held command; the error starts at 1.
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
    fn the_command_leaves_its_limit_as_soon_as_the_error_changes_sign() {
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

    /// Returns a loop's commands for errors, with other gains from the sample `at` on.
    fn retuned(before: Gains, after: Gains, at: usize, errors: &[f64]) -> Vec<f64> {
        let mut pid = Pid::new(before, 0.025);
        let answers = errors.iter().enumerate().map(|(k, error)| {
            if k == at {
                pid.retune(after, Transition::Step);
            }
            pid.update(*error)
        });
        answers.collect()
    }

    const WITH_INTEGRAL: Gains = Gains {
        proportional: 2.0,
        integral: 8.0,
        derivative: 0.5,
        ..P_ONLY
    };

    #[test]
    fn a_change_of_gains_leaves_the_command_at_that_of_the_old_gains() {
        let errors = [1.0, 0.75, 0.25, -0.5, 0.5, 1.5];
        let other = Gains {
            proportional: -7.0,
            integral: 0.5,
            derivative: 3.0,
            ..P_ONLY
        };
        let unchanged = retuned(WITH_INTEGRAL, WITH_INTEGRAL, 0, &errors);
        let changed = retuned(WITH_INTEGRAL, other, 3, &errors);
        assert_eq!(
            changed[..4],
            unchanged[..4],
            "to the last bit, the change included"
        );
        // From there on u' = u + k_p de + k_i area + k_d d(de/dt) with the new gains alone: de = 1, area = 0 and 0.025,
        // rates 40 after -30 and 40 after 40.
        let expected = changed[3] - 7.0 * 1.0 + 0.0 + 3.0 * (40.0 + 30.0);
        assert!(
            (changed[4] - expected).abs() < 1e-12,
            "{} {expected}",
            changed[4]
        );
        let expected = expected - 7.0 * 1.0 + 0.5 * 0.025 + 0.0;
        assert!(
            (changed[5] - expected).abs() < 1e-12,
            "{} {expected}",
            changed[5]
        );
    }

    #[test]
    fn gains_on_a_ramp_never_jump_and_reach_their_target() {
        let mut pid = Pid::new(WITH_INTEGRAL, 0.025);
        let before = [pid.update(1.0), pid.update(1.0)];
        for k in 1..=10 {
            let gains = Gains {
                proportional: 2.0 + f64::from(k),
                ..WITH_INTEGRAL
            };
            pid.retune(gains, Transition::Ramp);
            // The error is constant: only the integral moves, by k_i e T.
            let expected = before[1] + 8.0 * 0.025 * f64::from(k);
            assert!((pid.update(1.0) - expected).abs() < 1e-12, "{k}");
        }
        assert!((pid.update(2.0) - (before[1] + 2.0 + 12.0 + 0.5 / 0.025 + 0.3)).abs() < 1e-12);
    }

    #[test]
    fn without_an_integral_the_difference_fades_in_a_straight_line() {
        let gains = |proportional| Gains {
            proportional,
            ..P_ONLY
        };
        // 90 to 30 at e = 0.5: u = 15 + 30 (1 - j / 4) at the samples after the change, 25 ms apart.
        let commands = retuned(gains(90.0), gains(30.0), 2, &[0.5; 8]);
        assert_eq!(commands, [45.0, 45.0, 45.0, 37.5, 30.0, 22.5, 15.0, 15.0]);
        // A removed integral gain leaves its part, which fades likewise.
        let commands = retuned(WITH_INTEGRAL, gains(2.0), 2, &[1.0; 7]);
        let part = 8.0 * 0.05;
        let expected = [1.0, 0.75, 0.5, 0.25, 0.0].map(|share| 2.0 + part * share);
        for (actual, expected) in commands[2..].iter().zip(expected) {
            assert!((actual - expected).abs() < 1e-12, "{commands:?}");
        }
    }

    #[test]
    fn proportional_gains_on_a_ramp_act_at_once() {
        let mut pid = Pid::new(P_ONLY, 0.025);
        pid.update(0.5);
        for k in 0..4 {
            let gains = Gains {
                proportional: f64::from(k),
                ..P_ONLY
            };
            pid.retune(gains, Transition::Ramp);
            assert_eq!(pid.update(0.5), 0.5 * f64::from(k));
        }
    }

    #[test]
    fn a_lower_limit_applies_at_once_without_windup() {
        let gains = |limit| Gains {
            derivative: 0.0,
            limit,
            ..WITH_INTEGRAL
        };
        let commands = retuned(gains(f64::INFINITY), gains(1.5), 1, &[1.0, 1.0, 1.0, 0.5]);
        assert_eq!(commands[1..3], [1.5, 1.5]);
        // Off the limit as soon as the error falls: 1.5 + 2 (-0.5) + 8 (0.01875).
        assert!((commands[3] - 0.65).abs() < 1e-12, "{commands:?}");
    }

    #[test]
    fn a_change_during_invalid_samples_continues_from_the_held_command() {
        let mut pid = Pid::new(WITH_INTEGRAL, 0.025);
        pid.update(1.0);
        let held_command = pid.update(1.0);
        pid.retune(P_ONLY, Transition::Step);
        assert_eq!(pid.hold(), held_command);
        let mut resumed = Pid::new(P_ONLY, 0.025);
        resumed.restore(pid.state());
        assert_eq!(
            (pid.update(3.0), resumed.update(3.0)),
            (held_command, held_command)
        );
        assert_eq!(pid.update(3.0), 0.75 * held_command);
    }

    #[test]
    fn a_change_before_the_first_sample_needs_no_transition() {
        let mut pid = Pid::new(WITH_INTEGRAL, 0.025);
        let gains = Gains {
            proportional: 5.0,
            ..P_ONLY
        };
        pid.retune(gains, Transition::Step);
        assert_eq!((pid.update(1.0), pid.update(1.0)), (5.0, 5.0));
    }

    #[test]
    fn invalid_samples_hold_the_command_and_are_bridged() {
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
