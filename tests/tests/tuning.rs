//! Values changed during a run: at the announced step, all or none, and reproducible from the recording.

use std::time::Duration;

use hil_session::live::ask;
use hil_session::session::SessionInfo;
use serde_json::{Value, json};
use shared_types::live::{ChangeRequest, NewValue, Request, Response};
use shared_types::random::RandomStream;

use crate::support::harness::{Rig, Run, text};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

const SPRING: &str = "scenarios/spring-mass.toml";

fn changed(rig: &Rig, words: &str) -> Value {
    rig.in_session(&format!("set {words} --json"))
        .expect(0)
        .json()
}

/// Repeats the run in every way: by rerun, from the scenario made of it in both links, and by replay.
fn repeats(rig: &Rig, run: &Run) {
    let folder = run.folder.display().to_string();
    let again = rig.rerun(&run.folder, &[]).expect(0).folder;
    rig.hil(&["compare", &folder, text(&again)]).expect(0);
    let written = rig.path("written.toml").display().to_string();
    rig.hil(&["scenario", "from", &folder, "-o", &written])
        .expect(0);
    let from = rig.run(&written).expect(0);
    assert_eq!(from.digest(), run.digest());
    let in_process = rig.run(&format!("{written} --link in-process")).expect(0);
    assert_eq!(in_process.digest(), run.digest());
    rig.hil(&["replay", &folder]).expect(0);
    rig.hil(&["replay", &folder, "--link", "in-process"])
        .expect(0);
}

#[test]
fn keys_change_together_at_the_announced_step_and_repetitions_agree() {
    let rig = Rig::new();
    let plain = rig.run(SPRING).expect(0).digest();
    let run = rig.start(&format!("{SPRING} --pause-at 1"));
    rig.until_held_at(1000);
    let output = changed(
        &rig,
        "controller.pid.proportional_n_per_m=600 plant.parameters.mass_kg=1.2 reference.position_m=0.02",
    );
    assert_eq!(
        output,
        json!({"response": "changed", "id": 1, "step": 1000, "at_s": 1.0, "ramp_steps": 0, "clear": [], "set": [
            {"key": "controller.pid.proportional_n_per_m", "unit": "N/m", "value": 600.0},
            {"key": "plant.parameters.mass_kg", "unit": "kg", "value": 1.2},
            {"key": "reference.position_m", "unit": "m", "value": 0.02},
        ]})
    );
    // A second change at the same step while paused; and one that waits.
    let second = changed(&rig, "controller.pid.integral_n_per_m_s=1500 --ramp 300ms");
    assert_eq!(
        (&second["id"], &second["step"], &second["ramp_steps"]),
        (&json!(2), &json!(1000), &json!(300))
    );
    let later = changed(&rig, "reference.position_m=0 --ramp 1s --at 2.0005");
    assert_eq!((&later["id"], &later["step"]), (&json!(3), &json!(2001)));
    let cleared = changed(&rig, "--clear reference.position_m --at 3.2");
    assert_eq!(cleared["clear"], json!(["reference.position_m"]));
    let output = rig
        .in_session("get --tunable --json plant.parameters.mass_kg")
        .expect(0)
        .json();
    assert_eq!(
        output["values"][0]["value"], 1.2,
        "it begins with the next step"
    );
    rig.in_session("step 10").expect(0);
    let report = rig.in_session("get --tunable --json").expect(0).json();
    let value = |key: &str| {
        let values = report["values"].as_array().expect("a list");
        values
            .iter()
            .find(|one| one["key"] == key)
            .expect("there")
            .clone()
    };
    assert_eq!(value("plant.parameters.mass_kg")["value"], 1.2);
    assert_eq!(value("plant.parameters.mass_kg")["original"], 1.0);
    let integral = value("controller.pid.integral_n_per_m_s");
    assert_eq!(
        (&integral["target"], &integral["until_step"]),
        (&json!(1500.0), &json!(1300))
    );
    assert_eq!(integral["value"], 2000.0 - 500.0 * 10.0 / 300.0);
    assert_eq!(report["waiting"].as_array().map(Vec::len), Some(2));
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    assert_ne!(run.digest(), plain);
    let changes = &run.summary()["changes"];
    assert_eq!(changes.as_array().map(Vec::len), Some(4));
    assert_eq!(
        (&changes[0]["step"], &changes[0]["live"]),
        (&json!(1000), &json!(true))
    );

    let recording = Recording::open(&run.recording());
    let steps: Vec<&Value> = (recording.events.iter())
        .filter(|event| event["event"] == "change")
        .map(|event| &event["step"])
        .collect();
    assert_eq!(json!(steps), json!([1000, 1000, 2001, 3200]));
    let reference = recording.column("reference.position_m");
    let expected = [
        (999, 0.01),
        (1000, 0.02),
        (2001, 0.02),
        (2501, 0.01),
        (3001, 0.0),
        (3200, 0.01),
    ];
    for (step, message) in expected {
        assert!(
            (reference[step] - message).abs() < 1e-12,
            "{step}: {}",
            reference[step]
        );
    }
    repeats(&rig, &run);

    let page = rig.path("report.html").display().to_string();
    let folder = run.folder.display().to_string();
    rig.hil(&["report", &folder, "-o", &page]).expect(0);
    let page = std::fs::read_to_string(page).expect("there");
    assert!(
        page.contains("change 1, step 1000, 1 s: controller.pid.proportional_n_per_m = 600 N/m")
    );
}

