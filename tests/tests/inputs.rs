//! Inputs of the plant that no law commands, from a scenario to its recording: constants, courses, faults, changes,
//! checkpoints and repetitions.

use std::path::Path;

use crate::support::board::Board;
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::program_of_tests;

const ROOM: &str = r#"schema = 1
name = "room"
[run]
duration_s = 2.0
rate_hz = 1000
[plant]
model = "heated-room"
[controller]
law = "hold"
"#;

/// Ambient temperature that steps from 280 to 320 K at 1 s.
const STEP: &str = "[[stimuli]]\ntarget = \"plant.ambient_k\"\nkind = \"step\"\nat_s = 1.0\nbefore = 280.0\nafter = 320.0\n";

/// Runs the room with more lines in its scenario.
fn run(rig: &Rig, more: &str, arguments: &str) -> Run {
    let scenario = rig.write("room.toml", &format!("{ROOM}{more}"));
    let plant = program_of_tests("heated-room");
    rig.run(&format!(
        "{} --plant-bin {} {arguments}",
        scenario.display(),
        plant.display()
    ))
}

/// Returns the temperature `since_s` after it was `from_k`, under a constant ambient temperature.
fn cooled(from_k: f64, ambient_k: f64, since_s: f64) -> f64 {
    ambient_k + (from_k - ambient_k) * libm::exp(-since_s / 0.5)
}

fn assert_close(values: &[f64], expected: impl Fn(f64) -> f64) {
    for (step, value) in values.iter().enumerate() {
        let expected = expected(step as f64 / 1000.0);
        assert!(
            (value - expected).abs() < 1e-9,
            "step {step}: {value}, not {expected}"
        );
    }
}

#[test]
fn a_constant_input_acts_and_stands_in_the_scenario_of_the_recording_alone() {
    let rig = Rig::new();
    for (value, ambient_k) in [("290.0", 290.0), ("\"start\"", 280.0)] {
        let more = format!("[plant.inputs]\nambient_k = {value}\n");
        let run = run(&rig, &more, "").expect(0);
        let recording = Recording::open(&run.recording());
        assert_close(&recording.column("truth.room_k"), |t_s| {
            cooled(300.0, ambient_k, t_s)
        });
        let commands: Vec<_> = { recording.columns.iter() }
            .filter(|name| name.contains("ambient_k"))
            .collect();
        assert!(commands.is_empty(), "{commands:?}");
        let scenario = &recording.attachments()["scenario.toml"];
        let line = format!("[plant.inputs]\nambient_k = {ambient_k:?} # K");
        assert!(scenario.contains(&line), "{scenario}");
    }
}

#[test]
fn an_input_with_a_course_is_recorded_and_has_one_digest_everywhere() {
    let rig = Rig::new();
    let requirement =
        "[[requirements]]\nname = \"warm\"\nformula = \"always (input.ambient_k >= 280)\"\n";
    let more = format!("{STEP}{requirement}");
    let separate = run(&rig, &more, "").expect(0);
    let recording = Recording::open(&separate.recording());
    assert_close(&recording.column("input.ambient_k"), |t_s| {
        if t_s < 1.0 { 280.0 } else { 320.0 }
    });
    let end_k = cooled(300.0, 280.0, 1.0);
    assert_close(&recording.column("truth.room_k"), |t_s| {
        if t_s < 1.0 {
            cooled(300.0, 280.0, t_s)
        } else {
            cooled(end_k, 320.0, t_s - 1.0)
        }
    });
    let digest = separate.digest();
    for arguments in ["--pace 5", "--no-record"] {
        let again = run(&rig, &more, arguments).expect(0);
        assert_eq!(again.digest(), digest, "{arguments}");
    }
    // The group is part of the digest.
    let changed = recording.digest(|record| {
        let place = recording.place("input.ambient_k");
        if record.step() == 7 {
            record.words[place] ^= 1;
        }
    });
    assert_ne!(changed, digest);
    assert_eq!(recording.digest(|_| ()), digest);
    let failing = more.replace(">= 280", "< 300");
    run(&rig, &failing, "").expect(1);
}

