//! `pid` for the hydraulic plant: the paper's baseline, one loop per actuator.
//!
//! Each actuator follows `r_d theta_r` with its own piston position; the two are not coupled, which causes the force
//! fight. The paper's gains (Table 2) are proportional only.

use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table::{Empty, Table};

use super::{Gains, Pid, TUNING};
use crate::controller::{Controller, Sample, Setup, Tuning};
use crate::laws::drhas::{Command, PLANT};
use crate::laws::limit::UNLIMITED;

shared_types::table! {
    /// The gains of one actuator's loop (Table 2).
    pub struct ActuatorGains {
        /// Proportional gain k_p.
        proportional_a_per_m: "A/m" = 90.0 in (-1e9)..=1e9 [tunable],
        /// Integral gain k_i.
        integral_a_per_m_s: "A/(m s)" = 0.0 in (-1e9)..=1e9 [tunable],
        /// Derivative gain k_d.
        derivative_a_s_per_m: "A s/m" = 0.0 in (-1e9)..=1e9 [tunable],
        /// Largest magnitude of the current; infinite means no limit.
        command_limit_a: "A" = UNLIMITED in 0.0..=UNLIMITED [tunable],
    }
}

shared_types::table! {
    /// Parameters of the law.
    pub struct Parameters {
        /// Loop of actuator 1.
        actuator1: ActuatorGains,
        /// Loop of actuator 2.
        actuator2: ActuatorGains,
    }
}

shared_types::table! {
    /// Model that the law has of the control surface.
    pub struct SurfaceModel {
        /// Radial distance r_d between hinge and piston rods.
        radial_distance_m: "m" = 0.15 in 1e-3..=1e2,
    }
}

shared_types::table! {
    /// Model that the law has of the plant (Table 1).
    pub struct Model {
        /// Control surface.
        surface: SurfaceModel,
    }
}

shared_types::table! {
    /// Signals that the law needs to measure.
    pub struct Measured {
        /// Piston position x_h1.
        actuator1_position_m: "m",
        /// Piston position x_h2.
        actuator2_position_m: "m",
    }
}

shared_types::table! {
    /// Signals that the law follows.
    pub struct Reference {
        /// Deflection command theta_r.
        surface_angle_rad: "rad",
    }
}

shared_types::table! {
    /// Numbers that the law keeps from sample to sample.
    pub struct StateRow {
        /// Integral of the error of piston 1.
        actuator1_error_integral_m_s: "m s",
        /// Error of piston 1 at the last sample.
        actuator1_last_error_m: "m",
        /// Integral of the error of piston 2.
        actuator2_error_integral_m_s: "m s",
        /// Error of piston 2 at the last sample.
        actuator2_last_error_m: "m",
    }
}

/// The law.
#[derive(Clone, Copy, Debug)]
pub struct ActuatorPid {
    radial_distance_m: f64,
    loops: [Pid; 2],
}

fn gains(parameters: &Parameters) -> [Gains; 2] {
    [parameters.actuator1, parameters.actuator2].map(|own| Gains {
        proportional: own.proportional_a_per_m,
        integral: own.integral_a_per_m_s,
        derivative: own.derivative_a_s_per_m,
        limit: own.command_limit_a,
    })
}

