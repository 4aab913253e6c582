//! Every possible mistake of a plant or a controller in C, each reported by name.

use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::Value;

use super::{CLEAN, compiled, has};
use crate::support::harness::{Rig, Run, send, until};

pub(super) fn misbehaving(rig: &Rig, name: &str, options: &[&str]) -> PathBuf {
    compiled(
        rig,
        "cc",
        "tests/tests/foreign/misbehaving.c",
        name,
        options,
    )
}

/// Runs one mistake of the plant or the controller in C; the other side behaves.
pub(super) fn deed(rig: &Rig, side: &str, program: &Path, deed: u32) -> Run {
    let (law, section) = match side {
        "plant" => ("hold", "plant.parameters"),
        _ => ("misbehaves", "controller.misbehaves"),
    };
    let text = format!(
        "schema = 1\nname = \"deed\"\nplant.model = \"misbehaves\"\ncontroller.law = \"{law}\"\n\
         {section}.deed = {deed}\nrun.duration_s = 1.0\nrun.rate_hz = 1000\n"
    );
    let scenario = rig.write("deed.toml", &text);
    let (scenario, program) = (scenario.display(), program.display());
    let programs = match side {
        "plant" => format!("--plant-bin {program}"),
        _ => {
            let plant = rig.path("misbehaving-plant");
            format!("--plant-bin {} --controller-bin {program}", plant.display())
        }
    };
    // Only a looping side is detected by waiting.
    let limit_s = if deed == 4 { 0.5 } else { 30.0 };
    rig.run(&format!("{scenario} {programs} --wait-limit {limit_s}"))
}

#[track_caller]
fn reason(run: Run, code: i32, fragments: &[&str]) {
    let run = run.expect(code);
    let summary = run.summary();
    let reason = summary["reason"].as_str().expect("a reason");
    let expected = format!("{reason}\n{}", run.stderr);
    for fragment in fragments {
        assert!(
            expected.contains(fragment),
            "`{fragment}` is not in `{expected}`"
        );
    }
}

#[test]
fn a_plant_in_c_that_restores_part_of_its_state_is_reported_by_its_checkpoint() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "saving-plant", CLEAN);
    for (deed, text) in [
        (0, "exact for 100 steps"),
        (
            14,
            "differs before step 1: measured.x_m is 0 m, not 500 (plant)",
        ),
    ] {
        let text_of_deed = format!(
            "schema = 1\nname = \"deed\"\nplant.model = \"misbehaves\"\ncontroller.law = \"hold\"\n\
             plant.parameters.deed = {deed}\nrun.duration_s = 1.0\nrun.rate_hz = 1000\n"
        );
        let scenario = rig.write("deed.toml", &text_of_deed);
        let run = rig.run(&format!(
            "{} --plant-bin {} --checkpoint-at 0.5",
            scenario.display(),
            plant.display()
        ));
        let summary = run.expect(0).summary();
        assert_eq!(summary["checkpoints"][0]["check"]["text"], text);
    }
}

#[test]
fn every_mistake_of_a_plant_in_c_is_named() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "misbehaving-plant", CLEAN);
    deed(&rig, "plant", &plant, 0).expect(0);
    #[rustfmt::skip] // a table
    let deeds: [(u32, i32, &[&str]); 9] = [
        (1, 3, &["plant was killed by SIGSEGV", "SIGSEGV in measure"]),
        (2, 3, &["plant was killed by SIGABRT", "SIGABRT in measure"]),
        (3, 3, &["plant ended before the run was over"]),
        (4, 3, &["plant was stuck"]),
        (5, 1, &["step 100", "measured x_m = NaN is not a finite number"]),
        (6, 1, &["step 100", "measured x_m = NaN is not a finite number"]),
        (7, 1, &["plant diverged at step 100 (0.1 s): the spring broke"]),
        (8, 3, &["plant failed at step 100 (0.1 s): the table of the spring is gone"]),
        (9, 3, &["plant failed at step 100 (0.1 s): `measure` returned 7 without a reason"]),
    ];
    for (number, code, fragments) in deeds {
        reason(deed(&rig, "plant", &plant, number), code, fragments);
    }
    deed(&rig, "plant", &plant, 20)
        .expect(2)
        .says(&["20 goes with nothing"]);
}

#[test]
fn the_loss_of_a_killed_plant_in_c_is_reported_with_its_last_message() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "misbehaving-plant", CLEAN);
    let scenario = rig.write(
        "killed.toml",
        "schema = 1\nname = \"killed\"\nplant.model = \"misbehaves\"\ncontroller.law = \"hold\"\n\
         plant.parameters.deed = 11\nrun.duration_s = 1.0\nrun.rate_hz = 1000\n",
    );
    let (scenario, plant) = (scenario.display(), plant.display());
    let held = "--pause-at 0.5 --wait-limit 60";
    let running = rig.start(&format!("{scenario} --plant-bin {plant} {held}"));
    let log = running.folder().join("plant.log");
    until("the plant says something", || {
        std::fs::read_to_string(&log).is_ok_and(|log| log.contains("the spring creaks"))
    });
    let [plant, _] = running.children_at_once();
    send(plant.pid, Signal::KILL);
    let fragments = ["plant was killed by SIGKILL", "the spring creaks"];
    reason(running.finish(), 3, &fragments);
}

