//! Core of the laws: processes one sample through the files of this folder, for NRSC and FTSC alike.
//!
//! [`nrsc`](super::nrsc) and [`ftsc`](super::ftsc) each own one and differ only in the estimate of the leakage, which
//! NRSC lacks.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::table::row;

use super::adaptation::{AdaptationGains, LeakageEstimate};
use super::gains::Gains;
use super::hydraulics::{Hydraulics, hydraulic_force_n};
use super::model::{ActuatorModel, Model};
use super::performance::{Indicator, IndicatorState};
use super::signals::{Internals, Measured, PistonState, Reference};
use super::steps::{Errors, Steps};
use super::trajectory::Trajectory;
use super::transformation::Transformation;
use crate::controller::Transition;
use crate::laws::drhas::Command;
use crate::laws::limit::limited;
use crate::laws::transfer::Transfer;

/// Backstepping law with its state.
#[derive(Clone, Copy, Debug)]
pub struct Backstepping {
    actuators: [ActuatorModel; 2],
    plant: Transformation,
    design: Design,
    /// Design and estimate before a change that takes effect at the next sample.
    former: Option<(Design, Vector2<f64>)>,
    period_s: f64,

    velocity: VelocityHistory,
    indicator: Indicator,
    estimate: Option<LeakageEstimate>,
    transfers: Transfers,
    /// `false` before the first sample.
    has_answered: bool,
    answer: (Command, Internals),
}

/// Parts of the law that follow from its gains and are used for the command.
#[derive(Clone, Copy, Debug)]
struct Design {
    trajectory: Trajectory,
    steps: Steps,
    command_limits_a: [f64; 2],
}

/// State of the transfers that keep the commands continuous.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Transfers {
    of_actuators: [Transfer; 2],
    /// `true` if the gains jumped while there was no valid sample.
    changed: bool,
}

/// Sentence on the effect of changing a gain of the backstepping laws during a run.
pub(super) const TUNING: &str = "The commands go on from what the old gains would have given; after a jump the difference fades within 0.1 s.";

/// State that the law keeps from sample to sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LawState {
    last_velocities_mps: Option<[f64; 2]>,
    missed: u32,
    indicator: IndicatorState,
    /// Estimates of the leakage, in m3/s/sqrt(Pa); none for NRSC.
    theta_hat: Option<[f64; 2]>,
    transfers: Transfers,
    has_answered: bool,
    #[serde(with = "row")]
    command: Command,
    #[serde(with = "row")]
    internals: Internals,
}

impl Backstepping {
    /// Creates the law before its first sample; a law without an estimate is NRSC.
    ///
    /// # Errors
    /// If the gains violate a condition of the design.
    pub fn start(
        gains: &Gains,
        model: &Model,
        estimate: Option<LeakageEstimate>,
        period_s: f64,
    ) -> Result<Self, Invalid> {
        gains.check()?;
        Ok(Self {
            actuators: model.actuators(),
            plant: Transformation::new(model),
            design: Design {
                trajectory: Trajectory::new(model, gains.trajectory),
                steps: Steps::new(gains),
                command_limits_a: gains.outputs.map(|own| own.command_limit_a),
            },
            former: None,
            period_s,
            velocity: VelocityHistory::default(),
            indicator: Indicator::new(gains, period_s),
            estimate,
            transfers: Transfers::default(),
            has_answered: false,
            answer: (Command::default(), Internals::default()),
        })
    }

    /// Applies other gains from the next sample on; `adaptation` holds the gains of the estimate, if there is one.
    ///
    /// The estimate is the only integral of the law, and it is kept. A command that would jump with the gains therefore
    /// continues from its current value, and the difference fades.
    pub fn retune(
        &mut self,
        gains: &Gains,
        adaptation: Option<[AdaptationGains; 2]>,
        transition: Transition,
    ) {
        if self.has_answered && transition == Transition::Step {
            let before = (self.design, self.theta_hat());
            self.former = Some(self.former.unwrap_or(before));
        }
        self.design = Design {
            trajectory: self.design.trajectory.with(gains.trajectory),
            steps: Steps::new(gains),
            command_limits_a: gains.outputs.map(|own| own.command_limit_a),
        };
        self.indicator.retune(gains);
        if let (Some(estimate), Some(adaptation)) = (&mut self.estimate, adaptation) {
            estimate.retune(adaptation);
        }
    }

    fn theta_hat(&self) -> Vector2<f64> {
        match &self.estimate {
            Some(estimate) => estimate.theta_hat(),
            None => Vector2::zeros(),
        }
    }

