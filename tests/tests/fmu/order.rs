//! The order of a step of an FMU as the controller: set, stepped, read.

use super::Place;
use super::aliases::{accumulator, row, scenario};
use crate::support::fmus::entries;
use crate::support::mcap_reader::Recording;

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

#[test]
fn a_sampled_controller_answers_its_sample_and_a_continuous_one_leads_by_a_period() {
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
        place.fmu("law.fmu", &entries("pi", version, text, options));
        let described = place.hil(&["describe", "law.fmu", "--as", "controller"]);
        described.expect(0).prints(&[
            "they show the sample of the same step, and the inner states lead by a period",
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
        for step in 0..u.len() - 1 {
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
    }
}
