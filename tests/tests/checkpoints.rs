//! A run that goes on from a checkpoint is the straight run; a branch shares its past and nothing
//! after it; what cannot go on is refused before anything starts.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::Value;
use shared_types::random::RandomStream;

use crate::every_fault::{LAWS, faults, with_fault};
use crate::support::harness::{Rig, Run, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{example, program, program_of_tests, workspace};

/// Two seconds under FTSC; both actuators begin to leak at 1 s.
const SCENARIO: &str = "tests/scenarios/leakage.toml";
const SEVERITY: &str = "faults[0].effects[0].coefficient_m3ps_per_sqrt_pa";

/// The folder of a run's checkpoint before a step.
fn checkpoint(run: &Run, step: u64) -> PathBuf {
    run.folder.join(format!("checkpoint-{step}"))
}

/// Goes on from the checkpoint before a step.
fn go_on(rig: &Rig, run: &Run, step: u64, arguments: &str) -> Run {
    let from = checkpoint(run, step);
    rig.run(&format!("--from {} {arguments}", from.display()))
}

/// What a summary says of the run itself, not of the session or of clocks.
fn judged(run: &Run) -> Vec<Value> {
    let mut summary = run.summary();
    let keys = [
        "verdict",
        "steps",
        "sim_time_s",
        "digest",
        "metrics",
        "faults",
        "rejected_frames",
        "ignored",
    ];
    keys.map(|key| summary[key].take()).into()
}

#[track_caller]
fn assert_same(straight: &Run, resumed: &Run, about: &str) {
    assert_eq!(judged(resumed), judged(straight), "{about}");
}

/// How old what each side had was at each step: not in the digest, and the same all the same.
fn ages(run: &Run) -> Vec<[u64; 3]> {
    let recording = Recording::open(&run.recording());
    let place = |ending: &str| {
        let place = recording
            .columns
            .iter()
            .position(|name| name.ends_with(ending));
        place.expect("a column")
    };
    let places = ["sample_age_steps", "command_age_steps", "answered"].map(place);
    let records = recording.records();
    records
        .map(|record| places.map(|place| record.words[place]))
        .collect()
}

/// The steps of the checkpoints that a run made.
fn made(run: &Run) -> Vec<u64> {
    let summary = run.summary();
    let made = summary["checkpoints"].as_array().expect("a list");
    made.iter()
        .map(|made| made["step"].as_u64().expect("a step"))
        .collect()
}

/// Runs a scenario in one thread with checkpoints at these times, and goes on from each.
#[track_caller]
fn assert_goes_on(rig: &Rig, scenario: &str, times_s: &[f64], about: &str) {
    let mut arguments = format!("{scenario} --link in-process");
    for time_s in times_s {
        let _ = write!(arguments, " --checkpoint-at {time_s}");
    }
    let straight = rig.run(&arguments).expect(0);
    let steps = made(&straight);
    assert_eq!(steps.len(), times_s.len(), "{about}");
    for step in steps {
        let resumed = go_on(rig, &straight, step, "--link in-process").expect(0);
        assert_same(&straight, &resumed, &format!("{about}, from step {step}"));
        assert_eq!(ages(&resumed), ages(&straight), "{about}, from step {step}");
        std::fs::remove_dir_all(&resumed.folder).expect("it is ours");
    }
}

#[test]
fn a_run_that_goes_on_is_the_straight_run_over_any_link() {
    let rig = Rig::new();
    let without = rig.run(&format!("{SCENARIO} --no-record")).expect(0);
    for made_over in ["iceoryx2", "in-process"] {
        let arguments = format!("{SCENARIO} --checkpoint-at 1.05 --link {made_over}");
        let straight = rig.run(&arguments).expect(0);
        assert_same(&without, &straight, "a checkpoint changes nothing");
        for link in ["iceoryx2", "in-process"] {
            let about = format!("from {made_over} on over {link}");
            let resumed = go_on(&rig, &straight, 10_500, &format!("--link {link}")).expect(0);
            assert_same(&straight, &resumed, &about);
            let summary = resumed.summary();
            assert_eq!(summary["resumed"]["step"], 10_500, "{about}");
            // Latency is that of this run: what came before was measured in another.
            let count = &summary["latency_ns"]["round_trip"]["count"];
            assert_eq!(count.as_u64(), Some(20_000 - 10_500), "{about}");
            let recordings = [&straight, &resumed].map(|run| Recording::open(&run.recording()));
            let [theirs, ours] = recordings.each_ref().map(Recording::records);
            assert!(
                theirs
                    .zip(ours)
                    .take(10_500)
                    .all(|(theirs, ours)| theirs.words == ours.words)
            );
        }
    }
}

#[test]
fn a_paced_run_goes_on_where_it_was() {
    let rig = Rig::new();
    let straight = rig
        .run(&format!("{SCENARIO} --pace 8 --checkpoint-at 0.6"))
        .expect(0);
    let resumed = go_on(&rig, &straight, 6000, "").expect(0);
    assert_same(&straight, &resumed, "paced");
    assert_eq!(resumed.summary()["clock"], "paced");
}

/// A scenario of another duration, without the metrics and requirements whose windows may be beyond it and without
/// the parameters of laws that other binaries may not have.
fn shortened(rig: &Rig, scenario: &str, duration_s: f64) -> String {
    let text = std::fs::read_to_string(workspace().join(scenario)).expect("it is there");
    let mut table: toml::Table = text.parse().expect("TOML");
    table.remove("metrics");
    table.remove("requirements");
    let controller = table["controller"].as_table_mut().expect("a table");
    controller.retain(|_, value| !value.is_table());
    let run = table["run"].as_table_mut().expect("a table");
    run.insert("duration_s".into(), duration_s.into());
    let path = rig.write("shortened.toml", &table.to_string());
    path.display().to_string()
}

#[test]
fn every_law_goes_on_in_the_middle_of_the_papers_fault() {
    let rig = Rig::new();
    for law in LAWS {
        let shipped = shortened(&rig, "scenarios/severe-leakage.toml", 7.3);
        let scenario = format!("{shipped} --set controller.law={law}");
        // At the very step at which it takes hold, and soon after.
        assert_goes_on(&rig, &scenario, &[7.0, 7.0001, 7.05], law);
    }
}

#[test]
fn every_kind_of_fault_goes_on_across_a_checkpoint() {
    let rig = Rig::new();
    let text = std::fs::read_to_string(workspace().join(SCENARIO)).expect("the scenario");
    for fault in faults() {
        let path = rig.write("faulted.toml", &with_fault(&text, &fault, 0.1));
        let scenario = format!(
            "{} --set run.duration_s=0.2 --set faults[0].at_s=0.11",
            path.display()
        );
        assert_goes_on(&rig, &scenario, &[0.1, 0.1001, 0.1234], &fault.kind);
    }
}

const MOVING: &str = r#"
schema = 1
name = "moving"
[run]
duration_s = 1.0
rate_hz = 1000
seed = 7
[plant]
model = "spring-mass"
[[stimuli]]
target = "position_m"
kind = "sine"
amplitude = 0.01
frequency_hz = 2
"#;

/// What makes it moving: keys of the controller and faults.
const CASES: [(&str, &str, &str); 13] = [
    ("a slow law", "rate_hz = 500", ""),
    ("a late command", "command_delay_steps = 1", ""),
    (
        "a slow law and a late command",
        "rate_hz = 200\ncommand_delay_steps = 1",
        "",
    ),
    (
        "conditions that must hold for a while",
        "",
        r#"
        [[faults]]
        kind = "stuck"
        when = "truth.position_m > 0.003"
        for_s = 0.05
        until = "truth.velocity_mps < 0"
        until_for_s = 0.07
        [[faults.effects]]
        target = "measured.velocity_mps"
        "#,
    ),
    (
        "one that follows another, and effects with a skew",
        "",
        r#"
        [[faults]]
        name = "first"
        kind = "bias"
        at_s = 0.2
        [[faults.effects]]
        target = "measured.position_m"
        bias = 1e-3
        [[faults.effects]]
        target = "command.force_n"
        bias = 0.1
        skew_s = 0.3
        [[faults]]
        kind = "scale"
        after = "first"
        delay_s = 0.25
        duration_s = 0.2
        [[faults.effects]]
        target = "reference.position_m"
        factor = 1.5
        profile = { kind = "ramp", duration_s = 0.1 }
        "#,
    ),
    (
        "faults that end after they acted often enough",
        "",
        r#"
        [[faults]]
        kind = "spike"
        at_s = 0.1
        occurrences = 3
        [[faults.effects]]
        target = "measured.position_m"
        amplitude = 0.01
        period_s = 0.2
        width_s = 0.05
        [[faults]]
        kind = "message-loss"
        at_s = 0.1
        occurrences = 100
        [[faults.effects]]
        target = "link.sample"
        probability = 0.3
        "#,
    ),
    (
        "messages under way in both directions",
        "",
        r#"
        [[faults]]
        kind = "message-delay"
        at_s = 0.1
        [[faults.effects]]
        target = "link.sample"
        steps = 30
        profile = { kind = "sine", frequency_hz = 3 }
        [[faults]]
        kind = "dropout"
        at_s = 0.1
        [[faults.effects]]
        target = "measured.velocity_mps"
        profile = { kind = "intermittent", period_s = 0.01, duty = 0.5 }
        [[faults]]
        kind = "message-jitter"
        at_s = 0.2
        [[faults.effects]]
        target = "link.sample"
        steps = 20
        [[faults]]
        kind = "message-reordering"
        at_s = 0.15
        [[faults.effects]]
        target = "link.command"
        probability = 0.5
        [[faults]]
        kind = "message-duplication"
        at_s = 0.25
        [[faults.effects]]
        target = "link.command"
        probability = 0.5
        lag_steps = 25
        [[faults]]
        kind = "message-corruption"
        at_s = 0.3
        [[faults.effects]]
        target = "link.command"
        probability = 0.2
        bits = 3
        "#,
    ),
    (
        "a medium that was late and is not any more",
        "",
        r#"
        [[faults]]
        kind = "message-delay"
        at_s = 0.1
        duration_s = 0.15
        [[faults.effects]]
        target = "link.sample"
        steps = 60
        [[faults]]
        kind = "message-loss"
        at_s = 0.12
        duration_s = 0.3
        [[faults.effects]]
        target = "link.sample"
        pattern = [0, 1, 1]
        "#,
    ),
    (
        "a controller that misses steps and takes its time",
        "command_delay_steps = 1",
        r#"
        [[faults]]
        kind = "skip"
        at_s = 0.1
        [[faults.effects]]
        target = "controller"
        steps = 23
        burst = 2
        period_steps = 60
        [[faults]]
        kind = "late"
        at_s = 0.2
        [[faults.effects]]
        target = "controller"
        busy_us = 1
        spread_us = 3
        "#,
    ),
    (
        "numbers that stand still, come late and come back",
        "",
        r#"
        [[faults]]
        kind = "stuck"
        at_s = 0.1
        [[faults.effects]]
        target = "measured.position_m"
        profile = { kind = "intermittent", period_s = 0.2, duty = 0.6 }
        [[faults]]
        kind = "delay"
        at_s = 0.15
        [[faults.effects]]
        target = "measured.velocity_mps"
        steps = 90
        [[faults]]
        kind = "dropout"
        at_s = 0.2
        [[faults.effects]]
        target = "command.force_n"
        profile = { kind = "intermittent", period_s = 0.3, duty = 0.5 }
        "#,
    ),
    (
        "signals that are not valid",
        "",
        r#"
        [[faults]]
        kind = "dropout"
        at_s = 0.1
        [[faults.effects]]
        target = "measured.position_m"
        profile = { kind = "intermittent", period_s = 0.16, duty = 0.5 }
        "#,
    ),
    (
        "noise, twice on one signal",
        "",
        r#"
        [[faults]]
        kind = "noise"
        at_s = 0.1
        [[faults.effects]]
        target = "measured.position_m"
        standard_deviation = 1e-4
        [[faults.effects]]
        target = "measured.position_m"
        standard_deviation = 1e-5
        "#,
    ),
    (
        "parameters that move and heal",
        "",
        r#"
        [[faults]]
        kind = "stiffness-loss"
        at_s = 0.1
        duration_s = 0.5
        [[faults.effects]]
        factor = 0.5
        profile = { kind = "ramp", duration_s = 0.3 }
        [[faults]]
        kind = "noise"
        at_s = 0.3
        [[faults.effects]]
        target = "parameter.disturbance_n"
        standard_deviation = 0.1
        "#,
    ),
];

/// The scenario of a case.
fn moving(controller: &str, faults: &str) -> String {
    format!("{MOVING}\n[controller]\nlaw = \"pid\"\n{controller}\n{faults}")
}

#[test]
fn whatever_waits_acts_and_is_under_way_goes_on() {
    let rig = Rig::new();
    for (about, controller, faults) in CASES {
        let path = rig.write("moving.toml", &moving(controller, faults));
        let times_s = [0.1, 0.101, 0.157, 0.208, 0.26, 0.333, 0.471, 0.62, 0.803];
        assert_goes_on(&rig, &path.display().to_string(), &times_s, about);
    }
}

#[test]
fn any_step_can_be_gone_on_from() {
    let rig = Rig::new();
    let all: String = CASES.iter().map(|(.., faults)| *faults).collect();
    let path = rig.write(
        "moving.toml",
        &moving("rate_hz = 500\ncommand_delay_steps = 1", &all),
    );
    let mut random = RandomStream::new(1, "checkpoints");
    let times_s: Vec<f64> = (0..30).map(|_| 1e-3 + 0.998 * random.uniform()).collect();
    let mut steps: Vec<u64> = times_s
        .iter()
        .map(|at_s| (at_s * 1e3).ceil() as u64)
        .collect();
    steps.sort_unstable();
    steps.dedup();
    let times_s: Vec<f64> = steps.iter().map(|step| *step as f64 / 1e3).collect();
    assert_goes_on(
        &rig,
        &path.display().to_string(),
        &times_s,
        "all faults at once",
    );
}

#[test]
fn a_branch_with_another_severity_has_the_same_past_and_another_future() {
    let rig = Rig::new();
    let straight = rig
        .run(&format!("{SCENARIO} --checkpoint-at 1.05"))
        .expect(0);
    let branch = go_on(&rig, &straight, 10_500, &format!("--set {SEVERITY}=2e-7")).expect(0);
    let recordings = [&straight, &branch].map(|run| Recording::open(&run.recording()));
    let [theirs, ours] = recordings.each_ref().map(Recording::records);
    let differs = theirs
        .zip(ours)
        .position(|(theirs, ours)| theirs.words != ours.words);
    assert_eq!(differs, Some(10_500));
    let coefficient = |recording: &Recording, step: usize| {
        let name = "truth.actuator1_leakage_coefficient_m3ps_per_sqrt_pa";
        let record = recording.records().nth(step).expect("a record");
        recording.value(&record, name)
    };
    // 1 - exp(-10 / s x 0.05 s) of the new size, where the old one had got to as much of its own.
    let gain = 1.0 - libm::exp(-0.5);
    for (recording, size) in recordings.iter().zip([5e-7, 2e-7]) {
        let found = coefficient(recording, 10_500);
        assert!((found / (size * gain) - 1.0).abs() < 1e-12, "{found}");
    }
    assert_eq!(branch.summary()["resumed"]["changed_faults"][0], 1);

    let run = branch.folder.display().to_string();
    for command in [&["rerun", &run][..], &["scenario", "from", &run]] {
        rig.hil(command)
            .expect(2)
            .says(&["other sizes of fault 1", "hil run --from"]);
    }
}

#[test]
fn a_branch_whose_fault_had_not_begun_is_the_straight_run_of_the_other_scenario() {
    let rig = Rig::new();
    let straight = rig
        .run(&format!("{SCENARIO} --checkpoint-at 0.9"))
        .expect(0);
    let changes =
        format!("--set {SEVERITY}=3e-7 --set faults[0].at_s=0.95 --set run.duration_s=1.3");
    let branch = go_on(&rig, &straight, 9000, &changes).expect(0);
    let other = rig.run(&format!("{SCENARIO} {changes}")).expect(0);
    assert_same(&other, &branch, "the other scenario");
    let again = rig.path("again").display().to_string();
    let run = branch.folder.display().to_string();
    rig.hil(&["rerun", &run, "--out", &again]).expect(0);
}

#[test]
fn a_run_that_went_on_can_be_gone_on_from_again() {
    let rig = Rig::new();
    let straight = rig
        .run(&format!("{SCENARIO} --checkpoint-at 0.5"))
        .expect(0);
    let second = go_on(
        &rig,
        &straight,
        5000,
        "--checkpoint-at 1.05 --checkpoint-at 1.5",
    )
    .expect(0);
    assert_eq!(made(&second), [10_500, 15_000]);
    let third = go_on(&rig, &second, 10_500, "").expect(0);
    assert_same(&straight, &third, "the third part");
    assert_eq!(third.summary()["resumed"]["step"], 10_500);
}

#[test]
fn live_faults_go_on_and_one_accepted_after_the_checkpoint_does_not() {
    let rig = Rig::new();
    let session = rig.session();
    let run = rig.start(&format!(
        "{SCENARIO} --pause-at 0.5 --checkpoint-at 0.5 --checkpoint-at 0.6"
    ));
    until("the run is held", || {
        let asked = rig.beside(&["inject", "--active", "--session", session]);
        asked.code == Some(0) && asked.stdout.contains("step 5000")
    });
    let beside = |line: &str| {
        let words: Vec<&str> = line.split(' ').chain(["--session", session]).collect();
        rig.beside(&words).expect(0);
    };
    beside("inject bias measured.surface_angle_rad 1e-5");
    beside("inject stuck measured.actuator1_velocity_mps --at 0.7");
    beside(
        "inject noise measured.actuator2_velocity_mps 1e-6 --when truth.surface_angle_rad>0.001 --for 1ms",
    );
    beside("inject bias measured.actuator2_position_m 1e-7 --at 0.9");
    beside("inject --clear 5");
    beside("resume");
    let straight = run.finish().expect(0);
    assert_eq!(
        straight.summary()["faults"].as_array().map(Vec::len),
        Some(5)
    );
    let resumed = go_on(&rig, &straight, 6000, "").expect(0);
    assert_same(&straight, &resumed, "with live faults");
    // They were accepted before step 5000, but after the checkpoint there.
    let without = go_on(&rig, &straight, 5000, "").expect(0);
    assert_eq!(without.digest(), rig.run(SCENARIO).expect(0).digest());
    let folder = resumed.folder.display().to_string();
    let again = rig.path("again").display().to_string();
    rig.hil(&["rerun", &folder, "--out", &again]).expect(0);
}

#[test]
fn what_contradicts_the_past_is_refused_and_named() {
    let rig = Rig::new();
    let run = rig
        .run(&format!(
            "{SCENARIO} --checkpoint-at 1.05 --link in-process"
        ))
        .expect(0);
    for (change, told) in [
        ("run.rate_hz=20000", "run.rate_hz was 10000 and stays"),
        ("run.seed=2", "run.seed was 1 and stays"),
        (
            "run.duration_s=1.02",
            "run.duration_s ends it at step 10200",
        ),
        ("run.clock=realtime", "real time"),
        ("plant.model=spring-mass", ""),
        ("plant.substeps=5", "plant.substeps stays"),
        (
            "plant.parameters.actuator1.piston_mass_kg=56",
            "piston_mass_kg was 55 and stays, 56",
        ),
        ("controller.law=nrsc", "controller.law stays"),
        ("controller.rate_hz=5000", "controller.rate_hz stays"),
        (
            "controller.command_delay_steps=1",
            "controller.command_delay_steps stays",
        ),
        (
            "controller.ftsc.trajectory.angle_gain_per_s=3",
            "angle_gain_per_s was",
        ),
        ("stimuli[0].amplitude=0.3", "already at step 0 "),
        ("faults[0].at_s=1.2", "has acted since step 10000 (1 s)"),
        ("faults[0].end_s=1.2", "has acted since step 10000 (1 s)"),
        (
            "faults[0].effects[1].speed_per_s=2",
            "has acted since step 10000 (1 s)",
        ),
        ("faults[0].effects[1].actuator=1", ""),
    ] {
        let refused = go_on(&rig, &run, 10_500, &format!("--set {change}")).expect(2);
        assert!(
            refused.stderr.contains(told),
            "{change}: {}",
            refused.stderr
        );
        assert!(!refused.folder.exists(), "{change}");
    }
    let early = rig
        .run(&format!("{SCENARIO} --checkpoint-at 0.5 --link in-process"))
        .expect(0);
    go_on(&rig, &early, 5000, "--set faults[0].at_s=0.3")
        .expect(2)
        .says(&["would have begun at step 3000 (0.3 s)", "step 5000 (0.5 s)"]);
}

#[test]
fn a_reference_signal_may_change_from_the_checkpoint_on() {
    let rig = Rig::new();
    let shipped = shortened(&rig, "scenarios/spring-mass.toml", 1.5);
    let run = rig.run(&format!("{shipped} --checkpoint-at 0.4")).expect(0);
    let branch = go_on(&rig, &run, 400, "--set stimuli[0].after=0.02").expect(0);
    let other = rig
        .run(&format!("{shipped} --set stimuli[0].after=0.02"))
        .expect(0);
    assert_same(&other, &branch, "another goal");
    go_on(&rig, &run, 400, "--set stimuli[0].at_s=0.3")
        .expect(2)
        .says(&["position_m would have been another already at step 300 (0.3 s)"]);
}

#[test]
fn what_cannot_be_asked_for_is_refused_before_anything_starts() {
    let rig = Rig::new();
    let foreign = program_of_tests("clock-reading-controller");
    let honest = format!("{MOVING}[controller]\nlaw = \"honest\"\n");
    let honest = rig.write("honest.toml", &honest);
    let (foreign, honest) = (foreign.display(), honest.display());
    for (arguments, told) in [
        (
            format!("{SCENARIO} --checkpoint-at 0"),
            "not after the begin of the run at 0 s",
        ),
        (
            format!("{SCENARIO} --checkpoint-at 2"),
            "not before the end of the run at 2 s",
        ),
        (
            format!("{SCENARIO} --checkpoint-at soon"),
            "no length of time",
        ),
        (
            format!("{SCENARIO} --checkpoint-at 1 --no-record"),
            "leave out --no-record",
        ),
        (
            format!("{SCENARIO} --checkpoint-at 1 --clock realtime"),
            "--clock lockstep or paced",
        ),
        (
            format!("{SCENARIO} --checkpoint-at 1 --audit"),
            "leave out --checkpoint-at",
        ),
        (format!("{SCENARIO} --from tests"), "cannot be used with"),
        ("--from tests".to_owned(), "tests is no checkpoint"),
        (
            format!("{honest} --controller-bin {foreign} --checkpoint-at 0.5"),
            "law `honest` cannot save its state, so there can be no checkpoint; it needs `Controller::state`",
        ),
    ] {
        let refused = rig.run(&arguments).expect(2).says(&[told]);
        assert!(!refused.folder.exists(), "{arguments}");
    }
    let run = rig
        .run(&format!("{SCENARIO} --checkpoint-at 1 --link in-process"))
        .expect(0);
    let folder = run.folder.display();
    rig.run(&format!("--from {folder}"))
        .expect(2)
        .says(&["those of this run:", "checkpoint-10000"]);
    let again = "not after the begin of the run at 1 s";
    go_on(&rig, &run, 10_000, "--checkpoint-at 1")
        .expect(2)
        .says(&[again]);
}

#[test]
fn a_fault_from_outside_that_cannot_be_saved_is_refused_in_a_scenario_and_live() {
    let rig = Rig::new();
    let plant = example("own-fault");
    let plant = plant.display();
    let told = "cannot save its state";
    let scenario = "examples/own-fault/backlash.toml";
    rig.run(&format!(
        "{scenario} --plant-bin {plant} --checkpoint-at 0.5"
    ))
    .expect(2)
    .says(&["fault `backlash`", told, "FaultKind::state"]);
    let arguments = format!("{SCENARIO} --plant-bin {plant} --checkpoint-at 1 --pause-at 0.5");
    let run = rig.start(&arguments);
    let session = rig.session();
    until("the run is held", || {
        let asked = rig.beside(&["inject", "--active", "--session", session]);
        asked.code == Some(0) && asked.stdout.contains("step 5000")
    });
    let inject = "inject backlash measured.actuator1_position_m 2e-4 --session";
    let words: Vec<&str> = inject.split(' ').chain([session]).collect();
    rig.beside(&words).expect(2).says(&["backlash", told]);
    rig.beside(&["resume", "--session", session]).expect(0);
    assert_eq!(made(&run.finish().expect(0)), [10_000]);
}

#[test]
fn a_plant_of_ones_own_goes_on() {
    let rig = Rig::new();
    // A copy: another test may build the example anew meanwhile.
    let plant = rig.path("own-plant");
    std::fs::copy(example("own-plant"), &plant).expect("copied");
    let shipped = shortened(&rig, "examples/own-plant/pendulum.toml", 1.0);
    let scenario = format!(
        "{shipped} --set controller.law=hold --set plant.parameters.initial_angle_rad=1e-3"
    );
    let controller = program("controller-process");
    let scenario = format!(
        "{scenario} --plant-bin {} --controller-bin {}",
        plant.display(),
        controller.display()
    );
    let straight = rig
        .run(&format!("{scenario} --checkpoint-at 0.1"))
        .expect(0);
    for arguments in [format!("--plant-bin {}", plant.display()), String::new()] {
        let resumed = go_on(&rig, &straight, 100, &arguments).expect(0);
        assert_same(&straight, &resumed, "the pendulum");
    }
    let other = format!("--plant-bin {}", program("plant-process").display());
    go_on(&rig, &straight, 100, &other)
        .expect(2)
        .says(&["is not the binary that saved"]);
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("a file");
        }
    }
}

