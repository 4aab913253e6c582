//! Order of operations in a step of an FMU controller: set, step, read.

use super::Place;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::json;

use super::aliases::{accumulator, row, scenario};
use crate::support::fmus::entries_for_fmpy;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{skip, workspace};
use crate::support::python::python;

/// Proportional and integral gain of the controller.
const GAINS: [f64; 2] = [-0.25, -2.0];
const PERIOD_S: f64 = 0.01;

/// Describes the controller of `tests/fmus/pi.c`.
fn description(version: u32) -> String {
    let mut variables = String::new();
    for (reference, (name, role)) in (1..).zip([
        ("u", "causality=\"output\""),
        ("i", "causality=\"local\""),
        ("x", "causality=\"input\""),
        ("kp", "causality=\"parameter\" variability=\"fixed\""),
        ("ki", "causality=\"parameter\" variability=\"fixed\""),
    ]) {
        let start = match name {
            "u" | "i" => "",
            _ => " start=\"0\"",
        };
        let attributes = format!("name=\"{name}\" valueReference=\"{reference}\" {role}");
        variables += &match version {
            2 => format!("<ScalarVariable {attributes}><Real{start}/></ScalarVariable>"),
            _ => format!("<Float64 {attributes}{start}/>"),
        };
    }
    let (token, output) = match version {
        2 => (
            "guid",
            "<Outputs><Unknown index=\"1\" dependencies=\"3\"/></Outputs>",
        ),
        _ => (
            "instantiationToken",
            "<Output valueReference=\"1\" dependencies=\"3\"/>",
        ),
    };
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"{version}.0\" modelName=\"pi\" \
         {token}=\"pi\"><CoSimulation modelIdentifier=\"pi\"/><ModelVariables>{variables}</ModelVariables>\
         <ModelStructure>{output}</ModelStructure></fmiModelDescription>"
    )
}

/// Simulates the controller with FMPy's own loop: outputs at the start, then at the end of each step.
fn simulated(python: &Path, fmu: &Path, samples: &[f64]) -> Vec<f64> {
    let [kp, ki] = GAINS;
    let arguments = json!({ "samples": samples, "parameters": { "kp": kp, "ki": ki } });
    let mut simulate = Command::new(python);
    simulate.arg(workspace().join("tests/python/controller_fmu.py"));
    simulate.arg(fmu).args([&PERIOD_S.to_string(), "x", "u"]);
    let pipes = simulate.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut process = pipes.spawn().expect("Python");
    let stdin = process.stdin.take().expect("a pipe");
    serde_json::to_writer(stdin, &arguments).expect("written");
    let output = process.wait_with_output().expect("an end");
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn a_sampled_controller_answers_its_sample_and_a_continuous_one_leads_by_one_period() {
    for (version, options, lead) in [
        (2, &["-DSAMPLED"][..], 0),
        (3, &["-DSAMPLED"], 0),
        (2, &[], 1),
        (3, &[], 1),
    ] {
        let Some(place) = Place::new() else { return };
        let plant = [row("x", &[]), row("u", &[]), row("k", &[])];
        place.fmu("plant.fmu", &accumulator(version, &plant, &[]));
        let text = description(version).into_bytes();
        let fmu = place.fmu("law.fmu", &entries_for_fmpy("pi", version, text, options));
        let described = place.hil(&["describe", "law.fmu", "--as", "controller"]);
        described.expect(0).prints(&[
            "which reflect the sample of the same step, and the internal states lead by one period",
            "u on x",
        ]);

        let [kp, ki] = GAINS;
        let law =
            format!("[controller.pi]\nkp = {kp:?}\nki = {ki:?}\n[plant.parameters]\nk = 1.0\n");
        let text = scenario(&law).replace("law = \"accumulators\"", "law = \"pi\"");
        let run = place.run(&text, "").expect(0);
        let recording = Recording::open(&run.recording());
        let (x, u) = (
            recording.column("measured.x"),
            recording.column("command.u"),
        );
        // The last record has no command.
        let (x, u) = (&x[..x.len() - 1], &u[..u.len() - 1]);
        for step in 0..u.len() {
            let sum: f64 = x[..step + lead].iter().sum();
            let expected = kp * x[step] + ki * PERIOD_S * sum;
            let is_near = (u[step] - expected).abs() <= 1e-12 * (1.0 + expected.abs());
            assert!(
                is_near,
                "{version} {options:?} {step}: {} for {expected}",
                u[step]
            );
        }
        assert!(x.iter().any(|x| *x > 1.0), "{x:?}");

        let Some(python) = python("fmpy, numpy") else {
            skip("Python has no `fmpy`", "HIL_TEST_FMPY");
            continue;
        };
        // FMPy shows the result of a step at the end of the step: the command of a sample is a period earlier than
        // there. Its steps are differences of times, so they are not the period in every bit.
        let of_fmpy = simulated(&python, &fmu, x);
        assert_eq!(of_fmpy.len(), u.len() + 1);
        for (step, (u, expected)) in u.iter().zip(&of_fmpy[1..]).enumerate() {
            let is_near = (u - expected).abs() <= 1e-12 * (1.0 + expected.abs());
            assert!(is_near, "{version} {options:?} {step}: {u} for {expected}");
        }
    }
}
