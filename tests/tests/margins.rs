//! Margins of running loops, against exact discrete closed forms and python-control.

mod closed_form;
mod crossed;
mod modes;
mod refusals;
mod varying;

use std::process::Command;

use serde_json::Value;

use crate::support::harness::{Rig, text};
use crate::support::programs::{example, program, skip, workspace};
use crate::support::python::{python, succeeds};
use closed_form::{Complex, PERIOD_S, margins, pendulum, teaching, z};

const SPRING_MASS: &str = "scenarios/spring-mass.toml";
/// Twenty frequencies, to which the command adds those beside crossings.
const TWENTY: &[&str] = &["--frequencies", "0.5..400/20"];

/// Measures the loops of a scenario; the exit code must be 0.
fn measured(rig: &Rig, scenario: &str, further: &[&str]) -> Value {
    let arguments = [&["margins", scenario, "--json"], further].concat();
    rig.hil(&arguments).expect(0).json()
}

/// Returns frequency and L of each response.
fn responses(input: &Value) -> Vec<(f64, Complex)> {
    let all = input["responses"].as_array().expect("a list").iter();
    let all = all.map(|one| {
        let [hz, re, im] = [&one["frequency_hz"], &one["l"][0], &one["l"][1]].map(number);
        (hz, Complex(re, im))
    });
    all.collect()
}

#[track_caller]
fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

/// Compares each response with an expected loop, relative to its size.
#[track_caller]
fn assert_loop(input: &Value, expected: impl Fn(f64) -> Complex, tolerance: f64) {
    let all = responses(input);
    assert!(all.len() >= 20, "{} responses", all.len());
    for (hz, l) in all {
        let error = (l - expected(hz)).size() / expected(hz).size();
        assert!(
            error < tolerance,
            "{hz} Hz: {l:?}, not {:?}: {error:e}",
            expected(hz)
        );
    }
}

#[track_caller]
fn assert_near(actual: &Value, expected: f64, tolerance: f64) {
    let error = (number(actual) / expected - 1.0).abs();
    assert!(error < tolerance, "{actual}, not {expected}: {error:e}");
}

/// Writes the teaching scenario with a text added.
fn teaching_with(rig: &Rig, further: &str) -> String {
    let scenario = std::fs::read_to_string(workspace().join(SPRING_MASS)).expect("a scenario");
    let path = rig.write("loop.toml", &format!("{scenario}\n{further}"));
    text(&path).to_owned()
}

fn fault(kind: &str, at_s: f64, effect: &str) -> String {
    format!("[[faults]]\nkind = \"{kind}\"\nat_s = {at_s:?}\n[[faults.effects]]\n{effect}\n")
}

#[test]
fn the_loop_of_the_teaching_plant_is_that_of_its_closed_form() {
    let rig = Rig::new();
    let report = measured(&rig, SPRING_MASS, TWENTY);
    let input = &report["inputs"][0];
    assert_eq!(input["command"], "force_n");
    assert_loop(input, teaching, 1e-5);
    let expected = margins(teaching, [1.0, 20.0], [200.0, 300.0]);
    assert_near(&input["crossover_hz"], expected.crossover_hz, 1e-4);
    assert_near(&input["phase_margin_deg"], expected.phase_margin_deg, 1e-4);
    assert_near(&input["gain_margin_db"], expected.gain_margin_db, 1e-4);
    assert_near(&input["disc_margin"], expected.disc_margin, 1e-4);
    let delay_s = expected.phase_margin_deg / 360.0 / expected.crossover_hz;
    assert_near(&input["delay_margin_s"], delay_s, 1e-4);
    // The probe begins at 5 s, settles for a period of 4 s and is measured for three.
    assert_eq!(input["measured_s"], serde_json::json!([9.0, 21.0]));
    // Each figure lies in its interval, and a linear loop has narrow ones.
    for name in ["phase_margin_deg", "gain_margin_db", "disc_margin"] {
        let [low, high] = [0, 1].map(|end| number(&input["intervals"][name][end]));
        assert!(low - 1e-6 <= number(&input[name]) && number(&input[name]) <= high + 1e-6);
        assert!((high - low).abs() < 1e-4, "{name}: {low} to {high}");
    }
    for response in input["responses"].as_array().expect("a list") {
        assert!(number(&response["coherence"]) > 0.999_999, "{response}");
        assert!(number(&response["change"]) < 1e-5, "{response}");
    }
}

#[test]
fn two_processes_measure_the_same_numbers_as_one() {
    let rig = Rig::new();
    let one = measured(&rig, SPRING_MASS, TWENTY);
    let [plant, controller] = ["plant-process", "controller-process"].map(program);
    let programs = [
        "--plant-bin",
        text(&plant),
        "--controller-bin",
        text(&controller),
    ];
    let two = measured(&rig, SPRING_MASS, &[TWENTY, &programs[..]].concat());
    assert_eq!(one, two);
}

#[test]
fn late_messages_on_either_link_lower_the_phase_by_their_delay() {
    let rig = Rig::new();
    for (link, steps) in [("command", 5.0), ("sample", 5.0), ("command", 1.0)] {
        let effect = format!("target = \"link.{link}\"\nsteps = {steps}");
        let scenario = teaching_with(&rig, &fault("message-delay", 0.0, &effect));
        let report = measured(&rig, &scenario, TWENTY);
        let late = |hz| teaching(hz) * z(hz, -steps);
        assert_loop(&report["inputs"][0], late, 1e-8);
    }
}

