//! FMUs whose saved state does not restore exactly: each checkpoint states the number of reproduced steps, and the
//! cause of the end.

use rustix::process::Signal;
use serde_json::{Value, json};

use super::{Place, scenario};
use crate::support::fmus::entries;
use crate::support::harness::{EXPIRES_S, Run, send, until};

/// Describes `tests/fmus/states.c` with this token and these names of its output and its input.
fn states(token: &str, [output, input]: [&str; 2]) -> Vec<(String, Vec<u8>)> {
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" modelName=\"states\" \
         guid=\"{token}\"><CoSimulation modelIdentifier=\"states\" canGetAndSetFMUstate=\"true\" \
         canSerializeFMUstate=\"true\"/><ModelVariables>\
         <ScalarVariable name=\"{output}\" valueReference=\"1\" causality=\"output\"><Real/></ScalarVariable>\
         <ScalarVariable name=\"{input}\" valueReference=\"2\" causality=\"input\"><Real start=\"0\"/></ScalarVariable>\
         </ModelVariables><ModelStructure><Outputs><Unknown index=\"1\" dependencies=\"\"/></Outputs></ModelStructure>\
         </fmiModelDescription>"
    );
    entries("states", 2, text.into_bytes(), &[])
}

/// Runs 300 steps of the plant with this token, with a checkpoint before each of these steps.
fn run(place: &Place, token: &str, steps: &[u32], arguments: &str) -> Run {
    place.fmu("plant.fmu", &states(token, ["y", "u"]));
    let text = scenario("states", "plant.fmu", 100.0, 300.0);
    let at = |step: &u32| format!("--checkpoint-at {:?}", f64::from(*step) / 100.0);
    let at: Vec<String> = steps.iter().map(at).collect();
    place.run(&text, &format!("{} {arguments}", at.join(" ")))
}

fn check(run: &Run, number: usize) -> Value {
    run.summary()["checkpoints"][number]["check"].take()
}

#[track_caller]
fn assert_text(check: &Value, fragments: &[&str]) {
    let text = check["text"].as_str().expect("text");
    for fragment in fragments {
        assert!(text.contains(fragment), "`{fragment}` is not in `{text}`");
    }
}

fn resumed(place: &Place, run: &Run, step: u32) -> Run {
    let from = run.folder.join(format!("checkpoint-{step}"));
    let out = place.rig.path(&format!("from-{step}"));
    let [from, to] = [&from, &out].map(|path| path.to_str().expect("text"));
    let resumed = place.hil(&["run", "--from", from, "--out", to]).expect(0);
    Run {
        folder: out,
        ..resumed
    }
}

#[test]
fn a_checkpoint_reports_the_step_at_which_a_restored_fmu_differs() {
    // Counted from step 50, a jump every N steps comes after N; in the run it comes after the rest to a multiple.
    for (period, expected) in [(3, Some(1)), (6, Some(4)), (90, Some(40)), (25, None)] {
        let Some(place) = Place::new() else { return };
        let run = run(&place, &format!("jump {period}"), &[50], "").expect(0);
        let check = check(&run, 0);
        let Some(step) = expected else {
            let exact = json!({"verdict": "exact", "steps": 100, "text": "exact for 100 steps"});
            assert_eq!(check, exact, "{period}");
            run.prints(&["checkpoint-50: exact for 100 steps"]);
            continue;
        };
        assert_eq!(check["verdict"], "differs", "{period}");
        assert_eq!(check["steps"], step - 1, "{period}");
        let text = format!("differs at step {step}: measured.y is ");
        assert_text(&check, &[&text, " (plant)"]);
        let run = run
            .prints(&[&text])
            .says(&["does not restore exactly", &text]);
        let resumed = resumed(&place, &run, 50);
        assert_ne!(resumed.digest(), run.digest());
        assert_eq!(resumed.summary()["resumed"]["check"], check, "{period}");
        let folder = resumed.folder.display().to_string();
        resumed.prints(&[&text]).says(&["warning: ", &text]);
        let again = place.rig.path("again").display().to_string();
        let rerun = place.hil(&["rerun", &folder, "--out", &again]);
        rerun
            .expect(1)
            .prints(&["resumed from a checkpoint", &text]);
    }
}

#[test]
fn fewer_steps_are_checked_if_the_run_ends_sooner() {
    let Some(place) = Place::new() else { return };
    let run = run(&place, "jump 0", &[150, 263, 299], "").expect(0);
    for (number, text) in [
        "exact for 100 steps",
        "exact for 37 steps",
        "exact for 1 step",
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(check(&run, number)["text"], text);
    }
    let resumed = resumed(&place, &run, 263);
    assert_eq!(resumed.digest(), run.digest());
    assert!(!resumed.stderr.contains("warning"), "{}", resumed.stderr);
}

