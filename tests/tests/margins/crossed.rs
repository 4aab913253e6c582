//! A plant in C with a zero in the right half plane and two coupled channels.

use std::f64::consts::TAU;
use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

use super::closed_form::{Complex, channel, margins};
use super::{assert_loop, assert_near, measured, number};
use crate::foreign::{CLEAN, compiled, has};
use crate::support::harness::{Rig, text};
use crate::support::programs::{skip, workspace};
use crate::support::python::{python, succeeds};

pub(super) const SOURCE: &str = "tests/tests/margins/crossed.c";
const PROBE: [&str; 4] = ["--amplitude", "1", "--frequencies", "0.2..50/40"];

/// Plant and law, compiled.
pub(super) fn programs(rig: &Rig) -> Option<[PathBuf; 2]> {
    has("cc").then(|| {
        let law = [CLEAN, &["-DLAW"]].concat();
        [
            compiled(rig, "cc", SOURCE, "crossed", CLEAN),
            compiled(rig, "cc", SOURCE, "crossed-law", &law),
        ]
    })
}

/// Writes a scenario with these gains and this coupling.
pub(super) fn scenario(rig: &Rig, gains: [f64; 2], coupling: f64, further: &str) -> PathBuf {
    let [first, second] = gains;
    rig.write(
        "crossed.toml",
        &format!(
            "schema = 1\nname = \"crossed\"\nrun = {{ duration_s = 1.0, rate_hz = 1000 }}\n\
             [plant]\nmodel = \"crossed\"\nparameters = {{ coupling = {coupling:?} }}\n\
             [controller]\nlaw = \"crossed-law\"\n[controller.crossed-law]\n\
             first_n_per_m = {first:?}\nsecond_n_per_m = {second:?}\n{further}"
        ),
    )
}

fn report(rig: &Rig, gains: [f64; 2], coupling: f64) -> Option<Value> {
    let [plant, law] = programs(rig)?;
    let scenario = scenario(rig, gains, coupling, "");
    let bins = ["--plant-bin", text(&plant), "--controller-bin", text(&law)];
    Some(measured(
        rig,
        text(&scenario),
        &[&PROBE[..], &bins].concat(),
    ))
}

#[test]
fn a_zero_in_the_right_half_plane_has_the_margins_of_its_closed_form() {
    let rig = Rig::new();
    let Some(report) = report(&rig, [2.0, 3.0], 0.0) else {
        return;
    };
    for (place, gain) in [2.0, 3.0].into_iter().enumerate() {
        let input = &report["inputs"][place];
        let l = |hz| channel(hz) * Complex::from(gain);
        assert_loop(input, l, 1e-6);
        let expected = margins(l, [0.2, 20.0], [0.2, 20.0]);
        assert_near(&input["crossover_hz"], expected.crossover_hz, 1e-4);
        assert_near(&input["phase_margin_deg"], expected.phase_margin_deg, 1e-4);
        assert_near(&input["gain_margin_db"], expected.gain_margin_db, 1e-4);
        // In continuous time 0.01 s^2 + (0.2 - 0.05 k) s + 1 + k is stable up to k = 4, where w^2 = 500; the hold costs
        // half a period.
        let hz = number(&input["phase_crossover_hz"]);
        assert!(
            (hz / (libm::sqrt(500.0) / TAU) - 1.0).abs() < 0.02,
            "{hz} Hz"
        );
        let most = gain * libm::pow(10.0, number(&input["gain_margin_db"]) / 20.0);
        assert!((most / 4.0 - 1.0).abs() < 0.03, "stable up to {most}");
    }
    // Without coupling, the least margin of both together is that of the worse one.
    let together = &report["together"][0];
    let least = number(&report["inputs"][1]["disc_margin"]);
    assert_near(&together["margin"], least, 1e-3);
    assert_near(&together["least_singular_value"], least, 1e-3);
}

#[test]
fn python_control_and_slycot_give_the_same_margins_of_two_coupled_loops() {
    let modules = "control, slycot, numpy";
    let Some(python) = python(modules) else {
        return skip(&format!("no Python has {modules}"), "HIL_TEST_PYTHON");
    };
    let (first, second, coupling) = (2.0, 1.5, 0.4);
    let rig = Rig::new();
    let Some(report) = report(&rig, [first, second], coupling) else {
        return;
    };
    let file = rig.write("margins.json", &report.to_string());
    let mut judge = Command::new(python);
    judge.arg(workspace().join("tests/python/judge_disk_margins.py"));
    judge.arg(file);
    judge.args([first, second, coupling].map(|number: f64| number.to_string()));
    println!("{}", succeeds(&mut judge));
    // Between two measured frequencies the least margin is below that of both.
    let together = &report["together"][0];
    let [low, high] = [0, 1].map(|end| number(&together["margin_interval"][end]));
    assert!(low < high, "{together}");
}

#[test]
fn loops_together_have_the_least_singular_value_of_their_closed_form() {
    let (gain, coupling) = (1.5, 0.4);
    let rig = Rig::new();
    let Some(report) = report(&rig, [gain, gain], coupling) else {
        return;
    };
    // L = k P [[1, c], [c, 1]]. With one loop closed, the other is det(I + L) / (1 + k P) - 1.
    let one = Complex::from(1.0);
    let alone = |hz| {
        let l = channel(hz) * gain.into();
        let crossed = l * coupling.into();
        ((one + l) * (one + l) - crossed * crossed) / (one + l) - one
    };
    for place in 0..2 {
        assert_loop(&report["inputs"][place], alone, 1e-6);
    }
    // L is normal, with eigenvalues k P (1 + c) and k P (1 - c): so are the singular values of I + L.
    let least = (0..100_000).map(|n| {
        let hz = 0.2 * libm::pow(250.0, f64::from(n) / 1e5);
        let l = channel(hz) * gain.into();
        let of = |factor: f64| (one + l * factor.into()).size();
        [1.0 + coupling, 1.0 - coupling].map(of)
    });
    let least = least.flatten().min_by(f64::total_cmp).expect("frequencies");
    let together = &report["together"][0];
    assert_near(&together["margin"], least, 1e-3);
    assert_near(&together["least_singular_value"], least, 1e-3);
    let [low, high] = [0, 1].map(|end| number(&together["gains_db"][end]));
    assert!(
        (low + 20.0 * libm::log10(1.0 + least)).abs() < 0.01,
        "{low} dB"
    );
    assert!(
        (high + 20.0 * libm::log10(1.0 - least)).abs() < 0.01,
        "{high} dB"
    );
    let phase_deg = 2.0 * libm::asin(0.5 * least).to_degrees();
    assert_near(&together["phase_deg"], phase_deg, 1e-3);
    // One loop at a time promises more than both together.
    let alone = number(&report["inputs"][0]["disc_margin"]);
    assert!(alone > 1.05 * least, "{alone} and {least}");
}
