//! A quadcopter with its inertial sensors: a rigid body, four motors with lag, four feet on a flat ground.
//!
//! Earth axes are north, east and down (NED), body axes forward, right and down (FRD). Motors are numbered as in a
//! quad X: 1 rear right, 2 front right, 3 rear left, 4 front left.

mod body;
#[cfg(test)]
mod tests;

use std::process::ExitCode;

use plant_process::integrate::integrate;
use plant_process::plant::{Plant, PlantKind};
use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::time::Interval;

use body::{Loads, State};

table! {
    /// Parameters that a scenario can set under [plant.parameters]: a frame of 5 inches.
    struct Parameters {
        /// Mass m.
        mass_kg: "kg" = 0.6 in 0.05..=50.0 [faultable],
        /// Distance of each motor from the centre along the forward and the right axis, a.
        arm_m: "m" = 0.08 in 0.01..=2.0,
        /// Moment of inertia about the forward axis, J_x.
        inertia_x_kgm2: "kg m^2" = 0.0026 in 1e-6..=10.0,
        /// Moment of inertia about the right axis, J_y.
        inertia_y_kgm2: "kg m^2" = 0.0028 in 1e-6..=10.0,
        /// Moment of inertia about the down axis, J_z.
        inertia_z_kgm2: "kg m^2" = 0.0048 in 1e-6..=10.0,
        /// Thrust of one motor at full speed, T.
        full_thrust_n: "N" = 6.0 in 0.1..=500.0,
        /// Drag torque of a propeller over its thrust, c.
        torque_per_thrust_m: "m" = 0.012 in 0.0..=1.0,
        /// Time constant of a motor, tau.
        motor_lag_s: "s" = 0.03 in 1e-3..=1.0,
        /// Drag of the body over its velocity, d.
        drag_n_s_per_m: "N s/m" = 0.25 in 0.0..=100.0,
        /// Thrust of motor 1 over that of a sound one.
        motor1_thrust: "1" = 1.0 in 0.0..=1.0 [faultable],
        /// Thrust of motor 2 over that of a sound one.
        motor2_thrust: "1" = 1.0 in 0.0..=1.0 [faultable],
        /// Thrust of motor 3 over that of a sound one.
        motor3_thrust: "1" = 1.0 in 0.0..=1.0 [faultable],
        /// Thrust of motor 4 over that of a sound one.
        motor4_thrust: "1" = 1.0 in 0.0..=1.0 [faultable],
        /// Temperature of the air on the ground.
        ground_temperature_k: "K" = 288.15 in 200.0..=350.0,
        /// Pressure of the air on the ground.
        ground_pressure_pa: "Pa" = 101325.0 in 5e4..=1.2e5,
    }
}

table! {
    /// True motion; the run ends where the frame has turned over or flown away.
    struct Truth {
        /// Angle of roll, right side down.
        roll_rad: "rad" in (-1.57)..=1.57,
        /// Angle of pitch, nose up.
        pitch_rad: "rad" in (-1.57)..=1.57,
        /// Angle of yaw, nose to the right of north.
        yaw_rad: "rad",
        /// Height of the feet over the ground.
        altitude_m: "m" in (-1.0)..=500.0,
        /// Position north of the start.
        north_m: "m",
        /// Position east of the start.
        east_m: "m",
        /// Climb rate.
        climb_mps: "m/s",
        /// Sum of the four thrusts.
        thrust_n: "N",
    }
}

table! {
    /// Readings of the inertial sensors, the attitude reference and the barometer.
    struct Measured {
        /// Clock of the sensors, which runs with the simulated time.
        clock_s: "s",
        /// Rate about the forward axis.
        rate_x_radps: "rad/s",
        /// Rate about the right axis.
        rate_y_radps: "rad/s",
        /// Rate about the down axis.
        rate_z_radps: "rad/s",
        /// Specific force along the forward axis.
        force_x_mps2: "m/s2",
        /// Specific force along the right axis.
        force_y_mps2: "m/s2",
        /// Specific force along the down axis, -g at rest.
        force_z_mps2: "m/s2",
        /// Scalar part of the quaternion that turns body axes into earth axes.
        attitude_q0: "1",
        /// Forward part of the quaternion.
        attitude_q1: "1",
        /// Right part of the quaternion.
        attitude_q2: "1",
        /// Down part of the quaternion.
        attitude_q3: "1",
        /// Static pressure.
        pressure_pa: "Pa",
    }
}

table! {
    /// Commands of the flight controller: speed of each motor over full speed.
    struct Command {
        /// Rear right.
        motor1: "1" in 0.0..=1.0,
        /// Front right.
        motor2: "1" in 0.0..=1.0,
        /// Rear left.
        motor3: "1" in 0.0..=1.0,
        /// Front left.
        motor4: "1" in 0.0..=1.0,
    }
}

struct Quad {
    parameters: Parameters,
    state: State,
    time_s: f64,
}

impl Plant for Quad {
    const NAME: &'static str = "quad";
    const SUMMARY: &'static str = "A quadcopter with inertial sensors and a barometer.";
    type Parameters = Parameters;
    type Truth = Truth;
    type Measured = Measured;
    type Command = Command;

    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(
            |plant: &Self| (plant.state.to_vec(), plant.time_s),
            |plant, (x, time_s): (Vec<f64>, f64)| {
                plant.state.copy_from_slice(&x);
                plant.time_s = time_s;
            },
        );
        Some(state)
    }

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        Ok(Self {
            parameters: *parameters,
            state: body::at_rest(parameters),
            time_s: 0.0,
        })
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.parameters = *parameters;
    }

    fn measure(&self) -> Measured {
        let loads = Loads::of(&self.parameters, &self.state);
        let [attitude_q0, attitude_q1, attitude_q2, attitude_q3] = body::quaternion(&self.state);
        let [rate_x_radps, rate_y_radps, rate_z_radps] = body::rates(&self.state);
        let [force_x_mps2, force_y_mps2, force_z_mps2] =
            loads.force_n.map(|force| force / self.parameters.mass_kg);
        Measured {
            clock_s: self.time_s,
            rate_x_radps,
            rate_y_radps,
            rate_z_radps,
            force_x_mps2,
            force_y_mps2,
            force_z_mps2,
            attitude_q0,
            attitude_q1,
            attitude_q2,
            attitude_q3,
            pressure_pa: body::pressure_pa(&self.parameters, body::altitude_m(&self.state)),
        }
    }

    fn truth(&self, _time_s: f64, _command: &Command) -> Truth {
        let [roll_rad, pitch_rad, yaw_rad] = body::attitude_rad(&self.state);
        let [north_m, east_m, _] = body::position_m(&self.state);
        Truth {
            roll_rad,
            pitch_rad,
            yaw_rad,
            altitude_m: body::altitude_m(&self.state),
            north_m,
            east_m,
            climb_mps: -body::velocity_mps(&self.state)[2],
            thrust_n: body::thrusts_n(&self.parameters, &self.state).iter().sum(),
        }
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        let p = &self.parameters;
        let speeds = [
            command.motor1,
            command.motor2,
            command.motor3,
            command.motor4,
        ];
        integrate(&mut self.state, interval, |_, x| {
            body::derivative(p, x, &speeds)
        });
        body::normalise(&mut self.state);
        self.time_s = interval.start_s + interval.length_s;
    }
}

fn main() -> ExitCode {
    let plants = vec![PlantKind::of::<Quad>()];
    let (program, version) = (env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"));
    plant_process::program::run(program, version, plants)
}