#[test]
fn a_damaged_checkpoint_is_refused_by_name() {
    let rig = Rig::new();
    let run = rig
        .run(&format!(
            "{SCENARIO} --checkpoint-at 1.05 --link in-process"
        ))
        .expect(0);
    type Damage = fn(&mut Vec<u8>);
    let shorter: Damage = |bytes| bytes.truncate(bytes.len() - 9);
    let empty: Damage = Vec::clear;
    let flipped: Damage = |bytes| {
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
    };
    let replaced: Damage = |bytes| {
        let text = String::from_utf8(std::mem::take(bytes)).expect("text");
        *bytes = text.replace("\"schema\": 1", "\"schema\": 9").into_bytes();
    };
    let cases = [
        (
            "checkpoint-10500/plant.state",
            shorter,
            "plant.state is damaged",
        ),
        (
            "checkpoint-10500/plant.state",
            flipped,
            "plant.state is damaged",
        ),
        (
            "checkpoint-10500/controller.state",
            flipped,
            "controller.state is damaged",
        ),
        (
            "checkpoint-10500/controller.state",
            empty,
            "controller.state is damaged",
        ),
        (
            "checkpoint-10500/checkpoint.json",
            shorter,
            "checkpoint.json: ",
        ),
        ("checkpoint-10500/checkpoint.json", replaced, "form 9"),
        ("run.mcap", empty, "run.mcap"),
        (
            "run.mcap",
            |bytes| bytes.truncate(bytes.len() / 3),
            "10500 were before it",
        ),
    ];
    for (file, damage, told) in cases {
        let folder = rig.path("damaged");
        copy(&run.folder, &folder);
        let path = folder.join(file);
        let mut bytes = std::fs::read(&path).expect("it is there");
        damage(&mut bytes);
        std::fs::write(&path, bytes).expect("it can be written");
        let from = folder.join("checkpoint-10500");
        rig.run(&format!("--from {}", from.display()))
            .expect(2)
            .says(&[told]);
        std::fs::remove_dir_all(folder).expect("it is ours");
    }
    // Of a run whose recording goes on differently the records before it are still the same.
    let moved = rig.path("moved");
    copy(&run.folder, &moved);
    let from = moved.join("checkpoint-10500");
    let resumed = rig.run(&format!("--from {}", from.display())).expect(0);
    assert_same(&run, &resumed, "a run's folder can be moved");
    let other = rig
        .run(&format!("{SCENARIO} --set run.seed=2 --link in-process"))
        .expect(0);
    std::fs::copy(other.recording(), moved.join("run.mcap")).expect("copied");
    rig.run(&format!("--from {}", from.display()))
        .expect(2)
        .says(&["the scenario in", "is not that of the checkpoint"]);
}
