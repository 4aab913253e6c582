//! The equations against closed forms and conserved quantities.

use plant_process::integrate::integrate;
use plant_process::plant::Plant as _;
use shared_types::time::Interval;

use crate::body::{self, Loads, State};
use crate::{Command, Parameters, Quad};

const G: f64 = 9.80665;

/// Returns a frame 100 m above the ground, at rest, level, with its motors off.
fn aloft() -> State {
    let mut x = [0.0; 17];
    x[2] = -100.0;
    x[6] = 1.0;
    x
}

/// Returns parameters without drag.
fn without_drag() -> Parameters {
    Parameters {
        drag_n_s_per_m: 0.0,
        ..Parameters::default()
    }
}

/// Integrates with constant commands in steps of a millisecond.
fn advance(parameters: &Parameters, x: &mut State, speeds: [f64; 4], milliseconds: u32) {
    for step in 0..milliseconds {
        let interval = Interval {
            start_s: f64::from(step) * 1e-3,
            length_s: 1e-3,
            substeps: 1,
        };
        integrate(x, &interval, |_, x| {
            body::derivative(parameters, x, &speeds)
        });
        body::normalise(x);
    }
}

fn assert_near(value: f64, expected: f64, tolerance: f64) {
    let error = (value - expected).abs();
    assert!(
        error <= tolerance,
        "{value}, not {expected}: off by {error}"
    );
}

/// Returns the speed of each motor at which their thrust carries the frame.
fn hover_speed(parameters: &Parameters) -> f64 {
    libm::sqrt(parameters.mass_kg * G / (4.0 * parameters.full_thrust_n))
}

#[test]
fn a_frame_without_drag_falls_freely_and_feels_no_force() {
    let (parameters, mut x) = (without_drag(), aloft());
    advance(&parameters, &mut x, [0.0; 4], 2000);
    assert_near(body::altitude_m(&x), 100.0 - G * 2.0 * 2.0 / 2.0, 1e-9);
    assert_near(body::velocity_mps(&x)[2], G * 2.0, 1e-9);
    assert_eq!(Loads::of(&parameters, &x).force_n, [0.0; 3]);
}

#[test]
fn drag_lets_a_fall_approach_its_terminal_velocity_exponentially() {
    let (p, mut x) = (Parameters::default(), aloft());
    advance(&p, &mut x, [0.0; 4], 3000);
    let terminal_mps = p.mass_kg * G / p.drag_n_s_per_m;
    let expected = terminal_mps * (1.0 - libm::exp(-p.drag_n_s_per_m / p.mass_kg * 3.0));
    assert_near(body::velocity_mps(&x)[2], expected, 1e-9);
}

#[test]
fn the_thrust_of_hover_speed_carries_the_frame() {
    let (p, mut x) = (Parameters::default(), aloft());
    let speed = hover_speed(&p);
    x[13..17].copy_from_slice(&[speed; 4]);
    let before = x;
    advance(&p, &mut x, [speed; 4], 5000);
    for (value, before) in x.into_iter().zip(before) {
        assert_near(value, before, 1e-9);
    }
    assert_near(Loads::of(&p, &x).force_n[2] / p.mass_kg, -G, 1e-12);
}

#[test]
fn a_motor_follows_its_command_as_a_lag_of_first_order() {
    let (p, mut x) = (Parameters::default(), aloft());
    advance(&p, &mut x, [1.0, 0.5, 0.0, 2.0], 45);
    let rise = 1.0 - libm::exp(-0.045 / p.motor_lag_s);
    for (speed, command) in x[13..17].iter().zip([1.0, 0.5, 0.0, 1.0]) {
        assert_near(*speed, command * rise, 1e-7);
    }
    let thrust_n = body::thrusts_n(&p, &x)[1];
    assert_near(thrust_n, p.full_thrust_n * 0.25 * rise * rise, 1e-6);
}

#[test]
fn a_weak_motor_gives_its_share_of_thrust() {
    let p = Parameters {
        motor3_thrust: 0.8,
        ..Parameters::default()
    };
    let mut x = aloft();
    x[13..17].copy_from_slice(&[0.5; 4]);
    let sound_n = p.full_thrust_n * 0.25;
    let expected = [sound_n, sound_n, 0.8 * sound_n, sound_n];
    for (thrust, expected) in body::thrusts_n(&p, &x).into_iter().zip(expected) {
        assert_near(thrust, expected, 1e-12);
    }
}

#[test]
fn each_motor_turns_the_frame_in_the_direction_of_a_quad_x() {
    // Roll right, nose up and nose right are positive.
    let directions = [
        [-1.0, -1.0, -1.0],
        [-1.0, 1.0, 1.0],
        [1.0, -1.0, 1.0],
        [1.0, 1.0, -1.0],
    ];
    let p = Parameters::default();
    for (motor, direction) in directions.into_iter().enumerate() {
        let mut x = aloft();
        x[13 + motor] = 1.0;
        let arms = [p.arm_m, p.arm_m, p.torque_per_thrust_m];
        let moment_nm = Loads::of(&p, &x).moment_nm;
        for axis in 0..3 {
            let expected = direction[axis] * arms[axis] * p.full_thrust_n;
            assert_near(moment_nm[axis], expected, 1e-12);
        }
    }
}