#[test]
fn invalid_changes_are_refused_by_name_and_change_nothing() {
    let rig = Rig::new();
    let plain = rig.run(SPRING).expect(0).digest();
    let run = rig.start(&format!("{SPRING} --pause-at 1"));
    rig.until_held_at(1000);
    #[rustfmt::skip] // a table
    let cases = [
        ("plant.parameters.mas_kg=1", "plant.parameters.mass_kg"),
        ("controller.pid.proportional_n_per=1", "controller.pid.proportional_n_per_m"),
        ("controller.nrsc.x=1", "there is no"),
        ("plant.parameters.initial_position_m=0.1", "cannot be changed during the run"),
        ("plant.parameters.mass_kg=0", "out of range"),
        ("plant.parameters.mass_kg=nan", "not a number"),
        ("plant.parameters.mass_kg=1 plant.parameters.mass_kg=2", "given twice"),
        ("plant.parameters.mass_kg=2 reference.position_m=inf", "out of range"),
        ("plant.parameters.mass_kg=2 --at 0.5", "is past"),
        ("plant.parameters.mass_kg=2 --at 5", "the run ends at 5 s"),
        ("controller.pid.command_limit_n=inf --ramp 1s", "along a ramp"),
        ("--clear reference.velocity_mps", "has no stimulus"),
        ("--clear reference.position_m --ramp 1s", "a ramp needs an end value"),
    ];
    for (words, why) in cases {
        rig.in_session(&format!("set {words}"))
            .expect(2)
            .says(&[why]);
    }
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    assert_eq!(run.digest(), plain);
    assert_eq!(run.summary()["changes"], json!([]));
    rig.in_session("set plant.parameters.mass_kg=1")
        .expect(2)
        .says(&["no session"]);
}

#[test]
fn a_law_judges_combinations_of_its_parameters() {
    for link in ["iceoryx2", "in-process"] {
        let rig = Rig::new();
        let run = rig.start(&format!(
            "tests/scenarios/leakage.toml --set controller.law=nrsc --pause-at 0.1 --link {link}"
        ));
        rig.until_held_at(1000);
        let bound = "controller.nrsc.disturbance_bound_n_per_s2=2e9";
        rig.in_session(&format!("set {bound}"))
            .expect(2)
            .says(&["eq. 48", "the controller"]);
        let both = format!("set {bound} controller.nrsc.disturbance_weight_n2_per_s4=5e18");
        rig.in_session(&both).expect(0);
        rig.in_session("resume").expect(0);
        let run = run.finish().expect(0);
        let changes = &run.summary()["changes"];
        assert_eq!(changes[0]["set"].as_array().map(Vec::len), Some(4));
    }
}

