//! Equations of motion: a rigid body in the axes of Stevens, Lewis and Johnson, Aircraft Control and Simulation, 3rd
//! ed., 1.7 and 1.8.
//!
//! `p' = v`, `v' = g + R f / m`, `q' = q (0, w) / 2`, `w' = J^-1 (M - w x J w)`, `s' = (u - s) / tau`; f is the sum of
//! thrusts, drag and feet in body axes, each thrust is `T s^2` against the down axis.

use crate::Parameters;

/// Position, velocity (NED), quaternion of body to earth (scalar first), rates (FRD), speeds of motors over full speed.
pub type State = [f64; 17];

type Vector = [f64; 3];

const G: f64 = 9.80665;
/// Signs of the forward and right place of each motor, and of the torque of its propeller about the down axis: 1 and 4
/// turn clockwise from above, so that the frame is driven the other way.
const MOTORS: [[f64; 3]; 4] = [
    [-1.0, 1.0, -1.0],
    [1.0, 1.0, 1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, -1.0],
];
/// Period of a quarter of the mass on one foot without damping, from which the stiffness of a foot follows.
const FOOT_PERIOD_S: f64 = 0.1;

pub fn at_rest(parameters: &Parameters) -> State {
    let mut x = [0.0; 17];
    x[6] = 1.0;
    x[2] = G * parameters.mass_kg / (4.0 * foot_stiffness(parameters));
    x
}

pub fn position_m(x: &State) -> Vector {
    [x[0], x[1], x[2]]
}

pub fn velocity_mps(x: &State) -> Vector {
    [x[3], x[4], x[5]]
}

pub fn rates(x: &State) -> Vector {
    [x[10], x[11], x[12]]
}

/// Quaternion of body to earth axes, scalar first.
pub fn quaternion(x: &State) -> [f64; 4] {
    [x[6], x[7], x[8], x[9]]
}

pub fn altitude_m(x: &State) -> f64 {
    -x[2]
}

/// Roll, pitch and yaw of the sequence yaw, pitch, roll.
pub fn attitude_rad(x: &State) -> Vector {
    let [w, a, b, c] = quaternion(x);
    let roll = libm::atan2(2.0 * (w * a + b * c), 1.0 - 2.0 * (a * a + b * b));
    let pitch = libm::asin((2.0 * (w * b - c * a)).clamp(-1.0, 1.0));
    let yaw = libm::atan2(2.0 * (w * c + a * b), 1.0 - 2.0 * (b * b + c * c));
    [roll, pitch, yaw]
}

/// Pressure at a height in the troposphere of the International Standard Atmosphere (ISO 2533).
pub fn pressure_pa(parameters: &Parameters, altitude_m: f64) -> f64 {
    const LAPSE_K_PER_M: f64 = 0.0065;
    const EXPONENT: f64 = 5.255_88;
    let ratio = 1.0 - LAPSE_K_PER_M * altitude_m / parameters.ground_temperature_k;
    parameters.ground_pressure_pa * libm::pow(ratio, EXPONENT)
}

pub fn thrusts_n(parameters: &Parameters, x: &State) -> [f64; 4] {
    let p = parameters;
    let sound = [
        p.motor1_thrust,
        p.motor2_thrust,
        p.motor3_thrust,
        p.motor4_thrust,
    ];
    std::array::from_fn(|motor| sound[motor] * p.full_thrust_n * x[13 + motor] * x[13 + motor])
}

/// Force without gravity, and moment about the centre, in body axes.
pub struct Loads {
    pub force_n: Vector,
    pub moment_nm: Vector,
}

impl Loads {
    pub fn of(parameters: &Parameters, x: &State) -> Self {
        let p = parameters;
        let velocity = velocity_mps(x);
        let mut force_n = to_body(x, velocity.map(|speed| -p.drag_n_s_per_m * speed));
        let mut moment_nm = [0.0; 3];
        for (thrust, [forward, right, turn]) in thrusts_n(p, x).into_iter().zip(MOTORS) {
            let place = [forward * p.arm_m, right * p.arm_m, 0.0];
            add(&mut force_n, [0.0, 0.0, -thrust]);
            add(&mut moment_nm, cross(place, [0.0, 0.0, -thrust]));
            moment_nm[2] += turn * p.torque_per_thrust_m * thrust;
            let foot_n = to_body(x, foot_force_n(p, x, place));
            add(&mut force_n, foot_n);
            add(&mut moment_nm, cross(place, foot_n));
        }
        Self { force_n, moment_nm }
    }
}

