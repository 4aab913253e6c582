//! Peers with false statements: a run is as planned, step by step and signal by signal, or it fails with the
//! statement named.

use serde_json::Value;

use crate::support::harness::{Rig, Run};
use crate::support::programs::{misbehaving_controller, program, program_of_tests};

/// Runs the lying plant for a second with 1000 steps; the model selects the lie.
fn lies(rig: &Rig, lie: &str, more: &str) -> Run {
    let scenario = rig.scenario(1.0, lie, "hold");
    let (scenario, plant) = (scenario.display(), program_of_tests("lying-plant"));
    let plant = plant.display();
    rig.run(&format!(
        "{scenario} --plant-bin {plant} --wait-limit 30 {more}"
    ))
}

/// Fails unless a run and its recording were aborted for a reason with these facts.
#[track_caller]
fn found_out(run: Run, lie: &str, facts: &[&str]) {
    assert_eq!(run.code, Some(3), "{lie}: {}{}", run.stdout, run.stderr);
    let summary = run.summary();
    assert_eq!(summary["verdict"], "aborted", "{lie}");
    let reason = summary["reason"].as_str().unwrap_or_default();
    for fact in facts {
        assert!(
            reason.contains(fact),
            "{lie}: `{fact}` is not in `{reason}`"
        );
    }
    for expected in [&run.stdout, &run.stderr, &reason.to_owned()] {
        assert!(
            !expected.contains(['\u{1b}', '\u{7}']),
            "{lie}: {expected:?}"
        );
    }
}

#[test]
fn an_honest_plant_passes() {
    for more in [
        "",
        "--no-record",
        "--record-every 10",
        "--set run.on_controller_loss=hold",
    ] {
        let rig = Rig::new();
        let run = lies(&rig, "honest", more).expect(0);
        let summary = run.summary();
        assert_eq!(
            (&summary["verdict"], &summary["steps"]),
            (&"pass".into(), &1000.into())
        );
        assert_eq!(summary["recording"]["records"], 1001);
    }
}

#[test]
fn false_statements_of_a_plant_are_detected() {
    #[rustfmt::skip] // a table
    let cases = [
        ("runs-two-steps", &["a completed run after 2 steps", "1000"][..]),
        ("runs-no-step", &["a completed run after 0 steps", "1000"]),
        ("claims-all-steps", &["1000 executed steps", "1001 records", "3 arrived"]),
        ("claims-no-step", &["a completed run after 0 steps", "1000"]),
        ("claims-more-steps", &["18446744073709551615 executed steps", "1000"]),
        ("diverges-beyond-the-end", &["18446744073709551615 executed steps", "1000"]),
        ("keeps-one-back", &["record of step 501", "instead of step 500"]),
        ("keeps-the-last-back", &["1000 executed steps", "1001 records", "500 arrived"]),
        ("doubles-one", &["record of step 500", "instead of step 501"]),
        ("swaps-two", &["record of step 501", "instead of step 500"]),
        ("tells-another-time", &["record of step 500", "500000001 ns", "500000000 ns"]),
        ("has-no-controller", &["the loss of controller 1", "hold", "abort"]),
        ("loses-it-against-the-plan", &["the loss of controller 1", "hold", "abort"]),
        ("gets-another", &["controller 2", "was never started"]),
        ("misses-commands", &["1 commands missed", "0 records"]),
        ("makes-up-a-fault", &["effect 0 of fault 7", "no such fault"]),
        ("writes-on-the-terminal", &["all is \u{fffd}[32mwell\u{fffd}"]),
        ("misnames", &["truth signal", "position_m\\nfloat64 other_m", "--describe"]),
    ];
    for (lie, facts) in cases {
        let rig = Rig::new();
        found_out(lies(&rig, lie, ""), lie, facts);
    }
}

#[test]
fn false_statements_are_detected_with_any_recording_and_loss_policy() {
    let (back, came) = ("keeps-the-last-back", &["1001 records", "500 arrived"]);
    for more in ["--no-record", "--record-every 10", "--pace 100"] {
        let rig = Rig::new();
        found_out(lies(&rig, back, more), more, came);
    }
    // The recording contains the same, and its readers report it.
    let rig = Rig::new();
    let run = lies(&rig, back, "");
    let folder = run.folder.to_str().expect("plain text");
    rig.hil(&["judge", folder])
        .expect(1)
        .prints(&["aborted", "1001 records", "500 arrived"]);
    drop(rig);
    for (lie, policy, fact) in [
        (
            "has-no-controller",
            "hold",
            "no record has a controller's answer",
        ),
        ("has-no-link", "hold", "no controller connected to its link"),
        (
            "has-no-link",
            "safe-command",
            "`hold`, but the run has the policy `safe-command`",
        ),
        (
            "loses-it-against-the-plan",
            "safe-command",
            "`hold`, but the run has the policy `safe-command`",
        ),
    ] {
        let rig = Rig::new();
        let more = format!("--set run.on_controller_loss={policy}");
        found_out(lies(&rig, lie, &more), lie, &[fact]);
    }
}