    /// Returns the state of the law.
    #[must_use]
    pub fn state(&self) -> LawState {
        let (command, internals) = self.answer;
        LawState {
            last_velocities_mps: self.velocity.last_mps.map(Into::into),
            missed: self.velocity.missed,
            indicator: self.indicator.state(),
            theta_hat: (self.estimate.as_ref()).map(|estimate| estimate.theta_hat().into()),
            transfers: self.transfers,
            has_answered: self.has_answered,
            command,
            internals,
        }
    }

    /// Returns the last velocities of the pistons, 0 before the first sample.
    #[must_use]
    pub fn last_velocities_mps(&self) -> [f64; 2] {
        self.velocity.last_mps.unwrap_or_else(Vector2::zeros).into()
    }

    /// Sets the last velocities of the pistons.
    pub fn set_last_velocities_mps(&mut self, velocities_mps: [f64; 2]) {
        self.velocity.last_mps = Some(velocities_mps.into());
    }

    /// Returns the estimates of the leakage, 0 without an estimate.
    #[must_use]
    pub fn estimates(&self) -> [f64; 2] {
        self.theta_hat().into()
    }

    /// Sets the estimates of the leakage, if the law has any.
    pub fn set_estimates(&mut self, estimates: [f64; 2]) {
        if let Some(estimate) = &mut self.estimate {
            estimate.restore(estimates.into());
        }
    }

    /// Restores a saved state.
    pub fn restore(&mut self, state: LawState) {
        self.velocity = VelocityHistory {
            last_mps: state.last_velocities_mps.map(Into::into),
            missed: state.missed,
        };
        self.indicator.restore(state.indicator);
        if let (Some(estimate), Some(theta_hat)) = (&mut self.estimate, state.theta_hat) {
            estimate.restore(theta_hat.into());
        }
        (self.former, self.transfers) = (None, state.transfers);
        self.has_answered = state.has_answered;
        self.answer = (state.command, state.internals);
    }

    /// Answers a valid sample.
    pub fn step(&mut self, measured: &Measured, reference: &Reference) -> (Command, Internals) {
        let pistons = measured.pistons();
        let positions = Vector2::new(pistons[0].position_m, pistons[1].position_m);
        let velocities = Vector2::new(pistons[0].velocity_mps, pistons[1].velocity_mps);
        let accelerations = self.velocity.acceleration(velocities, self.period_s);

        let sampled = Sampled {
            measured,
            reference,
            pistons: &pistons,
            f: [positions, velocities, accelerations].map(|x| self.plant.sum_and_difference(x)),
            hydraulics: core::array::from_fn(|i| Hydraulics::at(&self.actuators[i], &pistons[i])),
        };
        let theta_hat = self.theta_hat();
        let (errors, wanted_a) = self.demand(&self.design, &sampled, theta_hat);
        let [current1_a, current2_a] = self.continued(wanted_a, &sampled);
        let hydraulics = sampled.hydraulics;

        let verdict = self.indicator.judge(&errors);
        if let Some(estimate) = &mut self.estimate
            && verdict.degraded
        {
            let [f_h13, f_h23] =
                core::array::from_fn(|i| hydraulics[i].leakage_effect(&pistons[i]));
            estimate.adapt(
                &self.plant,
                Vector2::new(f_h13, f_h23),
                errors.z_3,
                self.period_s,
            );
        }

        self.answer = (
            Command {
                actuator1_valve_current_a: current1_a,
                actuator2_valve_current_a: current2_a,
            },
            Internals {
                lyapunov_v3: verdict.v3,
                lyapunov_bound: verdict.bound,
                fault_detected: if verdict.detected { 1.0 } else { 0.0 },
                leakage_estimate1_m3ps_per_sqrt_pa: theta_hat[0],
                leakage_estimate2_m3ps_per_sqrt_pa: theta_hat[1],
                z11: errors.z_1[0],
                z12: errors.z_1[1],
                z21: errors.z_2[0],
                z22: errors.z_2[1],
                z31: errors.z_3[0],
                z32: errors.z_3[1],
            },
        );
        self.answer
    }

