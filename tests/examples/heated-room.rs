//! A plant with inputs that no law commands: a room that its heater and its surroundings warm. Not a program of the
//! workspace: the tests of inputs give it to `hil run --plant-bin`.
//!
//! `T' = (T_amb + q / g - T) / tau` with the heating power q, the conductance g and the ambient temperature T_amb.

use std::process::ExitCode;

use plant_process::integrate::integrate;
use plant_process::plant::{Plant, PlantKind};
use plant_process::program;
use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::time::Interval;

table! {
    /// Parameters.
    struct Parameters {
        /// Time constant tau.
        time_constant_s: "s" = 0.5 in 1e-3..=1e6,
        /// Conductance g.
        conductance_w_per_k: "W/K" = 10.0 in 1e-3..=1e6,
        /// Temperature at the start.
        initial_k: "K" = 300.0 in 0.0..=1e4,
    }
}

table! {
    /// True state, which the sensor reports.
    struct Temperature {
        /// Temperature T of the room.
        room_k: "K" in 0.0..=1e4,
    }
}

table! {
    /// Commands and other inputs.
    struct Command {
        /// Ambient temperature T_amb.
        ambient_k: "K" start 280.0 in 100.0..=1000.0,
        /// Heating power q.
        heating_w: "W",
    }
}

struct Room(Parameters, [f64; 1]);

impl Plant for Room {
    const NAME: &'static str = "heated-room";
    const SUMMARY: &'static str = "A room that its heater and its surroundings warm.";
    type Parameters = Parameters;
    type Truth = Temperature;
    type Measured = Temperature;
    type Command = Command;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |room: &Self| room.1,
            |room, state| room.1 = state,
        ))
    }

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        Ok(Self(*parameters, [parameters.initial_k]))
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.0 = *parameters;
    }

    fn measure(&self) -> Temperature {
        Temperature { room_k: self.1[0] }
    }

    fn truth(&self, _: f64, _: &Command) -> Temperature {
        self.measure()
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        let Parameters {
            time_constant_s,
            conductance_w_per_k,
            ..
        } = self.0;
        let heated_k = command.ambient_k + command.heating_w / conductance_w_per_k;
        integrate(&mut self.1, interval, |_, [t]| {
            [(heated_k - t) / time_constant_s]
        });
    }
}

fn main() -> ExitCode {
    let plants = vec![PlantKind::of::<Room>()];
    program::run("heated-room", "0.1.0", plants)
}