/// Runs the teaching plant under a law of the misbehaving controller.
fn under(rig: &Rig, law: &str, more: &str) -> Run {
    let scenario = rig.scenario(0.1, "spring-mass", law);
    let (scenario, controller) = (scenario.display(), misbehaving_controller());
    let controller = controller.display();
    rig.run(&format!(
        "{scenario} --controller-bin {controller} --wait-limit 30 {more}"
    ))
}

#[test]
fn a_controller_that_contradicts_its_description_at_hello_is_refused() {
    let rig = Rig::new();
    let run = under(&rig, "shows", "").expect(0);
    assert_eq!(run.summary()["verdict"], "pass");
    for (law, facts) in [
        (
            "unreadable",
            &["internal", "first m\\nfloat64 third_m", "first_m"][..],
        ),
        ("doubles", &["internal", "first_m", "second_m"]),
        ("renames", &["internal", "third_m", "first_m"]),
        ("changes-unit", &["internal", "first_m", "\"s\"", "\"m\""]),
        ("hides", &["1 internal signals", "2"]),
        ("needs-more", &["1 reference signals", "0"]),
        ("takes-what-there-is", &["commands", "of the plant"]),
    ] {
        let rig = Rig::new();
        let run = under(&rig, law, "");
        // It ended before there was anything to record.
        assert!(!run.recording().exists(), "{law}");
        assert_eq!(run.summary()["recording"]["file"], Value::Null, "{law}");
        assert!(!run.stdout.contains("run.mcap"), "{law}: {}", run.stdout);
        found_out(run, law, &[&["refused"], facts].concat());
    }
}

/// Change to a description.
type Change = fn(&mut Value);

/// Adds internal signals to a law.
fn shows(description: &mut Value) -> &mut Vec<Value> {
    let laws = description["laws"].as_array_mut().expect("a list");
    let mut internals = laws
        .iter_mut()
        .filter_map(|law| law["internals"].as_array_mut());
    let some = internals.find(|internals| internals.len() > 1);
    some.expect("a law that shows two things")
}

#[test]
fn an_unrecordable_description_is_refused_before_anything_starts() {
    let rig = Rig::new();
    let described = |binary: &str| -> Value {
        let output = rig.command(program(binary)).arg("--describe").output();
        serde_json::from_slice(&output.expect("it runs").stdout).expect("JSON")
    };
    let (plant, controller) = (described("plant-process"), described("controller-process"));
    let changes: [(&str, &str, Change); 7] = [
        ("--controller-bin", "\"e m\" is not a name", |all| {
            shows(all)[0]["name"] = "e m".into();
        }),
        ("--controller-bin", "has the invalid unit", |all| {
            shows(all)[0]["unit"] = "m\nfloat64 x".into();
        }),
        ("--controller-bin", "is defined twice", |all| {
            let name = shows(all)[0]["name"].clone();
            shows(all)[1]["name"] = name;
        }),
        ("--controller-bin", "is defined twice", |all| {
            let law = all["laws"][0].clone();
            all["laws"].as_array_mut().expect("a list").push(law);
        }),
        ("--plant-bin", "is defined twice", |all| {
            let plant = all["plants"][0].clone();
            all["plants"].as_array_mut().expect("a list").push(plant);
        }),
        ("--plant-bin", "is defined twice", |all| {
            let name = all["plants"][0]["truth"][0]["name"].clone();
            all["plants"][0]["truth"][1]["name"] = name;
        }),
        ("--plant-bin", "is not a name", |all| {
            all["plants"][0]["measured"][0]["name"] = "2x".into();
        }),
    ];
    for (flag, expected, change) in changes {
        let is_plant = flag == "--plant-bin";
        let mut text = if is_plant { &plant } else { &controller }.clone();
        change(&mut text);
        let file = rig.write("description.json", &text.to_string());
        let script = rig.script("described", &format!("#!/bin/sh\ncat {}\n", file.display()));
        let script = script.display();
        let run = rig.run(&format!("scenarios/spring-mass.toml {flag} {script}"));
        let run = run.expect(2).says(&["--describe", expected]);
        assert!(!run.folder.exists(), "{expected}");
    }
}
