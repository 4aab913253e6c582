//! The teaching plant: a mass on a spring with a damper, `m x'' + c x' + k x = F + d`.
//!
//! Read this module from top to bottom before you write a plant of your own: four tables define the inputs and outputs,
//! and the implementation of [`Plant`] below them is the whole model. Faults are a list of named moves of the plant's
//! faultable parameters; the equations are unaware of them.

use shared_types::describe::{
    FaultDescription, Invalid, MoveBy, Operation, ParameterMove, ProfileDescription,
};
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::table::Field;
use shared_types::time::Interval;

use crate::integrate::integrate;
use crate::plant::Plant;

table! {
    /// Parameters of the plant.
    pub struct Parameters {
        /// Mass m.
        mass_kg: "kg" = 1.0 in 1e-6..=1e9 [tunable],
        /// Damping c.
        damping_n_s_per_m: "N s/m" = 2.0 in 0.0..=1e9 [tunable],
        /// Spring stiffness k.
        stiffness_n_per_m: "N/m" = 100.0 in 0.0..=1e12 [faultable],
        /// Force d that pushes the mass besides the command.
        disturbance_n: "N" = 0.0 in (-1e9)..=1e9 [faultable],
        /// Position at step 0.
        initial_position_m: "m" = 0.0 in (-1e3)..=1e3,
        /// Velocity at step 0.
        initial_velocity_mps: "m/s" = 0.0 in (-1e3)..=1e3,
    }
}

table! {
    /// True state and outputs.
    pub struct Truth {
        /// Position x, 0 where the spring is relaxed.
        position_m: "m" in (-1e6)..=1e6,
        /// Velocity.
        velocity_mps: "m/s" in (-1e6)..=1e6,
        /// Acceleration under the present command.
        acceleration_mps2: "m/s2",
        /// Kinetic energy and energy of the spring.
        energy_j: "J",
    }
}

table! {
    /// Sensor readings.
    pub struct Measured {
        /// Position x.
        position_m: "m",
        /// Velocity.
        velocity_mps: "m/s",
    }
}

table! {
    /// Commands of the controller.
    pub struct Command {
        /// Force F on the mass.
        force_n: "N",
    }
}

/// The plant: its parameters and its state, position in m and velocity in m/s.
pub struct SpringMass {
    parameters: Parameters,
    state: [f64; 2],
}

/// Computes `x'' = (F + d - c x' - k x) / m` (Newton's second law; the spring is linear at any length).
fn acceleration_mps2(p: &Parameters, command: &Command, [x, v]: &[f64; 2]) -> f64 {
    let (c, k, m) = (p.damping_n_s_per_m, p.stiffness_n_per_m, p.mass_kg);
    (command.force_n + p.disturbance_n - c * v - k * x) / m
}

/// Computes `m x'^2 / 2 + k x^2 / 2`.
fn energy_j(p: &Parameters, [x, v]: &[f64; 2]) -> f64 {
    0.5 * p.mass_kg * v * v + 0.5 * p.stiffness_n_per_m * x * x
}

impl Plant for SpringMass {
    const NAME: &'static str = "spring-mass";
    const SUMMARY: &'static str = "A mass on a spring with a damper, pushed by a commanded force.";
    type Parameters = Parameters;
    type Truth = Truth;
    type Measured = Measured;
    type Command = Command;

    fn faults() -> Vec<FaultDescription> {
        let size = |key, unit, text, min, max| Field {
            min,
            max,
            ..Field::signal(key, unit, text)
        };
        let moved = |parameter: &str, operation, key: &str| ParameterMove {
            parameter: parameter.into(),
            operation,
            by: MoveBy::Size(key.into()),
        };
        vec![
            FaultDescription {
                kind: "stiffness-loss".into(),
                summary: "The spring softens or breaks.".into(),
                equation: "k -> k (1 + (factor - 1) g)".into(),
                selector: None,
                sizes: vec![size(
                    "factor",
                    "1",
                    "Share of the stiffness left.",
                    0.0,
                    1.0,
                )],
                moves: vec![moved("stiffness_n_per_m", Operation::Scale, "factor")],
                profile: ProfileDescription::Step,
            },
            FaultDescription {
                kind: "push".into(),
                summary: "A force pushes the mass besides the command.".into(),
                equation: "d -> d + force g".into(),
                selector: None,
                sizes: vec![size("force_n", "N", "The force.", -1e6, 1e6)],
                moves: vec![moved("disturbance_n", Operation::Add, "force_n")],
                profile: ProfileDescription::Step,
            },
        ]
    }

    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(|plant: &Self| plant.state, |plant, x| plant.state = x);
        // The sensors read the whole state.
        let set =
            |plant: &mut Self, row: Measured| plant.state = [row.position_m, row.velocity_mps];
        Some(state.named(Plant::measure, set))
    }

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        Ok(Self {
            parameters: *parameters,
            state: [
                parameters.initial_position_m,
                parameters.initial_velocity_mps,
            ],
        })
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.parameters = *parameters;
    }

    fn measure(&self) -> Measured {
        let [position_m, velocity_mps] = self.state;
        Measured {
            position_m,
            velocity_mps,
        }
    }

    fn truth(&self, _time_s: f64, command: &Command) -> Truth {
        let [position_m, velocity_mps] = self.state;
        Truth {
            position_m,
            velocity_mps,
            acceleration_mps2: acceleration_mps2(&self.parameters, command, &self.state),
            energy_j: energy_j(&self.parameters, &self.state),
        }
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        let p = &self.parameters;
        integrate(&mut self.state, interval, |_, x| {
            [x[1], acceleration_mps2(p, command, x)]
        });
    }
}

