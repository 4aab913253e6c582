//! Linear models of FMUs from their directional derivatives, against closed forms.

use serde_json::Value;

use super::{Place, scenario};
use crate::support::fmus::{Entries, entries, reference};
use crate::support::mcap_reader::Recording;

/// Angle with which the swing begins.
const ANGLE: f64 = 0.6;

/// Returns the swing, which does as its description says unless the options take its derivatives away.
fn swing(version: u32, provides: bool, options: &[&str]) -> Entries {
    let flag = match (provides, version) {
        (false, _) => "",
        (true, 2) => " providesDirectionalDerivative=\"true\"",
        (true, _) => " providesDirectionalDerivatives=\"true\"",
    };
    let rows = [
        ("angle_rad", "rad", "output"),
        ("rate_radps", "rad/s", "output"),
        ("der_angle", "rad/s", "local"),
        ("der_rate", "rad/s2", "local"),
        ("sine", "1", "output"),
        ("torque_nm", "N.m", "input"),
    ];
    let mut variables = String::new();
    for (reference, (name, _, causality)) in (1..).zip(rows) {
        let start = match causality {
            "input" => " start=\"0\"",
            _ => "",
        };
        let derivative = match name {
            "der_angle" => " derivative=\"1\"",
            "der_rate" => " derivative=\"2\"",
            _ => "",
        };
        let both = format!(
            "name=\"{name}\" valueReference=\"{reference}\" causality=\"{causality}\" variability=\"continuous\""
        );
        variables += &match version {
            2 => format!("<ScalarVariable {both}><Real{start}{derivative}/></ScalarVariable>"),
            _ => format!("<Float64 {both}{start}{derivative}/>"),
        };
    }
    let structure = match version {
        2 => {
            "<Outputs><Unknown index=\"1\"/><Unknown index=\"2\"/><Unknown index=\"5\"/></Outputs><Derivatives><Unknown index=\"3\"/><Unknown index=\"4\"/></Derivatives>"
        }
        _ => {
            "<Output valueReference=\"1\"/><Output valueReference=\"2\"/><Output valueReference=\"5\"/><ContinuousStateDerivative valueReference=\"3\"/><ContinuousStateDerivative valueReference=\"4\"/>"
        }
    };
    let token = match version {
        2 => "guid",
        _ => "instantiationToken",
    };
    let description = format!(
        "<?xml version=\"1.0\"?><fmiModelDescription fmiVersion=\"{version}.0\" modelName=\"swing\" {token}=\"swing\"><CoSimulation modelIdentifier=\"swing\" canHandleVariableCommunicationStepSize=\"true\"{flag}/><ModelVariables>{variables}</ModelVariables><ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    );
    entries("swing", version, description.into_bytes(), options)
}

fn matrix(model: &Value, kind: &str, name: &str) -> Vec<Vec<f64>> {
    serde_json::from_value(model[kind][name].clone()).expect("a matrix")
}

#[track_caller]
fn assert_near(actual: &[Vec<f64>], expected: &[&[f64]], tolerance: f64) {
    assert_eq!(actual.len(), expected.len(), "{actual:?}");
    for (row, expected) in actual.iter().zip(expected) {
        assert_eq!(row.len(), expected.len(), "{actual:?}");
        for (value, expected) in row.iter().zip(*expected) {
            let off = (value - expected).abs();
            assert!(
                off <= tolerance,
                "{actual:?}, not {expected}: off by {off:e}"
            );
        }
    }
}

/// Writes a scenario and returns the words that linearise its plant.
fn linearise<'a>(scenario: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["linearise", scenario, "--of", "plant", "--json"], more].concat()
}

#[test]
fn the_reference_oscillator_has_its_jacobian_in_both_versions() {
    let Some(place) = Place::new() else { return };
    for version in [2, 3] {
        place.fmu("v.fmu", &reference("VanDerPol", version));
        let text = scenario("VanDerPol", "v.fmu", 100.0, 400.0);
        place.rig.write("v.toml", &text);
        for at in ["0", "1.5"] {
            let model = place
                .hil(&linearise("v.toml", &["--at", at]))
                .expect(0)
                .json();
            let value = |place: usize| model["states"][place]["value"].as_f64().expect("a number");
            let (x0, x1) = (value(0), value(1));
            assert_eq!(model["states"][0]["name"], "x0");
            assert_eq!(model["derivatives"], "directional");
            if at == "0" {
                assert_eq!((x0, x1), (2.0, 0.0));
            }
            // x0' = x1, x1' = mu (1 - x0^2) x1 - x0 with mu = 1.
            let jacobian = [[0.0, 1.0], [-2.0 * x0 * x1 - 1.0, 1.0 - x0 * x0]];
            let rows = [&jacobian[0][..], &jacobian[1]];
            assert_near(&matrix(&model, "continuous", "A"), &rows, 0.0);
            assert_near(
                &matrix(&model, "discrete", "C"),
                &[&[1.0, 0.0], &[0.0, 1.0]],
                0.0,
            );
            // det exp(A T) = exp(T tr A).
            let a = matrix(&model, "discrete", "A");
            let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
            let expected = libm::exp(0.01 * jacobian[1][1]);
            assert!(
                (determinant - expected).abs() < 1e-14,
                "{determinant} {expected}"
            );
        }
    }
}