#[test]
fn every_mistake_of_a_controller_in_c_is_named() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "misbehaving-plant", CLEAN);
    let controller = rig.path("misbehaving-controller");
    std::fs::copy(plant, &controller).expect("copied");
    deed(&rig, "controller", &controller, 0).expect(0);
    #[rustfmt::skip] // a table
    let deeds: [(u32, &[&str]); 7] = [
        (1, &["step 100", "controller was killed by SIGSEGV", "SIGSEGV in step"]),
        (2, &["step 100", "controller was killed by SIGABRT", "SIGABRT in step"]),
        (3, &["controller", "step 100"]),
        (4, &["controller did not answer step 100", "stuck"]),
        (5, &["command of step 100", "u_n = NaN is not a finite number"]),
        (8, &["controller", "the law failed at step 100: the table of the spring is gone"]),
        (9, &["controller", "the law failed at step 100: `step` returned 7 without a reason"]),
    ];
    for (number, fragments) in deeds {
        reason(deed(&rig, "controller", &controller, number), 3, fragments);
    }
}

#[test]
fn every_mistake_in_the_tables_is_named_before_anything_starts() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "misbehaving-plant", CLEAN);
    #[rustfmt::skip] // a table
    let cases = [
        ("twice", "truth of plant `misbehaves`: `x_m` is defined twice"),
        ("unit", "truth of plant `misbehaves`: `v_mps` has the invalid unit \"m]\""),
        ("no-unit", "truth of plant `misbehaves`: `v_mps` has no unit"),
        ("name", "truth of plant `misbehaves`: \"2 m\" is not a name"),
        ("null-name", "the name of row 2 of `truth` is a null pointer"),
        ("null-rows", "`measured` has 1 rows at a null pointer"),
        ("callback", "the callback `advance` is missing"),
        ("range", "`deed` has a range that begins above its end: 30 to 20"),
        ("default", "`deed` has the default 21, outside 0 to 20"),
        ("flags", "`deed` of `parameters` has unknown flags: 64"),
        ("api", "`api` is 99, but this library supports 3"),
        ("utf-8", "the summary of the plant is not UTF-8"),
        ("saving", "`saved_size`, `save` and `restore` belong together"),
        ("text", "measured of plant `misbehaves`: `x_m` has no description"),
        ("null", "hil_plant_main got a null pointer"),
        ("retune", "the callback `retune` is missing, which applies `deed`"),
    ];
    for (mistake, message) in cases {
        let mut command = rig.command(&plant);
        let output = command.arg("--describe").env("MISTAKE", mistake).output();
        let output = output.expect("it runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{mistake}: {text}");
        assert!(text.contains(message), "{mistake}: {text}");
    }
    // `hil` shows it too.
    let wrong = rig.script(
        "wrong",
        &format!(
            "#!/bin/sh\nMISTAKE=twice exec '{}' \"$@\"\n",
            plant.display()
        ),
    );
    let run = deed(&rig, "plant", &wrong, 0).expect(2);
    let report = "truth of plant `misbehaves`: `x_m` is defined twice";
    let expected = format!("error: cannot run {}: {report}\n", wrong.display());
    assert_eq!(run.stderr, expected, "the reason, first and alone");
}

#[test]
fn a_tunable_parameter_of_a_law_in_c_accepts_values_or_is_refused_by_name() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "misbehaving-plant", CLEAN);
    let controller = rig.path("misbehaving-controller");
    std::fs::copy(&plant, &controller).expect("copied");
    let described = |missing: &str| {
        let mut command = rig.command(&controller);
        let output = command.arg("--describe").env("MISTAKE", missing).output();
        output.expect("it runs")
    };
    let whole = described("none");
    assert_eq!(whole.status.code(), Some(0));
    let report: Value = serde_json::from_slice(&whole.stdout).expect("JSON");
    assert_eq!(
        report["laws"][0]["parameters"][0]["tunable"], true,
        "{report:#}"
    );
    for missing in ["retune", "tuning"] {
        let refused = described(missing);
        assert_eq!(refused.status.code(), Some(2), "{missing}");
        assert!(refused.stdout.is_empty(), "{missing}");
        let text = String::from_utf8_lossy(&refused.stderr);
        let report = "`deed` is HIL_TUNABLE: that needs `retune` and `tuning`";
        assert_eq!(
            text,
            format!("error: {report}\n"),
            "one line, and nothing else"
        );
        let wrong = rig.script(
            "wrong-controller",
            &format!(
                "#!/bin/sh\nMISTAKE={missing} exec '{}' \"$@\"\n",
                controller.display()
            ),
        );
        let run = deed(&rig, "controller", &wrong, 0).expect(2);
        let expected = format!("error: cannot run {}: {report}\n", wrong.display());
        assert_eq!(run.stderr, expected, "{missing}");
        assert!(!run.folder.exists(), "nothing was started");
    }
}
