//! State feedback for the pendulum of `own-plant`: cancels gravity by its model of the plant and pulls to the desired
//! angle, `T = -m g l sin a - k_1 (a - a_wanted) - k_2 a'`.

use std::process::ExitCode;

use controller_process::controller::{Controller, LawKind, Sample, Setup, Tuning};
use shared_types::describe::Invalid;
use shared_types::table;
use shared_types::table::Empty;

table! {
    /// Parameters that a scenario can set under [controller.state-feedback].
    struct Gains {
        /// Gain k_1 on the angle.
        angle_nm_per_rad: "N m/rad" = 9.0 in 0.0..=1e6 [tunable],
        /// Gain k_2 on the rate.
        rate_nm_s_per_rad: "N m s/rad" = 2.95 in 0.0..=1e6 [tunable],
    }
}

table! {
    /// Plant parameters that the law assumes.
    struct Model {
        /// Mass m.
        mass_kg: "kg" = 1.0 in 1e-3..=1e3,
        /// Length l.
        length_m: "m" = 0.5 in 1e-2..=1e2,
    }
}

table! {
    /// Measured signals. Names and units bind them to a plant.
    struct Measured {
        /// Angle a from upright.
        angle_rad: "rad",
        /// Rate of the angle.
        rate_radps: "rad/s",
    }
}

table! {
    /// Reference to follow, a stimulus of the scenario.
    struct Reference {
        /// Wanted angle.
        angle_rad: "rad",
    }
}

table! {
    /// Command of the law.
    struct Command {
        /// Torque T of the motor.
        torque_nm: "N m",
    }
}

struct StateFeedback {
    gains: Gains,
    weight_nm: f64,
}

impl Controller for StateFeedback {
    const NAME: &'static str = "state-feedback";
    const SUMMARY: &'static str = "Cancels gravity and feeds angle and rate back.";
    type Parameters = Gains;
    type Model = Model;
    type Measured = Measured;
    type Reference = Reference;
    type Command = Command;
    type Internals = Empty;

    fn start(setup: &Setup<Self>) -> Result<Self, Invalid> {
        let (gains, model) = (setup.parameters, setup.model);
        let weight_nm = model.mass_kg * 9.80665 * model.length_m;
        Ok(Self { gains, weight_nm })
    }

    fn tuning() -> Option<Tuning<Self>> {
        Some(Tuning {
            does: "The torque jumps with a gain.",
            take: |law, setup, _| law.gains = setup.parameters,
        })
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Empty) {
        let (k_1, k_2) = (self.gains.angle_nm_per_rad, self.gains.rate_nm_s_per_rad);
        let (a, a_dot) = (sample.measured.angle_rad, sample.measured.rate_radps);
        let feedback_nm = k_1 * (a - sample.reference.angle_rad) + k_2 * a_dot;
        let torque_nm = -self.weight_nm * libm::sin(a) - feedback_nm;
        (Command { torque_nm }, Empty {})
    }
}

fn main() -> ExitCode {
    let laws = vec![LawKind::of::<StateFeedback>()];
    let (program, version) = (env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"));
    controller_process::program::run(program, version, laws)
}