#[test]
fn a_restored_fmu_that_crashes_fails_or_hangs_is_reported_with_its_call() {
    #[rustfmt::skip] // a table
    let cases = [
        ("crash fmi2DeSerializeFMUstate", "crashed", &["before step 1: plant was killed by SIGSEGV", "DeserializeFMUState"][..]),
        ("crash fmi2DoStep", "crashed", &["at step 3: plant was killed by SIGSEGV", "DoStep"]),
        ("address", "crashed", &["before step 1: plant was killed by SIGABRT"]),
        ("fail fmi2SetFMUstate", "failed", &["before step 1: ", "SetFMUState", "the mesh is gone"]),
        ("fail fmi2DoStep", "failed", &["after 2 exact steps: ", "the mesh is gone"]),
        ("hang fmi2DoStep", "stuck", &["got stuck at step 3: plant was stuck"]),
    ];
    for (token, verdict, fragments) in cases {
        let Some(place) = Place::new() else { return };
        let limit = format!("--wait-limit {EXPIRES_S}");
        let run = run(&place, token, &[50], &limit).expect(0);
        let check = check(&run, 0);
        assert_eq!(check["verdict"], verdict, "{token}: {check}");
        assert_text(&check, fragments);
        run.says(&["does not restore exactly: it "]);
    }
}

#[test]
fn an_fmu_as_the_controller_is_checked_too() {
    for (token, verdict, fragments) in [
        ("jump 25", "exact", &["exact for 100 steps"][..]),
        // A law does its step between the sample and the command.
        (
            "jump 3",
            "differs",
            &["differs at step 1: command.u is", "(controller)"],
        ),
        (
            "crash fmi2DoStep",
            "crashed",
            &["at step 3: controller was killed by SIGSEGV", "DoStep"],
        ),
    ] {
        let Some(place) = Place::new() else { return };
        place.fmu("law.fmu", &states(token, ["u", "y"]));
        place.fmu("plant.fmu", &states("jump 0", ["y", "u"]));
        let text = scenario("states", "plant.fmu", 100.0, 300.0)
            .replace("law = \"hold\"", "law = \"states\"\nprogram = \"law.fmu\"")
            .replace("[controller.hold]\nvalue = 1.0\n", "");
        let run = place.run(&text, "--checkpoint-at 0.5").expect(0);
        let check = check(&run, 0);
        assert_eq!(check["verdict"], verdict, "{token}: {check}");
        assert_text(&check, fragments);
    }
}

#[test]
fn an_interrupted_check_is_recorded_as_missing() {
    let Some(place) = Place::new() else { return };
    place.fmu("plant.fmu", &states("hang fmi2DoStep", ["y", "u"]));
    let text = scenario("states", "plant.fmu", 100.0, 300.0);
    let path = place.rig.write("scenario.toml", &text);
    let arguments = format!("{} --checkpoint-at 0.5 --wait-limit 600", path.display());
    let running = place.rig.start_with(place.command(), &arguments);
    let description = running.folder().join("checkpoint-50/checkpoint.json");
    until("the checkpoint is there", || description.exists());
    running.signal(Signal::INT);
    let run = running.finish().expect(130);
    place.assert_nothing_unpacked();
    assert_eq!(run.summary()["verdict"], "pass");
    let check = check(&run, 0);
    assert_eq!(check["text"], "not checked: interrupted");
    let text = std::fs::read_to_string(&description).expect("it is there");
    let described: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(described["check"], check);
}

#[test]
fn killing_hil_during_the_check_keeps_the_result_of_the_run() {
    let Some(place) = Place::new() else { return };
    place.fmu("plant.fmu", &states("hang fmi2DoStep", ["y", "u"]));
    let text = scenario("states", "plant.fmu", 100.0, 300.0);
    let path = place.rig.write("scenario.toml", &text);
    let arguments = format!("{} --checkpoint-at 0.5 --wait-limit 600", path.display());
    let running = place.rig.start_with(place.command(), &arguments);
    let summary = running.folder().join("summary.json");
    until("the run is over", || summary.exists());
    send(running.worker(), Signal::KILL);
    let run = running.finish_beside_another();
    assert_eq!(run.summary()["verdict"], "pass");
    assert!(check(&run, 0).is_null());
}

#[test]
fn a_checkpoint_without_a_check_can_be_resumed_with_a_note() {
    let Some(place) = Place::new() else { return };
    let run = run(&place, "jump 3", &[50], "").expect(0);
    let path = run.folder.join("checkpoint-50/checkpoint.json");
    let text = std::fs::read_to_string(&path).expect("it is there");
    let mut described: Value = serde_json::from_str(&text).expect("JSON");
    described.as_object_mut().expect("a table").remove("check");
    std::fs::write(&path, described.to_string()).expect("written");
    let resumed = resumed(&place, &run, 50);
    assert!(resumed.summary()["resumed"]["check"].is_null());
    resumed.prints(&["checkpoint-50: not checked"]);
}

#[test]
fn an_audit_reports_state_that_does_not_restore() {
    let Some(place) = Place::new() else { return };
    let audited = run(&place, "jump 60", &[], "--audit").expect(0);
    // The state is saved before step 150, 30 steps before the next jump.
    let text = "differs at step 30: measured.y";
    let repetitions = audited.summary()["audit"]["repetitions"].take();
    let checks: Vec<&Value> = (repetitions.as_array().expect("a list").iter())
        .map(|one| &one["check"])
        .filter(|check| !check.is_null())
        .collect();
    let [check] = checks[..] else {
        panic!("{repetitions}")
    };
    assert_text(check, &[text]);
    assert_eq!(audited.summary()["audit"]["verdict"], "pass");
    audited.prints(&["its restored state: ", text]);
}
