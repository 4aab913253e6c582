//! An inverted pendulum with a motor at its pivot: `m l^2 a'' = m g l sin a - c a' + T`.
//!
//! Three tables define inputs and outputs, `impl Plant` is the model, and `main` is the whole process.

use std::process::ExitCode;

use plant_process::integrate::integrate;
use plant_process::plant::{Plant, PlantKind};
use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::time::Interval;

table! {
    /// Parameters that a scenario can set under [plant.parameters].
    struct Parameters {
        /// Mass m at the end of the rod.
        mass_kg: "kg" = 1.0 in 1e-3..=1e3 [faultable],
        /// Length l of the rod.
        length_m: "m" = 0.5 in 1e-2..=1e2,
        /// Friction c of the pivot.
        friction_nm_s_per_rad: "N m s/rad" = 0.05 in 0.0..=1e3,
        /// Angle at step 0.
        initial_angle_rad: "rad" = 0.2 in (-1.5)..=1.5,
    }
}

table! {
    /// True motion, which the sensors also see; the run ends where the pendulum falls over.
    struct Motion {
        /// Angle a from upright.
        angle_rad: "rad" in (-1.57)..=1.57,
        /// Rate of the angle.
        rate_radps: "rad/s",
    }
}

table! {
    /// Command of the controller.
    struct Command {
        /// Torque T of the motor.
        torque_nm: "N m",
    }
}

struct Pendulum {
    parameters: Parameters,
    state: [f64; 2],
}

impl Plant for Pendulum {
    const NAME: &'static str = "pendulum";
    const SUMMARY: &'static str = "A pendulum on its head, with a motor at its pivot.";
    type Parameters = Parameters;
    type Truth = Motion;
    type Measured = Motion;
    type Command = Command;

    // State that a checkpoint keeps for `hil run --from`; a plant without this function still runs.
    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(|plant: &Self| plant.state, |plant, x| plant.state = x);
        let set = |plant: &mut Self, row: Motion| plant.state = [row.angle_rad, row.rate_radps];
        Some(state.named(Plant::measure, set))
    }

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        let (parameters, state) = (*parameters, [parameters.initial_angle_rad, 0.0]);
        Ok(Self { parameters, state })
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.parameters = *parameters;
    }

    fn measure(&self) -> Motion {
        let [angle_rad, rate_radps] = self.state;
        Motion {
            angle_rad,
            rate_radps,
        }
    }

    fn truth(&self, _time_s: f64, _command: &Command) -> Motion {
        self.measure()
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        const G: f64 = 9.80665;
        let p = &self.parameters;
        let (m, l, c) = (p.mass_kg, p.length_m, p.friction_nm_s_per_rad);
        integrate(&mut self.state, interval, |_, &[a, a_dot]| {
            let torque_nm = m * G * l * libm::sin(a) - c * a_dot + command.torque_nm;
            [a_dot, torque_nm / (m * l * l)]
        });
    }
}

fn main() -> ExitCode {
    let plants = vec![PlantKind::of::<Pendulum>()];
    let (program, version) = (env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"));
    plant_process::program::run(program, version, plants)
}
