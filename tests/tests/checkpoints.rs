//! A resumed run equals the uninterrupted one; a branch shares its past but not its future; a run that cannot be
//! resumed is refused before anything starts.

mod moving;
mod refusals;

use std::fmt::Write as _;
use std::path::PathBuf;

use serde_json::Value;

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{example, program, shipped};
use crate::tried_faults::{LAWS, faults, with_fault};

/// Two seconds under FTSC; both actuators begin to leak at 1 s.
const SCENARIO: &str = "tests/scenarios/leakage.toml";

const SEVERITY: &str = "faults[0].effects[0].coefficient_m3ps_per_sqrt_pa";

/// Returns the folder of a run's checkpoint before a step.
fn checkpoint(run: &Run, step: u64) -> PathBuf {
    run.folder.join(format!("checkpoint-{step}"))
}

/// Resumes a run from its checkpoint before a step.
fn go_on(rig: &Rig, run: &Run, step: u64, arguments: &str) -> Run {
    let from = checkpoint(run, step);
    rig.run(&format!("--from {} {arguments}", from.display()))
}

/// Returns the parts of a summary about the run itself, not about the session or clocks.
fn judged(run: &Run) -> Vec<Value> {
    let mut summary = run.summary();
    // The lateness of a side was measured.
    for fault in summary["faults"].as_array_mut().expect("a list") {
        for effect in fault["effects"].as_array_mut().expect("a list") {
            if effect["unit"] == "ns" {
                let late_ns = effect["max_effect"].take();
                assert!(late_ns.as_f64() > Some(0.0), "{late_ns}");
            }
        }
    }
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

/// Returns the ages of both sides' data at each step: not in the digest, but equal as well.
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

/// Lists the steps of a run's checkpoints.
fn made(run: &Run) -> Vec<u64> {
    let summary = run.summary();
    let made = summary["checkpoints"].as_array().expect("a list");
    made.iter()
        .map(|made| made["step"].as_u64().expect("a step"))
        .collect()
}

/// Lists the results of the checks of a run's checkpoints.
fn checks(run: &Run) -> Vec<String> {
    let summary = run.summary();
    let made = summary["checkpoints"].as_array().expect("a list");
    let text = |made: &Value| made["check"]["text"].as_str().map(str::to_owned);
    made.iter()
        .map(|made| text(made).expect("a check"))
        .collect()
}

/// Runs a scenario in one thread with checkpoints at these times, and resumes it from each.
#[track_caller]
fn assert_goes_on(rig: &Rig, scenario: &str, times_s: &[f64], about: &str) {
    let mut arguments = format!("{scenario} --link in-process");
    for time_s in times_s {
        let _ = write!(arguments, " --checkpoint-at {time_s}");
    }
    let straight = rig.run(&arguments).expect(0);
    let steps = made(&straight);
    assert_eq!(steps.len(), times_s.len(), "{about}");
    for check in checks(&straight) {
        assert!(check.starts_with("exact for "), "{about}: {check}");
    }
    for step in steps {
        let resumed = go_on(rig, &straight, step, "--link in-process").expect(0);
        assert_same(&straight, &resumed, &format!("{about}, from step {step}"));
        assert_eq!(ages(&resumed), ages(&straight), "{about}, from step {step}");
        std::fs::remove_dir_all(&resumed.folder).expect("it is ours");
    }
}

#[test]
fn a_resumed_run_equals_the_uninterrupted_one_over_any_link() {
    let rig = Rig::new();
    let without = rig.run(&format!("{SCENARIO} --no-record")).expect(0);
    for made_over in ["iceoryx2", "in-process"] {
        let arguments = format!("{SCENARIO} --checkpoint-at 1.05 --link {made_over}");
        let straight = rig.run(&arguments).expect(0);
        assert_eq!(checks(&straight), ["exact for 100 steps"]);
        assert_same(&without, &straight, "a checkpoint changes nothing");
        for link in ["iceoryx2", "in-process"] {
            let about = format!("from {made_over} on over {link}");
            let resumed = go_on(&rig, &straight, 10_500, &format!("--link {link}")).expect(0);
            assert_same(&straight, &resumed, &about);
            let summary = resumed.summary();
            assert_eq!(summary["resumed"]["step"], 10_500, "{about}");
            // Latency covers this run alone: the past was measured in another.
            let count = &summary["latency_ns"]["round_trip"]["count"];
            assert_eq!(count.as_u64(), Some(20_000 - 10_500), "{about}");
            let folder = resumed.folder.display().to_string();
            let read = rig.hil(&["latency", &folder, "--json"]).expect(0).json();
            for (figure, leg) in [("round_trip_ns", "round_trip"), ("plant_ns", "plant")] {
                assert_eq!(read[figure], summary["latency_ns"][leg], "{about}");
            }
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
fn a_paced_run_resumes_at_its_checkpoint() {
    let rig = Rig::new();
    let straight = rig
        .run(&format!("{SCENARIO} --pace 8 --checkpoint-at 0.6"))
        .expect(0);
    let resumed = go_on(&rig, &straight, 6000, "").expect(0);
    assert_same(&straight, &resumed, "paced");
    assert_eq!(resumed.summary()["clock"], "paced");
}

/// Returns a scenario of another duration, without metrics and requirements whose windows would exceed it and
/// without the parameters of laws that other binaries may lack.
fn shortened(rig: &Rig, scenario: &str, duration_s: f64) -> String {
    let text = shipped(scenario);
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
fn every_law_resumes_in_the_middle_of_the_papers_fault() {
    for law in LAWS {
        let rig = Rig::new();
        let shipped = shortened(&rig, "scenarios/severe-leakage.toml", 7.3);
        let scenario = format!("{shipped} --set controller.law={law}");
        // At the very step at which it takes effect, and soon after.
        assert_goes_on(&rig, &scenario, &[7.0, 7.0001, 7.05], law);
    }
}

#[test]
fn every_kind_of_fault_continues_across_a_checkpoint() {
    let text = shipped(SCENARIO);
    for fault in faults() {
        let rig = Rig::new();
        let path = rig.write("faulted.toml", &with_fault(&text, &fault, 0.1));
        let scenario = format!(
            "{} --set run.duration_s=0.2 --set faults[0].at_s=0.11",
            path.display()
        );
        assert_goes_on(&rig, &scenario, &[0.1, 0.1001, 0.1234], &fault.kind);
    }
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
    // 1 - exp(-10 / s x 0.05 s) of the new size, where the old one had reached as much of its own.
    let gain = 1.0 - libm::exp(-0.5);
    for (recording, size) in recordings.iter().zip([5e-7, 2e-7]) {
        let result = coefficient(recording, 10_500);
        assert!((result / (size * gain) - 1.0).abs() < 1e-12, "{result}");
    }
    assert_eq!(branch.summary()["resumed"]["changed_faults"][0], 1);

    let run = branch.folder.display().to_string();
    for command in [&["rerun", &run][..], &["scenario", "from", &run]] {
        rig.hil(command)
            .expect(2)
            .says(&["changed parameters of the active fault 1", "hil run --from"]);
    }
}

#[test]
fn a_branch_whose_fault_had_not_begun_equals_the_uninterrupted_run_of_the_other_scenario() {
    let rig = Rig::new();
    let straight = rig
        .run(&format!("{SCENARIO} --checkpoint-at 0.9"))
        .expect(0);
    let changes =
        format!("--set {SEVERITY}=3e-7 --set faults[0].at_s=0.95 --set run.duration_s=1.3");
    let branch = go_on(&rig, &straight, 9000, &changes).expect(0);
    let other = rig.run(&format!("{SCENARIO} {changes}")).expect(0);
    assert_same(&other, &branch, "the other scenario");
    rig.rerun(&branch.folder, &[]).expect(0);
}

#[test]
fn a_resumed_run_can_be_resumed_from_again() {
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
fn live_faults_continue_and_one_accepted_after_the_checkpoint_does_not() {
    let rig = Rig::new();
    let run = rig.start(&format!(
        "{SCENARIO} --pause-at 0.5 --checkpoint-at 0.5 --checkpoint-at 0.6"
    ));
    rig.until_held_at(5000);
    for line in [
        "inject bias measured.surface_angle_rad 1e-5",
        "inject stuck measured.actuator1_velocity_mps --at 0.7",
        "inject noise measured.actuator2_velocity_mps 1e-6 --when truth.surface_angle_rad>0.001 --for 1ms",
        "inject bias measured.actuator2_position_m 1e-7 --at 0.9",
        "inject --clear 5",
        "resume",
    ] {
        rig.in_session(line).expect(0);
    }
    let straight = run.finish().expect(0);
    // The first fault begins at the step of the first checkpoint.
    let [first, second] = &checks(&straight)[..] else {
        panic!("two checkpoints")
    };
    assert!(first.starts_with("not checked: "), "{first}");
    assert_eq!(second, "exact for 100 steps");
    assert_eq!(
        straight.summary()["faults"].as_array().map(Vec::len),
        Some(5)
    );
    let resumed = go_on(&rig, &straight, 6000, "").expect(0);
    assert_same(&straight, &resumed, "with live faults");
    // They were accepted before step 5000, but after the checkpoint there.
    let without = go_on(&rig, &straight, 5000, "").expect(0);
    assert_eq!(without.digest(), rig.run(SCENARIO).expect(0).digest());
    rig.rerun(&resumed.folder, &[]).expect(0);
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
        .says(&["position_m would already differ at step 300 (0.3 s)"]);
}

#[test]
fn a_run_of_a_user_plant_can_be_resumed() {
    let rig = Rig::new();
    let plant = example("own-plant");
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