impl Controller for ActuatorPid {
    const NAME: &'static str = "pid";
    const SUMMARY: &'static str =
        "One PID loop per actuator from the error of its own piston position (paper, Table 2).";
    const PLANTS: &'static [&'static str] = &[PLANT];
    type Parameters = Parameters;
    type Model = Model;
    type Measured = Measured;
    type Reference = Reference;
    type Command = Command;
    type Internals = Empty;

    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(
            |law: &Self| law.loops.map(|pid| pid.state()),
            |law, states| {
                for (pid, state) in law.loops.iter_mut().zip(states) {
                    pid.restore(state);
                }
            },
        );
        Some(state.named(
            |law| StateRow::from_row(law.loops.map(|pid| pid.numbers()).as_flattened()),
            |law, row: StateRow| {
                for (pid, own) in law.loops.iter_mut().zip(row.row().chunks_exact(2)) {
                    pid.set_numbers([own[0], own[1]]);
                }
            },
        ))
    }

    fn tuning() -> Option<Tuning<Self>> {
        Some(Tuning {
            does: TUNING,
            take: |law, setup, transition| {
                for (pid, gains) in law.loops.iter_mut().zip(gains(&setup.parameters)) {
                    pid.retune(gains, transition);
                }
            },
        })
    }

    fn start(setup: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self {
            radial_distance_m: setup.model.surface.radial_distance_m,
            loops: gains(&setup.parameters).map(|own| Pid::new(own, setup.period_s)),
        })
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Empty) {
        let wanted_m = self.radial_distance_m * sample.reference.surface_angle_rad;
        let measured = &sample.measured;
        let [first, second] = &mut self.loops;
        let command = if sample.valid {
            Command {
                actuator1_valve_current_a: first.update(wanted_m - measured.actuator1_position_m),
                actuator2_valve_current_a: second.update(wanted_m - measured.actuator2_position_m),
            }
        } else {
            Command {
                actuator1_valve_current_a: first.hold(),
                actuator2_valve_current_a: second.hold(),
            }
        };
        (command, Empty {})
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::Transition;

    fn sample(angle_rad: f64, positions_m: [f64; 2], valid: bool) -> Sample<ActuatorPid> {
        Sample {
            held_steps: 0,
            time_s: 0.0,
            measured: Measured {
                actuator1_position_m: positions_m[0],
                actuator2_position_m: positions_m[1],
            },
            reference: Reference {
                surface_angle_rad: angle_rad,
            },
            valid,
        }
    }

    #[test]
    fn the_papers_gains_answer_each_actuators_own_error() {
        let setup = Setup {
            parameters: Parameters::default(),
            model: Model::default(),
            period_s: 1e-4,
        };
        let mut law = ActuatorPid::start(&setup).expect("starts");
        let (command, _) = law.step(&sample(0.2, [0.01, -0.02], true));
        // 90 (0.15 * 0.2 - 0.01) and 90 (0.15 * 0.2 + 0.02).
        assert!((command.actuator1_valve_current_a - 1.8).abs() < 1e-12);
        assert!((command.actuator2_valve_current_a - 4.5).abs() < 1e-12);
        let (held_command, _) = law.step(&sample(9.0, [9.0, 9.0], false));
        assert_eq!(held_command, command);
    }

    #[test]
    fn the_papers_gains_change_without_a_jump() {
        let mut setup = Setup {
            parameters: Parameters::default(),
            model: Model::default(),
            period_s: 0.05,
        };
        let mut law = ActuatorPid::start(&setup).expect("starts");
        let step = |law: &mut ActuatorPid| {
            let (command, _) = law.step(&sample(0.0, [-0.5, -0.25], true));
            [
                command.actuator1_valve_current_a,
                command.actuator2_valve_current_a,
            ]
        };
        assert_eq!(step(&mut law), [45.0, 22.5]);
        setup.parameters.actuator1.proportional_a_per_m = 30.0;
        let tuning = ActuatorPid::tuning().expect("it can be tuned");
        (tuning.take)(&mut law, &setup, Transition::Step);
        // 45 to 15 within 0.1 s, two samples; nothing changes for actuator 2.
        let commands = [step(&mut law), step(&mut law), step(&mut law)];
        assert_eq!(commands, [[45.0, 22.5], [30.0, 22.5], [15.0, 22.5]]);
    }

    #[test]
    fn the_two_loops_have_their_own_gains() {
        let mut parameters = Parameters::default();
        parameters.actuator2.proportional_a_per_m = 10.0;
        parameters.actuator2.command_limit_a = 0.2;
        let setup = Setup {
            parameters,
            model: Model {
                surface: SurfaceModel {
                    radial_distance_m: 1.0,
                },
            },
            period_s: 1e-4,
        };
        let mut law = ActuatorPid::start(&setup).expect("starts");
        let (command, _) = law.step(&sample(0.5, [0.25, 0.25], true));
        assert_eq!(command.actuator1_valve_current_a, 22.5);
        assert_eq!(command.actuator2_valve_current_a, 0.2);
    }
}
