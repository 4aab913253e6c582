//! Loops that are not the same throughout a measurement, have two rates or are unstable.

use super::refusals::refused;
use super::{SPRING_MASS, TWENTY, fault, measured, teaching_with};
use crate::support::harness::Rig;
use crate::support::programs::program;

#[test]
fn a_slower_sensor_or_actuator_is_refused_as_a_loop_of_two_rates() {
    let rig = Rig::new();
    for (text, part) in [
        (
            "[[sensors]]\nsignal = \"position_m\"\nrate_hz = 100\n",
            "the sensor of position_m",
        ),
        (
            "[[actuators]]\nsignal = \"force_n\"\nrate_hz = 100\n",
            "the actuator of force_n",
        ),
    ] {
        let reasons = [
            part,
            "at every 10th step only, so the loop has two rates",
            "--set run.rate_hz=100 --set plant.substeps=40",
        ];
        refused(&rig, &teaching_with(&rig, text), TWENTY, &reasons);
    }
}

#[test]
fn a_fault_that_samples_or_comes_and_goes_is_refused() {
    let rig = Rig::new();
    let held = "target = \"measured.position_m\"\nevery_steps = 2";
    let held = fault("sample-hold", 0.0, held);
    let reasons = ["fault 1 (sample-hold)", "at every 2nd step only"];
    refused(&rig, &teaching_with(&rig, &held), TWENTY, &reasons);
    let effect = "target = \"command.force_n\"\nfactor = 0.5\nprofile = { kind = \"intermittent\", period_s = 0.1, duty = 0.5 }";
    let scenario = teaching_with(&rig, &fault("scale", 0.0, effect));
    let reasons = ["fault 1 (scale) comes and goes", "--fault 0"];
    refused(&rig, &scenario, TWENTY, &reasons);
    measured(&rig, &scenario, &[TWENTY, &["--fault", "0"]].concat());
    let effect_of_skip = "target = \"controller\"\nsteps = 1\nperiod_steps = 100";
    let skips = teaching_with(&rig, &fault("skip", 0.0, effect_of_skip));
    let again = "fault 1 (skip) makes the controller miss steps again every 100 steps";
    refused(
        &rig,
        &skips,
        TWENTY,
        &[again, "varies in time", "--fault 0"],
    );
    // A fault after or before the measurement is no part of it.
    let before = fault("scale", 0.0, effect).replace("at_s = 0.0", "at_s = 0.0\nend_s = 1.0");
    measured(&rig, &teaching_with(&rig, &before), TWENTY);
    let later = teaching_with(&rig, &fault("scale", 90.0, effect));
    let longer = ["--set", "run.duration_s=100", "--at", "2"];
    measured(&rig, &later, &[TWENTY, &longer].concat());
}

#[test]
fn a_fault_that_begins_after_another_is_not_kept_alone() {
    let rig = Rig::new();
    let text = "[[faults]]\nname = \"late\"\nkind = \"message-delay\"\nat_s = 1.0\n\
                [[faults.effects]]\ntarget = \"link.command\"\nsteps = 5\n\
                [[faults]]\nkind = \"scale\"\nafter = \"late\"\n\
                [[faults.effects]]\ntarget = \"command.force_n\"\nfactor = 0.5\n";
    let scenario = teaching_with(&rig, text);
    let run = rig.hil(&["margins", &scenario, "--fault", "2"]).expect(2);
    run.says(&["fault 2 begins after fault `late`", "give it at_s"]);
    measured(&rig, &scenario, &[TWENTY, &["--fault", "1"]].concat());
}

#[test]
fn a_fault_that_begins_or_ends_during_the_measurement_is_refused() {
    let rig = Rig::new();
    let effect = "target = \"command.force_n\"\nfactor = 0.5";
    let begun = fault("scale", 8.0, effect);
    let longer = ["--set", "run.duration_s=100", "--at", "2"];
    let further = [TWENTY, &longer].concat();
    let interval = "while the probe runs from 2 s to 18 s";
    let reasons = ["fault 1 (scale) begins at 8 s", interval, "another --at"];
    refused(&rig, &teaching_with(&rig, &begun), &further, &reasons);
    let ended = begun.replace("at_s = 8.0", "at_s = 0.0\nend_s = 9.0");
    let reasons = ["fault 1 ends at 9 s", interval];
    refused(&rig, &teaching_with(&rig, &ended), &further, &reasons);
    let ramp = format!("{effect}\nprofile = {{ kind = \"ramp\", duration_s = 5.0 }}");
    let ramp = fault("scale", 0.0, &ramp);
    let reasons = ["fault 1 (scale) moves from 0 s to 5 s", interval];
    refused(&rig, &teaching_with(&rig, &ramp), &further, &reasons);
    // A ramp that was cut short before the probe does not move.
    let short = ramp.replace("at_s = 0.0", "at_s = 0.0\nend_s = 1.0");
    measured(&rig, &teaching_with(&rig, &short), &further);
}

