//! Digests of a scenario are equal for any number of runs, link, clock and cores, beside any other load, and for
//! every build.

use std::process::Command;

use crate::support::company::busy_loop;
use crate::support::harness::Rig;
use crate::support::mcap_reader::{Record, Recording};
use crate::support::programs::program;

/// Two seconds under FTSC; both actuators begin to leak at 1 s.
const SCENARIO: &str = "tests/scenarios/leakage.toml";

/// Returns the digest of the scenario run in one thread, where no timing can vary.
fn reference(rig: &Rig, changes: &str) -> String {
    let arguments = format!("{SCENARIO} --link in-process --no-record {changes}");
    rig.run(&arguments).expect(0).digest()
}

#[track_caller]
fn assert_same(rig: &Rig, arguments: &str) {
    let run = rig.run(&format!("{SCENARIO} {arguments}")).expect(0);
    assert_eq!(run.digest(), reference(rig, ""), "{arguments}");
}

#[test]
fn ten_runs_over_shared_memory_have_the_digest_of_one_thread() {
    let rig = Rig::new();
    let expected = reference(&rig, "");
    for run in 0..10 {
        let digest = rig.run(SCENARIO).expect(0).digest();
        assert_eq!(digest, expected, "run {run}");
    }
}

#[test]
fn concurrent_runs_in_one_process_have_the_digest_of_a_single_run() {
    let rig = Rig::new();
    let side_by_side = "--link in-process --no-record --repeat 6 --json";
    let suite = rig.run(&format!("{SCENARIO} {side_by_side}"));
    let report = suite.expect(0).json();
    let runs = report["runs"].as_array().expect("a list of runs");
    assert_eq!(runs.len(), 6);
    let expected = reference(&rig, "");
    for run in runs {
        assert_eq!(run["digest"], expected, "{run}");
    }
}

#[test]
fn a_paced_run_has_the_digest_of_lockstep() {
    assert_same(&Rig::new(), "--pace 4");
}

#[test]
fn a_paced_run_in_one_thread_has_the_digest_of_lockstep() {
    assert_same(&Rig::new(), "--pace 4 --link in-process");
}

#[test]
fn the_digest_does_not_depend_on_the_session_or_the_recording() {
    let rig = Rig::new();
    assert_same(&rig, "--no-record");
    assert_eq!(reference(&rig, ""), reference(&Rig::new(), ""));
}

#[test]
fn another_scenario_has_another_digest() {
    let rig = Rig::new();
    let expected = reference(&rig, "");
    for change in [
        "faults[0].effects[1].speed_per_s=0.50000001",
        "plant.parameters.piston_mass_kg=55.0000001",
        "controller.law=nrsc",
        "run.duration_s=1.9999",
    ] {
        assert_ne!(
            reference(&rig, &format!("--set {change}")),
            expected,
            "{change}"
        );
    }
}

/// Returns `hil` restricted to one core.
fn on_core_0(rig: &Rig) -> Command {
    let mut hil = rig.command("taskset");
    hil.args(["-c", "0"]).arg(program("hil"));
    hil
}

#[test]
fn one_core_gives_the_digest_of_two() {
    let rig = Rig::new();
    let run = rig.start_with(on_core_0(&rig), SCENARIO).finish().expect(0);
    assert_eq!(run.digest(), reference(&rig, ""));
}

#[test]
fn a_busy_core_does_not_change_the_digest() {
    let rig = Rig::new();
    let _busy = busy_loop(1);
    assert_same(&rig, "");
}

#[test]
fn a_busy_single_core_does_not_change_the_digest() {
    let rig = Rig::new();
    // 1,000 steps: each exchange waits until the busy loop has had its turn.
    let changes = "--set run.duration_s=0.1 --set faults[0].at_s=0.05";
    let expected = reference(&rig, changes);
    let _busy = busy_loop(0);
    let arguments = format!("{SCENARIO} {changes}");
    let run = rig
        .start_with(on_core_0(&rig), &arguments)
        .finish()
        .expect(0);
    assert_eq!(run.summary()["steps"], 1000);
    assert_eq!(run.digest(), expected);
}

#[test]
fn a_recording_proves_its_digest() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let recording = Recording::open(&run.recording());
    assert_eq!(recording.digest(|_| ()), run.digest());
}

#[test]
fn one_flipped_bit_changes_the_digest() {
    let rig = Rig::new();
    let changes = "--set run.duration_s=0.1 --set faults[0].at_s=0.05 --link in-process";
    let run = rig.run(&format!("{SCENARIO} {changes}")).expect(0);
    let recording = Recording::open(&run.recording());
    let flipped = |step: u64, column: &str| {
        let place = recording.place(column);
        recording.digest(|record: &mut Record| {
            if record.step() == step && record.words[0] == step {
                record.words[place] ^= 1;
            }
        })
    };
    for column in [
        "sample_invalid[0]",
        "command_invalid[0]",
        "truth.surface_angle_rad",
        "truth.force_fight_n",
        "measured.actuator1_pressure1_pa",
        "reference.surface_angle_d5_radps5",
        "command.actuator2_valve_current_a",
        "applied.actuator2_valve_current_a",
        "internal.lyapunov_v3",
    ] {
        for step in [0, 500, 1000] {
            assert_ne!(
                flipped(step, column),
                run.digest(),
                "{column} at step {step}"
            );
        }
    }
    // Measured time is not part of it.
    for column in ["published_ns", "round_trip_ns", "plant_ns"] {
        assert_eq!(flipped(500, column), run.digest(), "{column}");
    }
}

/// `.ci/run long`.
mod long {
    use super::{SCENARIO, reference};
    use crate::support::harness::Rig;
    use crate::support::programs::other_hil;

    #[test]
    #[ignore = "long: .ci/run long"]
    fn debug_and_release_have_one_digest() {
        let rig = Rig::new();
        let run = rig.start_with(rig.command(other_hil()), SCENARIO).finish();
        assert_eq!(run.expect(0).digest(), reference(&rig, ""));
    }
}