#[cfg(test)]
mod tests {
    use shared_types::table::Table;

    use super::*;

    const SECOND: Interval = Interval {
        start_s: 0.0,
        length_s: 1.0,
        substeps: 4000,
    };

    #[test]
    fn the_response_to_a_force_step_matches_the_closed_form() {
        // x(t) = F/k (1 - e^(-z w t) (cos w_d t + z w / w_d sin w_d t)), with w = 10 rad/s and
        // z = c / (2 sqrt(k m)) = 0.1.
        let mut plant = SpringMass::start(&Parameters::default()).unwrap();
        plant.advance(&SECOND, &Command { force_n: 50.0 });
        let (w, z) = (10.0, 0.1);
        let w_d = w * (1.0_f64 - z * z).sqrt();
        let decay = libm::exp(-z * w);
        let shape = libm::cos(w_d) + z * w / w_d * libm::sin(w_d);
        let expected_m = 50.0 / 100.0 * (1.0 - decay * shape);
        let expected_mps = 0.5 * decay * (w * w / w_d) * libm::sin(w_d);
        let truth = plant.truth(1.0, &Command { force_n: 50.0 });
        assert!((truth.position_m - expected_m).abs() < 1e-10);
        assert!((truth.velocity_mps - expected_mps).abs() < 1e-9);
    }

    #[test]
    fn free_vibration_without_damping_conserves_energy() {
        let parameters = Parameters {
            damping_n_s_per_m: 0.0,
            initial_position_m: 0.3,
            initial_velocity_mps: 4.0,
            ..Parameters::default()
        };
        let mut plant = SpringMass::start(&parameters).unwrap();
        let rest = Command { force_n: 0.0 };
        assert_eq!(
            plant.truth(0.0, &rest).energy_j,
            0.5 * 16.0 + 0.5 * 100.0 * 0.3 * 0.3
        );
        plant.advance(&SECOND, &rest);
        let truth = plant.truth(1.0, &rest);
        assert!((truth.energy_j - 12.5).abs() < 1e-8, "{}", truth.energy_j);
        // x(t) = x0 cos w t + v0 / w sin w t.
        let expected_m = 0.3 * libm::cos(10.0) + 0.4 * libm::sin(10.0);
        assert!((truth.position_m - expected_m).abs() < 1e-9);
    }

    #[test]
    fn a_broken_spring_and_a_disturbance_act_at_once() {
        let mut plant = SpringMass::start(&Parameters {
            initial_position_m: 1.0,
            ..Parameters::default()
        })
        .unwrap();
        let rest = Command { force_n: 0.0 };
        assert_eq!(plant.truth(0.0, &rest).acceleration_mps2, -100.0);
        plant.retune(&Parameters {
            stiffness_n_per_m: 0.0,
            disturbance_n: 7.0,
            ..Parameters::default()
        });
        assert_eq!(plant.truth(0.0, &rest).acceleration_mps2, 7.0);
    }

    #[test]
    fn every_fault_moves_a_parameter_that_is_open_to_faults() {
        let fields = Parameters::fields();
        for moved in SpringMass::faults().iter().flat_map(|fault| &fault.moves) {
            let field = fields.iter().find(|field| field.name == moved.parameter);
            assert!(field.is_some_and(|field| field.faultable), "{moved:?}");
        }
    }

    #[test]
    fn the_sensors_report_the_state() {
        let plant = SpringMass::start(&Parameters {
            initial_position_m: 0.5,
            initial_velocity_mps: -2.0,
            ..Parameters::default()
        })
        .unwrap();
        let measured = Plant::measure(&plant);
        assert_eq!((measured.position_m, measured.velocity_mps), (0.5, -2.0));
    }
}