#[test]
fn an_fmu_with_an_input_has_all_four_matrices() {
    let Some(place) = Place::new() else { return };
    for version in [2, 3] {
        place.fmu("s.fmu", &swing(version, true, &[]));
        place
            .rig
            .write("s.toml", &scenario("swing", "s.fmu", 100.0, 10.0));
        let model = place.hil(&linearise("s.toml", &[])).expect(0).json();
        let (c, stiffness) = (libm::cos(ANGLE), 3.0 * libm::cos(ANGLE));
        let rows: [&[f64]; 2] = [&[0.0, 1.0], &[-stiffness, -0.8]];
        assert_near(&matrix(&model, "continuous", "A"), &rows, 1e-15);
        assert_near(&matrix(&model, "continuous", "B"), &[&[0.0], &[2.0]], 0.0);
        let outputs: [&[f64]; 3] = [&[1.0, 0.0], &[0.0, 1.0], &[c, 0.0]];
        assert_near(&matrix(&model, "discrete", "C"), &outputs, 1e-15);
        assert_near(
            &matrix(&model, "discrete", "D"),
            &[&[0.0], &[0.0], &[0.5]],
            0.0,
        );
        // exp(A t) of a damped oscillator in closed form, with d = 0.4 and w^2 = stiffness - d^2.
        let (t, d) = (0.01, 0.4);
        let w = libm::sqrt(stiffness - d * d);
        let (decay, cos, sin) = (libm::exp(-d * t), libm::cos(w * t), libm::sin(w * t) / w);
        let first = [decay * (cos + d * sin), decay * sin];
        let second = [-stiffness * decay * sin, decay * (cos - d * sin)];
        assert_near(&matrix(&model, "discrete", "A"), &[&first, &second], 1e-14);
        let held = [
            2.0 * (1.0 - first[0]) / stiffness,
            -2.0 * second[0] / stiffness,
        ];
        assert_near(
            &matrix(&model, "discrete", "B"),
            &[&held[..1], &held[1..]],
            1e-14,
        );
    }
}

#[test]
fn an_fmu_that_cannot_be_linearised_is_refused_by_name() {
    let Some(place) = Place::new() else { return };
    let write = |fmu: &Entries| {
        place.fmu("s.fmu", fmu);
        place
            .rig
            .write("s.toml", &scenario("swing", "s.fmu", 100.0, 10.0));
    };
    write(&swing(2, false, &[]));
    let refused = place.hil(&linearise("s.toml", &[])).expect(1);
    refused.says(&["plant `swing` is an FMU that provides no directional derivatives"]);
    write(&swing(3, true, &["-DWITHOUT_DERIVATIVES"]));
    place
        .hil(&linearise("s.toml", &[]))
        .expect(1)
        .says(&["GetDirectionalDerivative"]);
    write(&swing(3, true, &[]));
    place.hil(&["trim", "s.toml"]).expect(1).says(&[
        "plant `swing` is an FMU",
        "no equilibrium can be solved for",
    ]);
    // It runs all the same, and saves no state.
    place
        .hil(&linearise("s.toml", &["--at", "0.05"]))
        .expect(2)
        .says(&["state"]);
}