#[test]
fn one_process_and_two_have_one_digest_with_an_input_driven_by_a_test_card() {
    let rig = Rig::new();
    let scenario = rig.write(
        "spring.toml",
        "schema = 1\n[run]\nduration_s = 2.0\nrate_hz = 1000\n[plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"hold\"\n\
         [[stimuli]]\ntarget = \"plant.force_n\"\nkind = \"sequence\"\nparts = [\n\
         { kind = \"prbs\", length_s = 1.0, amplitude = 2.0, bit_s = 0.01 },\n\
         { kind = \"multisine\", length_s = 1.0, start_hz = 1.0, end_hz = 8.0, tones = 8, amplitude = 1.0 }]\n",
    );
    let run = |arguments: &str| {
        rig.run(&format!("{} {arguments}", scenario.display()))
            .expect(0)
    };
    let separate = run("");
    assert_eq!(run("--link in-process").digest(), separate.digest());
    let recording = Recording::open(&separate.recording());
    let force = recording.column("input.force_n");
    assert!(force[..1000].iter().all(|value| value.abs() == 2.0));
    // The first bits of order 9 from all ones: x^9 + x^5 + 1 gives nine ones and four zeros.
    for (step, value) in force.iter().enumerate().take(130) {
        assert_eq!(*value, if step < 90 { 2.0 } else { -2.0 }, "step {step}");
    }
    let again = rig.rerun(&separate.folder, &[]).expect(0);
    assert_eq!(again.digest(), separate.digest());
}

#[test]
fn a_law_holds_the_start_of_a_command_that_it_is_given_no_value_for() {
    let rig = Rig::new();
    let run = run(&rig, "", "").expect(0);
    let recording = Recording::open(&run.recording());
    assert!(
        recording.column("command.ambient_k")[..2000]
            .iter()
            .all(|value| *value == 280.0)
    );
    assert!(
        recording.column("command.heating_w")[..2000]
            .iter()
            .all(|value| *value == 0.0)
    );
    assert_close(&recording.column("truth.room_k"), |t_s| {
        cooled(300.0, 280.0, t_s)
    });
}

#[test]
fn faults_and_changes_act_on_an_input_and_a_repetition_has_the_same_digest() {
    let rig = Rig::new();
    let more = format!(
        "{STEP}[[faults]]\nkind = \"bias\"\nat_s = 0.5\n[[faults.effects]]\ntarget = \"input.ambient_k\"\nbias = 10.0\n\
         [[changes]]\nat_s = 1.5\nset = {{ input.ambient_k = 300.0 }}\n\
         [[changes]]\nat_s = 1.75\nclear = [\"input.ambient_k\"]\n"
    );
    let run = run(&rig, &more, "--checkpoint-at 0.7").expect(0);
    let recording = Recording::open(&run.recording());
    assert_close(&recording.column("input.ambient_k"), |t_s| {
        let stimulus_k = if t_s < 1.0 { 280.0 } else { 320.0 };
        let bias_k = if t_s < 0.5 { 0.0 } else { 10.0 };
        bias_k
            + if (1.5..1.75).contains(&t_s) {
                300.0
            } else {
                stimulus_k
            }
    });
    let effect = &run.summary()["faults"][0]["effects"][0];
    assert_eq!(
        (&effect["target"], effect["max_effect"].as_f64()),
        (&"input.ambient_k".into(), Some(10.0))
    );
    let again = rig.rerun(&run.folder, &[]).expect(0);
    assert_eq!(again.digest(), run.digest());
    let folder = run.folder.display();
    let from = rig
        .run(&format!("--from {folder}/checkpoint-700"))
        .expect(0);
    assert_eq!(from.digest(), run.digest());
    rig.run(&format!(
        "--from {folder}/checkpoint-700 --set stimuli[0].before=281"
    ))
    .expect(2)
    .says(&["input plant.ambient_k would already differ at step 0 (0 s)"]);
    rig.hil(&["replay", &folder.to_string()]).expect(0);
}

#[test]
fn a_live_fault_and_a_live_change_of_an_input_repeat() {
    let rig = Rig::new();
    let scenario = rig.write("room.toml", &format!("{ROOM}{STEP}"));
    let plant = program_of_tests("heated-room");
    let held = rig.start(&format!(
        "{} --plant-bin {} --pause-at 0.5",
        scenario.display(),
        plant.display()
    ));
    rig.until_held_at(500);
    rig.in_session("inject bias input.ambient_k 5").expect(0);
    rig.in_session("set input.ambient_k=290 --at 0.8").expect(0);
    rig.in_session("inject --list --kind bias")
        .expect(0)
        .prints(&["input.ambient_k"]);
    rig.in_session("set input.room_k=290")
        .expect(2)
        .says(&["there is no `input.room_k` to change"]);
    rig.in_session("resume").expect(0);
    let run = held.finish().expect(0);
    let recording = Recording::open(&run.recording());
    let input = recording.column("input.ambient_k");
    assert_eq!(
        [input[499], input[500], input[799], input[800]],
        [280.0, 285.0, 285.0, 295.0]
    );
    let again = rig.rerun(&run.folder, &[]).expect(0);
    assert_eq!(again.digest(), run.digest());
}

