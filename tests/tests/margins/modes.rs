//! Modes between the first frequencies, against the exact closed form.

use super::closed_form::{Complex, PERIOD_S, z};
use super::{assert_near, measured, number, teaching_with};
use crate::support::harness::Rig;

/// Damped natural frequency and decay of a second-order lag.
const LAG_HZ: f64 = 193.0;
const DAMPING: f64 = 0.02;

/// Returns the gain of the teaching plant with damping 20 under a `pid` with 200, 400 and 36, behind a hold, four steps
/// of dead time and a sensor with a lag of second order, by the map of both over a step.
///
/// The lag takes the position as a line between two samples.
fn loop_with_mode(hz: f64) -> Complex {
    let z1 = z(hz, 1.0);
    // m = 1, c = 20, k = 100: a double pole at -10.
    let h = PERIOD_S;
    let e = libm::exp(-10.0 * h);
    let b1 = 0.01 * (1.0 - e * (1.0 + 10.0 * h));
    let b2 = 0.01 * e * (e - 1.0 + 10.0 * h);
    let below = z(hz, 2.0) - z1 * (2.0 * e).into() + (e * e).into();
    let plant = (z1 * b1.into() + b2.into()) / below;
    let integral = (z1 + 1.0.into()) / (z1 - 1.0.into()) * (0.5 * h).into();
    let derivative = (z1 - 1.0.into()) / (z1 * h.into());
    let law = Complex::from(200.0) + integral * 400.0.into() + derivative * 36.0.into();
    plant * law * z(hz, -4.0) * lag(hz)
}

/// Second-order lag `w^2 / (s^2 + 2 d w s + w^2)` whose input is a line between samples: the response to a ramp, of
/// which the second difference is taken.
fn lag(hz: f64) -> Complex {
    let w = std::f64::consts::TAU * LAG_HZ;
    let (sigma, damped) = (DAMPING * w, w * libm::sqrt(1.0 - DAMPING * DAMPING));
    // Response to a unit ramp: t - 2d/w + e^(-sigma t) (2d/w cos + (2d^2 - 1)/damped sin), damped = w sqrt(1 - d^2).
    let (sin, cos) = libm::sincos(damped * PERIOD_S);
    let alpha = libm::exp(-sigma * PERIOD_S);
    let constant = 2.0 * DAMPING / w;
    let sine = (2.0 * DAMPING * DAMPING - 1.0) / damped;
    let z1 = z(hz, 1.0);
    let below = z(hz, 2.0) - z1 * (2.0 * alpha * cos).into() + (alpha * alpha).into();
    // z-transforms of t, 1, alpha^n cos and alpha^n sin.
    let one = Complex::from(1.0);
    let ramp = z1 * PERIOD_S.into() / ((z1 - one) * (z1 - one));
    let step = z1 / (z1 - one);
    let cosine = z1 * (z1 - (alpha * cos).into()) / below;
    let sines = z1 * (alpha * sin).into() / below;
    let response = ramp - step * constant.into() + cosine * constant.into() + sines * sine.into();
    response * (z1 - one) * (z1 - one) / (z1 * PERIOD_S.into())
}

#[test]
fn a_mode_between_two_frequencies_decides_about_the_gain_margin() {
    let rig = Rig::new();
    let further = "[[sensors]]\nsignal = \"position_m\"\nlag_hz = 193.0\nlag_damping = 0.02\n\
                   [[actuators]]\nsignal = \"force_n\"\ndead_time_s = 0.004\n";
    let scenario = teaching_with(&rig, further);
    let settings = [
        "--at",
        "40",
        "--set",
        "controller.pid.proportional_n_per_m=200",
        "--set",
        "controller.pid.integral_n_per_m_s=400",
        "--set",
        "controller.pid.derivative_n_s_per_m=36",
        "--set",
        "plant.parameters.damping_n_s_per_m=20",
    ];
    // The largest gain at a phase of -180 degrees near the mode, by its closed form.
    let frequencies = (0..400_000_u32).map(|n| 150.0 + 2e-4 * f64::from(n));
    let all: Vec<Complex> = frequencies.map(loop_with_mode).collect();
    let crossings = all.windows(2).filter(|pair| {
        pair[0].0 < 0.0 && pair[1].0 < 0.0 && (pair[0].1 > 0.0) != (pair[1].1 > 0.0)
    });
    let sizes = crossings.map(|pair| pair[0].size());
    let largest = sizes.max_by(f64::total_cmp).expect("a crossing");
    let expected_db = -20.0 * libm::log10(largest);
    assert!((expected_db - 5.09).abs() < 0.01, "{expected_db} dB");
    for count in [&[][..], &["--frequencies", "0.2..450/20"]] {
        let report = measured(&rig, &scenario, &[&settings[..], count].concat());
        let input = &report["inputs"][0];
        assert_near(&input["gain_margin_db"], expected_db, 1e-3);
        let hz = number(&input["phase_crossover_hz"]);
        assert!((hz - 193.8).abs() < 0.1, "{hz} Hz");
    }
}