/// Returns the PI controller of `tests/fmus/differentiable.c` as a law of the spring-mass plant.
fn differentiable() -> Entries {
    let rows = [
        (
            "force_n",
            "causality=\"output\" variability=\"continuous\"",
            " unit=\"N\"",
        ),
        ("i", "causality=\"local\" variability=\"continuous\"", ""),
        (
            "der_i",
            "causality=\"local\" variability=\"continuous\"",
            " derivative=\"2\"",
        ),
        (
            "position_m",
            "causality=\"input\" variability=\"continuous\"",
            " start=\"0\" unit=\"m\"",
        ),
        (
            "reference_position_m",
            "causality=\"input\" variability=\"continuous\"",
            " start=\"0\" unit=\"m\"",
        ),
    ];
    let rows = (1..).zip(rows).map(|(reference, (name, role, real))| {
        format!("<ScalarVariable name=\"{name}\" valueReference=\"{reference}\" {role}><Real{real}/></ScalarVariable>")
    });
    let description = format!(
        "<?xml version=\"1.0\"?><fmiModelDescription fmiVersion=\"2.0\" modelName=\"pi\" guid=\"differentiable\"><CoSimulation modelIdentifier=\"differentiable\" canHandleVariableCommunicationStepSize=\"true\" canGetAndSetFMUstate=\"true\" canSerializeFMUstate=\"true\" providesDirectionalDerivative=\"true\"/><UnitDefinitions><Unit name=\"m\"><BaseUnit m=\"1\"/></Unit><Unit name=\"N\"><BaseUnit kg=\"1\" m=\"1\" s=\"-2\"/></Unit></UnitDefinitions><ModelVariables>{}</ModelVariables><ModelStructure><Outputs><Unknown index=\"1\"/></Outputs><Derivatives><Unknown index=\"3\"/></Derivatives></ModelStructure></fmiModelDescription>",
        rows.collect::<String>()
    );
    entries("differentiable", 2, description.into_bytes(), &[])
}

#[test]
fn a_law_in_an_fmu_answers_a_sample_by_the_state_after_its_step() {
    let Some(place) = Place::new() else { return };
    place.fmu("law.fmu", &differentiable());
    let scenario = "schema = 1\nname = \"law\"\n[run]\nduration_s = 0.5\nrate_hz = 100\n[plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"differentiable\"\nprogram = \"law.fmu\"\n[[stimuli]]\ntarget = \"position_m\"\nkind = \"step\"\nat_s = 0.1\nafter = 0.01\n";
    place.rig.write("l.toml", scenario);
    let of = |part: &str| {
        let words = ["linearise", "l.toml", "--of", part, "--at", "0.3", "--json"];
        place.hil(&words).expect(0).json()
    };
    let law = of("law");
    let names = |list: &str| {
        let all = law[list].as_array().expect("a list").iter();
        let all = all.map(|one| one["name"].as_str().expect("a name").to_owned());
        all.collect::<Vec<_>>()
    };
    assert_eq!(
        names("inputs"),
        ["measured.position_m", "reference.position_m"]
    );
    assert_eq!(
        (names("states"), names("outputs")),
        (vec!["i".into()], vec!["force_n".into()])
    );
    // i(k+1) = i + 50 T e and u(k) = 40 e + i(k+1), with T = 0.01 s.
    assert_near(&matrix(&law, "discrete", "A"), &[&[1.0]], 1e-15);
    assert_near(&matrix(&law, "discrete", "B"), &[&[-0.5, 0.5]], 1e-15);
    assert_near(&matrix(&law, "discrete", "C"), &[&[1.0]], 1e-15);
    assert_near(&matrix(&law, "discrete", "D"), &[&[-40.5, 40.5]], 1e-13);
    assert_near(&matrix(&law, "continuous", "A"), &[&[0.0]], 0.0);
    assert_eq!(law["derivatives"], "directional");

    // The run itself judges the loop: a step of the reference by 0.01 moves it linearly from rest.
    let model = of("loop");
    let [a, b, c] = ["A", "B", "C"].map(|name| matrix(&model, "discrete", name));
    let d = matrix(&model, "discrete", "D");
    let run = place.run(scenario, "").expect(0);
    let recording = Recording::open(&run.recording());
    let (reference, force) = (
        recording.column("reference.position_m"),
        recording.column("command.force_n"),
    );
    let force_row = 2;
    let mut x = vec![0.0; a.len()];
    for step in 0..force.len() - 1 {
        let u = reference[step];
        let row = |c: &[f64], x: &[f64]| c.iter().zip(x).map(|(c, x)| c * x).sum::<f64>();
        let expected = row(&c[force_row], &x) + d[force_row][0] * u;
        let off = (force[step] - expected).abs();
        assert!(off < 1e-9, "{step}: {} for {expected}", force[step]);
        x = a
            .iter()
            .zip(&b)
            .map(|(a, b)| row(a, &x) + b[0] * u)
            .collect();
    }
}