    /// Returns the errors of a design at a sample, and the currents that it demands.
    fn demand(
        &self,
        design: &Design,
        sampled: &Sampled<'_>,
        theta_hat: Vector2<f64>,
    ) -> (Errors, [f64; 2]) {
        let Sampled {
            measured,
            reference,
            pistons,
            f,
            hydraulics,
        } = sampled;
        let theta_d = design.trajectory.surface_angle(
            measured.surface_angle_rad,
            measured.surface_rate_radps,
            &f.map(|f| f[0]),
        );
        let theta_r = reference.jet();
        let x_r1 = design.trajectory.sum(&theta_d, &theta_r);
        let x_r2 = design.trajectory.difference(&theta_r);
        let x_r = core::array::from_fn(|j| Vector2::new(x_r1[j], x_r2[j]));

        let [force1_n, force2_n] =
            core::array::from_fn(|i| hydraulic_force_n(&self.actuators[i], &pistons[i]));
        let x_3 = Vector2::new(force1_n, force2_n);
        let (errors, force_rate) =
            design
                .steps
                .errors_and_force_rate(&self.plant, f, &x_r, &theta_d, x_3);
        let currents_a = core::array::from_fn(|i| {
            let current_a =
                self.current_a(i, &hydraulics[i], &pistons[i], force_rate[i], theta_hat[i]);
            limited(current_a, design.command_limits_a[i])
        });
        (errors, currents_a)
    }

    /// Returns currents that continue from those before a change, within the current limits.
    fn continued(&mut self, wanted_a: [f64; 2], sampled: &Sampled<'_>) -> [f64; 2] {
        let held_command = std::mem::take(&mut self.transfers.changed).then(|| {
            let (command, _) = self.answer;
            [
                command.actuator1_valve_current_a,
                command.actuator2_valve_current_a,
            ]
        });
        self.has_answered = true;
        let former = (self.former.take())
            .map(|(design, theta_hat)| self.demand(&design, sampled, theta_hat).1);
        let mut currents_a = wanted_a;
        for (i, current_a) in currents_a.iter_mut().enumerate() {
            let transfer = &mut self.transfers.of_actuators[i];
            let left_a = transfer.next();
            let old_a = held_command.map(|held_command| held_command[i]);
            let old_a = old_a.or_else(|| former.map(|former| former[i] + left_a));
            *current_a = match old_a {
                Some(old_a) => transfer.begin(old_a, wanted_a[i], self.period_s),
                None => wanted_a[i] + left_a,
            };
            *current_a = limited(*current_a, self.design.command_limits_a[i]);
        }
        currents_a
    }

    /// Answers an invalid sample by repeating the last command. The sample is used neither for the estimate nor for the
    /// indicator; the next velocity difference spans the gap.
    pub fn hold(&mut self) -> (Command, Internals) {
        self.transfers.changed |= self.former.take().is_some();
        self.velocity.skip();
        self.indicator.skip();
        self.answer
    }

    /// Returns the current of one valve.
    ///
    /// `u = F_1^-1 [F_2 + F_3 theta_hat + M_3^-1 (..)]` (eq. 52).
    fn current_a(
        &self,
        actuator: usize,
        hydraulics: &Hydraulics,
        piston: &PistonState,
        force_rate_n_per_s: f64,
        theta_hat: f64,
    ) -> f64 {
        let model = &self.actuators[actuator];
        let bracket = hydraulics.motion_effect_n_per_s(model, piston)
            + hydraulics.leakage_effect(piston) * theta_hat
            + force_rate_n_per_s;
        hydraulics.current_a(model, piston, bracket)
    }
}

/// Sample with the quantities that every design derives from it.
struct Sampled<'a> {
    measured: &'a Measured,
    reference: &'a Reference,
    pistons: &'a [PistonState; 2],
    /// Sum and difference of the pistons' motion, with two derivatives.
    f: [Vector2<f64>; 3],
    hydraulics: [Hydraulics; 2],
}

/// Last measured velocities, for the acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct VelocityHistory {
    last_mps: Option<Vector2<f64>>,
    /// Samples without a valid velocity since the last valid one.
    missed: u32,
}

impl VelocityHistory {
    /// Returns the backward difference `(v_k - v_(k-1)) / T`; 0 at the first sample.
    fn acceleration(&mut self, velocities_mps: Vector2<f64>, period_s: f64) -> Vector2<f64> {
        let elapsed_s = f64::from(self.missed.saturating_add(1)) * period_s;
        let last_mps = self.last_mps.replace(velocities_mps);
        self.missed = 0;
        last_mps.map_or(Vector2::zeros(), |last| (velocities_mps - last) / elapsed_s)
    }

    fn skip(&mut self) {
        self.missed = self.missed.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_acceleration_is_the_backward_difference_and_bridges_gaps() {
        let mut history = VelocityHistory::default();
        let mut at = |v: f64| history.acceleration(Vector2::new(v, -2.0 * v), 0.25);
        assert_eq!(at(3.0), Vector2::zeros());
        assert_eq!(at(4.0), Vector2::new(4.0, -8.0));
        history.skip();
        let bridged = history.acceleration(Vector2::new(5.0, -10.0), 0.25);
        assert_eq!(bridged, Vector2::new(2.0, -4.0));
    }
}