/// Force of the ground on the foot below a motor, in earth axes: a spring with critical damping that cannot pull, and
/// viscous friction.
fn foot_force_n(parameters: &Parameters, x: &State, place: Vector) -> Vector {
    let depth = x[2] + to_earth(x, place)[2];
    if depth <= 0.0 {
        return [0.0; 3];
    }
    let mut velocity = velocity_mps(x);
    add(&mut velocity, to_earth(x, cross(rates(x), place)));
    let stiffness = foot_stiffness(parameters);
    let damping = 2.0 * libm::sqrt(stiffness * parameters.mass_kg / 4.0);
    let normal = stiffness * depth + damping * velocity[2];
    if normal <= 0.0 {
        return [0.0; 3];
    }
    [-damping * velocity[0], -damping * velocity[1], -normal]
}

fn foot_stiffness(parameters: &Parameters) -> f64 {
    let turns = 2.0 * std::f64::consts::PI / FOOT_PERIOD_S;
    parameters.mass_kg / 4.0 * turns * turns
}

pub fn derivative(parameters: &Parameters, x: &State, speeds: &[f64; 4]) -> State {
    let p = parameters;
    let Loads { force_n, moment_nm } = Loads::of(p, x);
    let mut acceleration = to_earth(x, force_n.map(|force| force / p.mass_kg));
    acceleration[2] += G;
    let [w, a, b, c] = quaternion(x);
    let [roll, pitch, yaw] = rates(x);
    let inertia = [p.inertia_x_kgm2, p.inertia_y_kgm2, p.inertia_z_kgm2];
    let momentum = [inertia[0] * roll, inertia[1] * pitch, inertia[2] * yaw];
    let gyroscopic = cross(rates(x), momentum);
    let mut rate = [0.0; 17];
    rate[0..3].copy_from_slice(&velocity_mps(x));
    rate[3..6].copy_from_slice(&acceleration);
    rate[6] = -0.5 * (a * roll + b * pitch + c * yaw);
    rate[7] = 0.5 * (w * roll + b * yaw - c * pitch);
    rate[8] = 0.5 * (w * pitch + c * roll - a * yaw);
    rate[9] = 0.5 * (w * yaw + a * pitch - b * roll);
    for axis in 0..3 {
        rate[10 + axis] = (moment_nm[axis] - gyroscopic[axis]) / inertia[axis];
    }
    for motor in 0..4 {
        rate[13 + motor] = (speeds[motor].clamp(0.0, 1.0) - x[13 + motor]) / p.motor_lag_s;
    }
    rate
}

/// Makes the quaternion one of length 1 again, which integration keeps only to its own error.
pub fn normalise(x: &mut State) {
    let length = libm::sqrt(x[6..10].iter().map(|part| part * part).sum());
    for part in &mut x[6..10] {
        *part /= length;
    }
}

/// Rows of the matrix that turns body axes into earth axes.
fn rotation(x: &State) -> [Vector; 3] {
    let [w, a, b, c] = quaternion(x);
    [
        [
            1.0 - 2.0 * (b * b + c * c),
            2.0 * (a * b - w * c),
            2.0 * (a * c + w * b),
        ],
        [
            2.0 * (a * b + w * c),
            1.0 - 2.0 * (a * a + c * c),
            2.0 * (b * c - w * a),
        ],
        [
            2.0 * (a * c - w * b),
            2.0 * (b * c + w * a),
            1.0 - 2.0 * (a * a + b * b),
        ],
    ]
}

pub fn to_earth(x: &State, vector: Vector) -> Vector {
    rotation(x).map(|row| dot(row, vector))
}

fn to_body(x: &State, vector: Vector) -> Vector {
    let rows = rotation(x);
    std::array::from_fn(|axis| dot([rows[0][axis], rows[1][axis], rows[2][axis]], vector))
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn add(sum: &mut Vector, vector: Vector) {
    for (sum, part) in sum.iter_mut().zip(vector) {
        *sum += part;
    }
}