#[test]
fn a_stimulus_that_moves_once_during_the_measurement_is_refused() {
    let rig = Rig::new();
    let further = [TWENTY, &["--at", "0.2"]].concat();
    let reasons = [
        "the stimulus of position_m moves at 0.5 s",
        "choose an --at",
    ];
    refused(&rig, SPRING_MASS, &further, &reasons);
}

#[test]
fn a_loop_that_grows_slowly_is_refused() {
    let rig = Rig::new();
    // The closed-loop pole is near -k_i / (k + k_p) = 5 / 400 per second: a root of s^3 + 32 s^2 + 400 s - 5.
    let slow = ["--set", "controller.pid.integral_n_per_m_s=-5"];
    let reasons = ["the loop is unstable", "grows by 1.249e-2", "per second"];
    refused(&rig, SPRING_MASS, &slow, &reasons);
}

#[test]
fn an_uncertain_gain_margin_is_refused_alone() {
    let rig = Rig::new();
    let sensor = "[[sensors]]\nsignal = \"position_m\"\nresolution = 1e-6\nnoise_sigma = 1e-6\n";
    let scenario = teaching_with(&rig, sensor);
    let run = rig.hil(&["margins", &scenario, "--json"]).expect(1);
    let input = &run.json()["inputs"][0];
    assert!(input["refused"].is_null() && input["gain_margin_db"].is_null());
    let reason = input["gain_refused"].as_str().expect("a reason");
    assert!(reason.contains("is uncertain by"), "{reason}");
    super::assert_near(&input["phase_margin_deg"], 73.968_38, 1e-4);
    let plain = rig.hil(&["margins", &scenario]).expect(1);
    plain.prints(&["gain margin   refused: the response at"]);
}

#[test]
fn a_narrow_range_has_a_period_that_is_long_enough() {
    let rig = Rig::new();
    let report = measured(&rig, SPRING_MASS, &["--frequencies", "5..6"]);
    let input = &report["inputs"][0];
    super::assert_near(&input["phase_margin_deg"], 73.968_38, 1e-4);
}

#[test]
fn an_unwritable_file_is_named_before_the_measurement() {
    let rig = Rig::new();
    let missing = rig.path("missing");
    let path = missing.join("loop.csv");
    let output = crate::support::harness::text(&path);
    let run = rig.hil(&["margins", SPRING_MASS, "-o", output]);
    assert!(run.stderr.contains("cannot write"), "{}", run.stderr);
    assert!(!run.stderr.contains("probing"), "{}", run.stderr);
}

#[test]
fn a_file_that_cannot_be_completed_leaves_the_margins_and_the_older_file() {
    let rig = Rig::new();
    let run = rig.hil(&[&["margins", SPRING_MASS, "-o", "/dev/full"], TWENTY].concat());
    run.expect(3)
        .prints(&["  gain margin   36.40"])
        .says(&["cannot write /dev/full", "No space left"]);
    // A limit of 1 KiB or less, which the responses exceed, and which ends no program.
    let script = "trap '' XFSZ; ulimit -f 1; exec \"$@\"";
    for older in [None, Some("older")] {
        let folder = rig.path(older.unwrap_or("new"));
        std::fs::create_dir(&folder).expect("a folder");
        let path = folder.join("loop.csv");
        if let Some(text) = older {
            std::fs::write(&path, text).expect("a file");
        }
        let mut command = rig.command("sh");
        command.args(["-c", script, "sh"]);
        command.args([program("hil"), "margins".into(), SPRING_MASS.into()]);
        command.arg("-o").arg(&path).args(TWENTY);
        let run = rig.program(command);
        run.expect(3).prints(&["  gain margin   36.40"]).says(&[
            "cannot write",
            "loop.csv",
            "File too large",
        ]);
        let left = std::fs::read_dir(&folder).expect("a folder").count();
        assert_eq!(left, usize::from(older.is_some()));
        assert_eq!(std::fs::read_to_string(&path).ok().as_deref(), older);
    }
}