#[test]
fn a_live_request_that_an_input_cannot_follow_is_refused_and_the_run_goes_on() {
    let rig = Rig::new();
    let scenario = rig.write("room.toml", &format!("{ROOM}{STEP}"));
    let plant = program_of_tests("heated-room");
    let line = |scenario: &Path| {
        let (scenario, plant) = (scenario.display(), plant.display());
        format!("{scenario} --plant-bin {plant} --pause-at 0.5")
    };
    let held = rig.start(&line(&scenario));
    rig.until_held_at(500);
    rig.in_session("set input.ambient_k=1001")
        .expect(2)
        .says(&["`input.ambient_k` is 1001, out of range", "100 to 1000"]);
    rig.in_session("set plant.ambient_k=290")
        .expect(2)
        .says(&["during a run this input of the plant is `input.ambient_k`"]);
    rig.in_session("inject bias plant.ambient_k 5")
        .expect(2)
        .says(&["during a run this input of the plant is `input.ambient_k`"]);
    rig.in_session("get --tunable controller.hold.value")
        .expect(0)
        .prints(&["not set"]);
    rig.in_session("set controller.hold.value=100").expect(0);
    rig.in_session("get --tunable controller.hold.value")
        .expect(0)
        .prints(&["100", "changed"]);
    rig.in_session("resume").expect(0);
    held.finish().expect(0);

    let constant = "[plant.inputs]\nambient_k = 290.0\n";
    let scenario = rig.write("constant.toml", &format!("{ROOM}{constant}"));
    let held = rig.start(&line(&scenario));
    rig.until_held_at(500);
    for request in [
        "set input.ambient_k=300",
        "set plant.inputs.ambient_k=300",
        "inject bias input.ambient_k 5",
        "inject bias plant.ambient_k 5",
    ] {
        rig.in_session(request).expect(2).says(&[
            "the input `ambient_k` is a constant of this run",
            "target = \"plant.ambient_k\"",
        ]);
    }
    rig.in_session("resume").expect(0);
    held.finish().expect(0);
}

#[test]
fn a_ramp_from_no_value_begins_at_its_end() {
    let rig = Rig::new();
    let change =
        "[[changes]]\nat_s = 0.5\nramp_s = 1.0\n[changes.set]\ncontroller.hold.value = 300.0\n";
    let run = run(&rig, change, "").expect(0);
    let command = Recording::open(&run.recording()).column("command.ambient_k");
    // The law approaches a new value within 0.1 s.
    assert_eq!(
        [command[499], command[600], command[1999]],
        [280.0, 300.0, 300.0]
    );
    assert!(
        command[..2000]
            .iter()
            .all(|value| (280.0..=300.0).contains(value))
    );
    let again = rig.rerun(&run.folder, &[]).expect(0);
    assert_eq!(again.digest(), run.digest());
}

#[test]
fn an_input_outside_its_range_ends_the_run_by_name() {
    let rig = Rig::new();
    let ramp = "[[stimuli]]\ntarget = \"plant.ambient_k\"\nkind = \"ramp\"\nduration_s = 1.0\nstart = 900.0\nend = 1100.0\n";
    run(&rig, ramp, "")
        .expect(1)
        .says(&["input ambient_k = 1000.2 K is outside 100 to 1000 K"]);
}

#[test]
fn a_campaign_varies_a_constant_and_a_stimulus_of_an_input() {
    let rig = Rig::new();
    let plant = program_of_tests("heated-room");
    let metric = "[[metrics]]\nname = \"end_k\"\nexpression = \"final(truth.room_k)\"\n";
    for (key, more) in [
        (
            "plant.inputs.ambient_k",
            "[plant.inputs]\nambient_k = 280.0\n",
        ),
        ("stimuli[0].before", STEP),
    ] {
        rig.write("room.toml", &format!("{ROOM}{more}{metric}"));
        let study = rig.write(
            "study.toml",
            &format!(
                "schema = 1\nscenario = \"room.toml\"\nseed = 1\nsampling = \"grid\"\n\
                 [[vary]]\nkey = \"{key}\"\nkind = \"list\"\nvalues = [280, 290, 300]\n"
            ),
        );
        let folder = rig.path(key);
        let plan = [
            "campaign",
            "plan",
            &study.display().to_string(),
            "-o",
            &folder.display().to_string(),
            "--plant-bin",
            &plant.display().to_string(),
        ];
        rig.hil(&plan).expect(0);
        rig.hil(&["campaign", "run", &folder.display().to_string()])
            .expect(0);
    }
}

#[test]
fn a_controller_on_another_machine_does_not_see_the_inputs() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let local = run(&rig, STEP, "").expect(0);
    let scenario = rig.path("room.toml");
    let plant = program_of_tests("heated-room");
    let line = format!(
        "{} --plant-bin {} --target me@board",
        scenario.display(),
        plant.display()
    );
    let remote = rig.start_with(board.hil(), &line).finish().expect(0);
    assert_eq!(remote.digest(), local.digest());
}