#[test]
fn a_free_symmetric_body_precesses_at_the_rate_of_euler() {
    let mut p = without_drag();
    p.inertia_y_kgm2 = p.inertia_x_kgm2;
    let mut x = aloft();
    let (spin, transverse) = (8.0, 1.5);
    x[10..13].copy_from_slice(&[transverse, 0.0, spin]);
    advance(&p, &mut x, [0.0; 4], 2000);
    let angle = (p.inertia_z_kgm2 - p.inertia_x_kgm2) / p.inertia_x_kgm2 * spin * 2.0;
    let [roll, pitch, yaw] = body::rates(&x);
    assert_near(roll, transverse * libm::cos(angle), 1e-8);
    assert_near(pitch, transverse * libm::sin(angle), 1e-8);
    assert_near(yaw, spin, 1e-12);
}

#[test]
fn a_free_tumbling_body_keeps_its_angular_momentum_and_energy() {
    let p = without_drag();
    let inertia = [p.inertia_x_kgm2, p.inertia_y_kgm2, p.inertia_z_kgm2];
    let momentum = |x: &State| {
        let rates = body::rates(x);
        body::to_earth(x, std::array::from_fn(|axis| inertia[axis] * rates[axis]))
    };
    let energy_j = |x: &State| -> f64 {
        let rates = body::rates(x);
        (0..3)
            .map(|axis| 0.5 * inertia[axis] * rates[axis] * rates[axis])
            .sum()
    };
    let mut x = aloft();
    // Mainly about the intermediate axis, where the motion is unstable.
    x[10..13].copy_from_slice(&[0.01, 12.0, 0.02]);
    let (momentum_before, energy_before) = (momentum(&x), energy_j(&x));
    let mut least_pitch_rate = f64::MAX;
    for _ in 0..4000 {
        advance(&p, &mut x, [0.0; 4], 1);
        if body::rates(&x)[1] < least_pitch_rate {
            least_pitch_rate = body::rates(&x)[1];
        }
    }
    assert!(
        least_pitch_rate < -11.0,
        "it turned over: {least_pitch_rate}"
    );
    assert_near(energy_j(&x), energy_before, 1e-8 * energy_before);
    let size = inertia[1] * 12.0;
    for (value, before) in momentum(&x).into_iter().zip(momentum_before) {
        assert_near(value, before, 1e-8 * size);
    }
}

#[test]
fn a_constant_turn_changes_the_heading_at_its_rate() {
    let (p, mut x) = (without_drag(), aloft());
    x[12] = 0.7;
    advance(&p, &mut x, [0.0; 4], 3000);
    let [roll, pitch, yaw] = body::attitude_rad(&x);
    assert_near(roll, 0.0, 1e-12);
    assert_near(pitch, 0.0, 1e-12);
    assert_near(yaw, 2.1, 1e-9);
}

#[test]
fn a_frame_on_the_ground_stays_at_rest_and_feels_its_weight() {
    let p = Parameters::default();
    let mut x = body::at_rest(&p);
    let before = x;
    advance(&p, &mut x, [0.0; 4], 3000);
    for (value, before) in x.into_iter().zip(before) {
        assert_near(value, before, 1e-12);
    }
    assert_near(Loads::of(&p, &x).force_n[2] / p.mass_kg, -G, 1e-9);
}

#[test]
fn a_tilted_frame_dropped_on_the_ground_comes_to_rest_level() {
    let p = Parameters::default();
    let mut x = aloft();
    x[2] = -0.3;
    x[6] = libm::cos(0.1);
    x[7] = libm::sin(0.1);
    advance(&p, &mut x, [0.0; 4], 4000);
    let [roll, pitch, _] = body::attitude_rad(&x);
    assert_near(roll, 0.0, 1e-6);
    assert_near(pitch, 0.0, 1e-6);
    assert_near(x[2], body::at_rest(&p)[2], 1e-6);
    for rate in body::rates(&x).into_iter().chain(body::velocity_mps(&x)) {
        assert_near(rate, 0.0, 1e-5);
    }
}

#[test]
fn pressure_follows_the_standard_atmosphere() {
    // ISO 2533, table 5: 89874.6 Pa at 1000 m.
    assert_near(
        body::pressure_pa(&Parameters::default(), 1000.0),
        89_874.6,
        0.5,
    );
}

#[test]
fn the_clock_of_the_sensors_is_the_simulated_time() {
    let mut quad = Quad::start(&Parameters::default()).expect("valid");
    assert_eq!(quad.measure().clock_s, 0.0);
    let off = Command {
        motor1: 0.0,
        motor2: 0.0,
        motor3: 0.0,
        motor4: 0.0,
    };
    let interval = Interval {
        start_s: 0.25,
        length_s: 1e-3,
        substeps: 1,
    };
    quad.advance(&interval, &off);
    assert_eq!(quad.measure().clock_s, 0.251);
}