#[test]
fn a_fault_acts_on_the_changed_base_value() {
    let rig = Rig::new();
    let scenario = shipped(SPRING)
        + "\n[[faults]]\nkind = \"stiffness-loss\"\nat_s = 1.0\nend_s = 3.0\n[[faults.effects]]\nfactor = 0.5\n\
           \n[[changes]]\nat_s = 2.0\nset.plant.parameters.stiffness_n_per_m = 60.0\n\
           \n[[changes]]\nat_s = 3.2\nramp_s = 0.2\n[changes.set]\nplant.parameters.stiffness_n_per_m = 80.0\n";
    let path = rig.write("base.toml", &scenario).display().to_string();
    let run = rig.run(&path).expect(0);
    let stiffness = Recording::open(&run.recording()).column("parameter.stiffness_n_per_m");
    let expected = [
        (999, 100.0),
        (1000, 50.0),
        (1999, 50.0),
        (2000, 30.0),
        (2999, 30.0),
        (3000, 60.0),
    ];
    for (step, expected) in expected
        .into_iter()
        .chain([(3200, 60.0), (3300, 70.0), (3400, 80.0)])
    {
        assert_eq!(stiffness[step], expected, "{step}");
    }
    repeats(&rig, &run);
    let wrong = scenario.replace("stiffness_n_per_m = 80.0", "stifness_n_per_m = 80.0");
    let path = rig.write("wrong.toml", &wrong).display().to_string();
    rig.run(&path)
        .expect(2)
        .says(&["wrong.toml:", "plant.parameters.stiffness_n_per_m"]);
}

#[test]
fn random_changes_at_full_speed_take_hold_at_the_announced_steps() {
    let rig = Rig::new();
    let run = rig.start(&format!(
        "{SPRING} --set run.duration_s=2000 --pause-at 0.001"
    ));
    rig.until_held_at(1);
    let session = SessionInfo::read(&rig.session_folder()).expect("it runs");
    let asked =
        |request: &Request| ask(&session, request, Duration::from_secs(60)).expect("answered");
    let keys = [
        ("controller.pid.proportional_n_per_m", 200.0, 400.0),
        ("controller.pid.integral_n_per_m_s", 1000.0, 3000.0),
        ("controller.pid.derivative_n_s_per_m", 20.0, 40.0),
        ("plant.parameters.mass_kg", 0.5, 2.0),
        ("plant.parameters.damping_n_s_per_m", 1.0, 3.0),
        ("reference.position_m", -0.02, 0.02),
    ];
    asked(&Request::Resume);
    let mut random = RandomStream::new(1, "changes");
    let mut output = Vec::new();
    for _ in 0..1000 {
        let (key, low, high) = keys[(random.uniform() * keys.len() as f64) as usize];
        let value = low + (high - low) * random.uniform();
        let request = Request::Set(ChangeRequest {
            set: vec![NewValue {
                key: key.into(),
                value,
            }],
            ramp_s: (random.uniform() < 0.3).then_some(0.05),
            ..ChangeRequest::default()
        });
        match asked(&request) {
            Response::Changed(changed) => output.push((changed.step, changed.set[0].clone())),
            // A run that is over accepts none.
            other => panic!("{other:?} after {}", output.len()),
        }
    }
    run.signal(rustix::process::Signal::INT);
    let run = run.finish();
    let recording = Recording::open(&run.recording());
    let taken: Vec<(u64, Value)> = (recording.events.iter())
        .filter(|event| event["event"] == "change")
        .map(|event| {
            (
                event["step"].as_u64().expect("a step"),
                event["set"][0].clone(),
            )
        })
        .collect();
    assert_eq!(taken.len(), output.len());
    for ((at, set), (step, change)) in taken.iter().zip(&output) {
        assert_eq!(
            (at, &set["key"], &set["value"]),
            (step, &json!(change.key), &json!(change.value))
        );
    }
    rig.rerun(&run.folder, &[])
        .expect(0)
        .prints(&["same digest"]);
}