#[test]
fn a_scaled_command_scales_the_loop() {
    let rig = Rig::new();
    let effect = "target = \"command.force_n\"\nfactor = 0.5";
    let scenario = teaching_with(&rig, &fault("scale", 0.0, effect));
    let report = measured(&rig, &scenario, TWENTY);
    let half = |hz| teaching(hz) * 0.5.into();
    assert_loop(&report["inputs"][0], half, 1e-8);
}

#[test]
fn the_lag_of_an_actuator_belongs_to_the_loop() {
    let rig = Rig::new();
    let actuator = "[[actuators]]\nsignal = \"force_n\"\nlag_hz = 20.0\n";
    let report = measured(&rig, &teaching_with(&rig, actuator), TWENTY);
    // First-order lag whose input is a line between two commands.
    let turned = std::f64::consts::TAU * 20.0 * PERIOD_S;
    let held = -libm::expm1(-turned);
    let ramp = 1.0 + libm::expm1(-turned) / turned;
    let lagged = |hz| {
        let before = z(hz, -1.0);
        let above = before * (held - ramp).into() + ramp.into();
        teaching(hz) * above / (Complex::from(1.0) - before * (1.0 - held).into())
    };
    assert_loop(&report["inputs"][0], lagged, 1e-8);
}

#[test]
fn the_noise_of_a_sensor_is_no_part_of_the_loop() {
    let rig = Rig::new();
    let sensor = "[[sensors]]\nsignal = \"position_m\"\nnoise_sigma = 1e-5\n";
    let report = measured(&rig, &teaching_with(&rig, sensor), TWENTY);
    // The same seed draws the same noise in every run, and its motion is subtracted.
    assert_loop(&report["inputs"][0], teaching, 1e-7);
}

#[test]
fn each_time_has_the_margins_of_the_faults_then() {
    let rig = Rig::new();
    let effect = "target = \"command.force_n\"\nfactor = 0.5";
    let further = "[[faults]]\nkind = \"message-delay\"\nat_s = 200.0\n\
                   [[faults.effects]]\ntarget = \"link.command\"\nsteps = 5\n";
    let faults = format!("{}{further}", fault("scale", 100.0, effect));
    let scenario = teaching_with(&rig, &faults);
    let longer = [TWENTY, &["--set", "run.duration_s=300"]].concat();
    let times = ["--at", "2", "--at", "110", "--at", "210"];
    let all = measured(&rig, &scenario, &[&longer[..], &times].concat());
    let half = |hz| teaching(hz) * 0.5.into();
    assert_loop(&all["inputs"][0], teaching, 1e-7);
    assert_loop(&all["inputs"][1], half, 1e-7);
    assert_loop(&all["inputs"][2], |hz| half(hz) * z(hz, -5.0), 1e-7);
    // One fault at a time, and none.
    let at = [&longer[..], &["--at", "210", "--fault"]].concat();
    let first = measured(&rig, &scenario, &[&at[..], &["1"]].concat());
    assert_loop(&first["inputs"][0], half, 1e-7);
    let second = measured(&rig, &scenario, &[&at[..], &["2"]].concat());
    let late = |hz| teaching(hz) * z(hz, -5.0);
    assert_loop(&second["inputs"][0], late, 1e-7);
    let none = measured(&rig, &scenario, &[&at[..], &["0"]].concat());
    assert_loop(&none["inputs"][0], teaching, 1e-7);
}

#[test]
fn the_loop_of_a_users_program_in_rust_is_that_of_its_closed_form() {
    let rig = Rig::new();
    let [plant, law] = ["own-plant", "own-controller"].map(example);
    let scenario = rig.write(
        "upright.toml",
        "schema = 1\nname = \"upright\"\nrun = { duration_s = 1.0, rate_hz = 1000 }\n\
         plant = { model = \"pendulum\", parameters = { initial_angle_rad = 0.0 } }\n\
         controller = { law = \"state-feedback\" }\n\
         [[stimuli]]\ntarget = \"angle_rad\"\nkind = \"step\"\nat_s = 0.5\nafter = 0.0\n",
    );
    let programs = ["--plant-bin", text(&plant), "--controller-bin", text(&law)];
    let probe = ["--amplitude", "1e-4"];
    let further = [TWENTY, &programs[..], &probe[..]].concat();
    let report = measured(&rig, text(&scenario), &further);
    assert_loop(&report["inputs"][0], pendulum, 1e-5);
}

#[test]
fn the_file_of_responses_has_those_of_the_report() {
    let rig = Rig::new();
    let path = rig.path("loop.csv");
    let report = measured(&rig, SPRING_MASS, &[TWENTY, &["-o", text(&path)]].concat());
    let table = std::fs::read_to_string(path).expect("a table");
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some(
            "command,at_s,frequency_hz,real,imaginary,gain_db,phase_deg,amplitude,coherence,change"
        )
    );
    let rows: Vec<(f64, Complex)> = lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells[..2], ["force_n", "5"]);
            let value = |place: usize| cells[place].parse::<f64>().expect("a number");
            (value(2), Complex(value(3), value(4)))
        })
        .collect();
    assert_eq!(rows, responses(&report["inputs"][0]));
}

#[test]
fn python_control_computes_the_same_margins() {
    let Some(python) = python("control, numpy") else {
        return skip("Python has no `control`", "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let report = measured(&rig, SPRING_MASS, &[]);
    let file = rig.write("margins.json", &report.to_string());
    let script = workspace().join("tests/python/judge_margins.py");
    let output = succeeds(Command::new(python).arg(script).arg(file));
    assert_eq!(output.matches("python-control").count(), 5, "{output}");
}
