//! The crates of `examples`: a plant, a law and a link built outside the workspace.

use serde_json::Value;

use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{example, of_pendulum, shipped, test_example, workspace};

const SCENARIO: &str = "examples/own-plant/pendulum.toml";

/// Returns error and error rate of the closed loop in rad and rad/s, some time after they were `a` and `b`.
///
/// The law cancels gravity, which leaves `m l^2 e'' + (k_2 + c) e' + k_1 e = 0`: critically damped with w = 6 rad/s
/// for the defaults, so `e(t) = (a + (b + w a) t) exp(-w t)`.
fn closed_form(t: f64, [a, b]: [f64; 2]) -> [f64; 2] {
    const W: f64 = 6.0;
    let decay = libm::exp(-W * t);
    [
        (a + (b + W * a) * t) * decay,
        (b - W * (b + W * a) * t) * decay,
    ]
}

#[test]
fn an_external_plant_and_law_follow_the_closed_form() {
    let rig = Rig::new();
    let run = rig.run(&of_pendulum(SCENARIO)).expect(0);
    let recording = Recording::open(&run.recording());
    // From 0.2 rad at rest; at 1 s the reference angle steps by 0.3 rad.
    let [angle_rad, rate_radps] = closed_form(1.0, [0.2, 0.0]);
    let after_jump = [angle_rad - 0.3, rate_radps];
    for record in recording.records() {
        let time_s = record.step() as f64 / 1000.0;
        let [expected_rad, _] = if time_s <= 1.0 {
            closed_form(time_s, [0.2, 0.0])
        } else {
            let [error_rad, rate] = closed_form(time_s - 1.0, after_jump);
            [error_rad + 0.3, rate]
        };
        let found_rad = recording.value(&record, "truth.angle_rad");
        // The closed form ignores that the command is held for a millisecond.
        assert!(
            (found_rad - expected_rad).abs() < 1e-3,
            "at {time_s} s: {found_rad}"
        );
    }
}

#[test]
fn the_summary_names_external_programs() {
    let rig = Rig::new();
    let summary = rig.run(&of_pendulum(SCENARIO)).expect(0).summary();
    let name = |side: &str| summary[side]["binary"].as_str().expect("a path").to_owned();
    assert!(name("plant").ends_with("own-plant"));
    assert!(name("controller").ends_with("own-controller"));
    assert_eq!(summary["evidence"], "sil");
}

#[test]
fn a_pendulum_without_torque_falls_and_the_run_fails() {
    let rig = Rig::new();
    let shipped = shipped(SCENARIO);
    let gains = "[controller.state-feedback]\nangle_nm_per_rad = 9.0\n";
    assert!(shipped.contains(gains));
    let falling = rig.write("falling.toml", &shipped.replace(gains, ""));
    let arguments = of_pendulum(falling.display()) + " --set controller.law=hold";
    let run = rig.run(&arguments).expect(1);
    let reason = run.summary()["reason"]
        .as_str()
        .unwrap_or_default()
        .to_owned();
    assert!(reason.contains("angle_rad"), "{reason}");
}

#[test]
fn a_recording_contains_the_descriptions_of_external_programs() {
    let rig = Rig::new();
    let run = rig.run(&of_pendulum(SCENARIO)).expect(0);
    let attachments = Recording::open(&run.recording()).attachments();
    let described: Value =
        serde_json::from_str(&attachments["controller-description.json"]).expect("JSON");
    assert_eq!(described["laws"][0]["name"], "state-feedback");
    assert_eq!(described["laws"][0]["reference"][0]["unit"], "rad");
}

#[test]
fn an_external_fault_kind_works_live_and_follows_its_equation() {
    let rig = Rig::new();
    let plant = example("own-fault");
    let run = rig.start(&format!(
        "tests/scenarios/leakage.toml --set controller.law=pid --pause-at 0.5 --plant-bin {}",
        plant.display()
    ));
    rig.until_held_at(5000);
    let inject = "inject gear-play measured.actuator1_position_m 2e-4";
    let text = rig.in_session(inject).expect(0).stdout;
    assert!(text.contains("step 5000"), "{text}");
    rig.in_session("resume").expect(0);

    let recording = Recording::open(&run.finish().expect(0).recording());
    let (mut driven, mut stood_still) = (None, 0);
    for record in recording.records() {
        let driving = recording.value(&record, "sensed.actuator1_position_m");
        let result = recording.value(&record, "measured.actuator1_position_m");
        let expected = match driven {
            None => driving,
            Some(driven) if driving - 1e-4 > driven => driving - 1e-4,
            Some(driven) if driving + 1e-4 < driven => driving + 1e-4,
            Some(driven) => driven,
        };
        if record.step() >= 5000 {
            assert!((result - expected).abs() < 1e-15, "step {}", record.step());
            stood_still += u32::from(driven == Some(result));
            driven = Some(result);
        }
    }
    assert!(stood_still > 100, "{stood_still}");
}

#[test]
fn built_in_faults_apply_to_parameters_of_an_external_plant() {
    let rig = Rig::new();
    let fault = "\n[[faults]]\nkind = \"scale\"\nat_s = 0.5\n[[faults.effects]]\ntarget = \"parameter.mass_kg\"\nfactor = 2\n";
    let faulted = rig.write("heavy.toml", &(shipped(SCENARIO) + fault));
    let run = rig.run(&of_pendulum(faulted.display())).expect(0);
    let recording = Recording::open(&run.recording());
    let mass_kg = |record| recording.value(&record, "parameter.mass_kg");
    let masses: Vec<f64> = recording.records().map(mass_kg).collect();
    assert_eq!(masses[500], 2.0 * masses[499]);
}

#[test]
fn an_external_link_passes_the_conformance_suite() {
    let _rig = Rig::new();
    test_example("unix-socket-link");
}

#[test]
fn a_run_over_an_external_link_has_the_digest_of_shared_memory() {
    let rig = Rig::new();
    let scenario = "scenarios/spring-mass.toml";
    let expected = rig.run(&format!("{scenario} --no-record")).expect(0);
    let mut link = rig.command(example("unix-socket-link"));
    let output = link.arg(workspace().join(scenario)).output();
    let text = output.expect("it can be run").stdout;
    let expected = format!("digest {}\n", expected.digest());
    assert_eq!(String::from_utf8_lossy(&text), expected);
}
