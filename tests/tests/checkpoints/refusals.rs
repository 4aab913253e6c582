//! Checkpoints and requests that are refused by name before anything starts.

use std::path::Path;

use super::moving::MOVING;
use super::{SCENARIO, assert_same, go_on, made};
use crate::support::harness::Rig;
use crate::support::programs::{example, program_of_tests};

#[test]
fn contradictions_with_the_past_are_refused_and_named() {
    let rig = Rig::new();
    let run = rig
        .run(&format!(
            "{SCENARIO} --checkpoint-at 1.05 --link in-process"
        ))
        .expect(0);
    #[rustfmt::skip] // a table
    let cases = [
        ("run.rate_hz=20000", "run.rate_hz must stay 10000"),
        ("run.seed=2", "run.seed must stay 1"),
        ("run.duration_s=1.02", "run.duration_s ends the run at step 10200"),
        ("run.clock=realtime", "real time"),
        ("plant.model=spring-mass", ""),
        ("plant.substeps=5", "plant.substeps must stay"),
        ("plant.parameters.actuator1.piston_mass_kg=56", "piston_mass_kg must stay 55, but is 56"),
        ("controller.law=nrsc", "controller.law must stay"),
        ("controller.rate_hz=5000", "controller.rate_hz must stay"),
        ("controller.command_delay_steps=1", "controller.command_delay_steps must stay"),
        ("controller.ftsc.trajectory.angle_gain_per_s=3", "angle_gain_per_s must stay"),
        ("stimuli[0].amplitude=0.3", "would already differ at step 0 "),
        ("faults[0].at_s=1.2", "has been active since step 10000 (1 s)"),
        ("faults[0].end_s=1.2", "has been active since step 10000 (1 s)"),
        ("faults[0].effects[1].speed_per_s=2", "has been active since step 10000 (1 s)"),
        ("faults[0].effects[1].actuator=1", ""),
    ];
    for (change, expected) in cases {
        let refused = go_on(&rig, &run, 10_500, &format!("--set {change}"))
            .expect(2)
            .says(&[expected]);
        assert!(!refused.folder.exists(), "{change}");
    }
    // Errors of one side do not hide those of the other.
    let both = "--set plant.parameters.actuator1.piston_mass_kg=56 \
        --set controller.ftsc.trajectory.angle_gain_per_s=3";
    let expected = [
        "piston_mass_kg must stay 55, but is 56",
        "angle_gain_per_s must stay",
    ];
    let refused = go_on(&rig, &run, 10_500, both).expect(2).says(&expected);
    assert!(!refused.folder.exists());
    let early = rig
        .run(&format!("{SCENARIO} --checkpoint-at 0.5 --link in-process"))
        .expect(0);
    go_on(&rig, &early, 5000, "--set faults[0].at_s=0.3")
        .expect(2)
        .says(&["would have begun at step 3000 (0.3 s)", "step 5000 (0.5 s)"]);
}

#[test]
fn impossible_requests_are_refused_before_anything_starts() {
    let rig = Rig::new();
    let foreign = program_of_tests("clock-reading-controller");
    let stateless = format!("{MOVING}[controller]\nlaw = \"reads-clock\"\n");
    let stateless = rig.write("stateless.toml", &stateless);
    let (foreign, stateless) = (foreign.display(), stateless.display());
    #[rustfmt::skip] // a table
    let cases = [
        (format!("{SCENARIO} --checkpoint-at 0"), "not after the beginning of the run at 0 s"),
        (format!("{SCENARIO} --checkpoint-at 2"), "not before the end of the run at 2 s"),
        (format!("{SCENARIO} --checkpoint-at soon"), "is not a duration"),
        (format!("{SCENARIO} --checkpoint-at 1 --no-record"), "omit --no-record"),
        (format!("{SCENARIO} --checkpoint-at 1 --clock realtime"), "--clock lockstep or paced"),
        (format!("{SCENARIO} --checkpoint-at 1 --audit"), "omit --checkpoint-at"),
        (format!("{SCENARIO} --from tests"), "cannot be used with"),
        ("--from tests".to_owned(), "tests is not a checkpoint"),
        (
            format!("{stateless} --controller-bin {foreign} --checkpoint-at 0.5"),
            "law `reads-clock` cannot save its state, so there can be no checkpoint; it needs `Controller::state`",
        ),
    ];
    for (arguments, expected) in cases {
        let refused = rig.run(&arguments).expect(2).says(&[expected]);
        assert!(!refused.folder.exists(), "{arguments}");
    }
    let run = rig
        .run(&format!("{SCENARIO} --checkpoint-at 1 --link in-process"))
        .expect(0);
    let folder = run.folder.display();
    rig.run(&format!("--from {folder}"))
        .expect(2)
        .says(&["those of this run:", "checkpoint-10000"]);
    let again = "not after the beginning of the run at 1 s";
    go_on(&rig, &run, 10_000, "--checkpoint-at 1")
        .expect(2)
        .says(&[again]);
}

#[test]
fn an_external_fault_without_saved_state_is_refused_in_a_scenario_and_live() {
    let rig = Rig::new();
    let plant = example("own-fault");
    let plant = plant.display();
    let expected = "cannot save its state";
    let scenario = "examples/own-fault/gear-play.toml";
    rig.run(&format!(
        "{scenario} --plant-bin {plant} --checkpoint-at 0.5"
    ))
    .expect(2)
    .says(&["fault `gear-play`", expected, "FaultKind::state"]);
    let arguments = format!("{SCENARIO} --plant-bin {plant} --checkpoint-at 1 --pause-at 0.5");
    let run = rig.start(&arguments);
    rig.until_held_at(5000);
    rig.in_session("inject gear-play measured.actuator1_position_m 2e-4")
        .expect(2)
        .says(&["gear-play", expected]);
    rig.in_session("resume").expect(0);
    assert_eq!(made(&run.finish().expect(0)), [10_000]);
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
    #[rustfmt::skip] // a table
    let cases = [
        ("checkpoint-10500/plant.state", shorter, "plant.state is damaged"),
        ("checkpoint-10500/plant.state", flipped, "plant.state is damaged"),
        ("checkpoint-10500/controller.state", flipped, "controller.state is damaged"),
        ("checkpoint-10500/controller.state", empty, "controller.state is damaged"),
        ("checkpoint-10500/checkpoint.json", shorter, "checkpoint.json: "),
        ("checkpoint-10500/checkpoint.json", replaced, "schema 9"),
        ("run.mcap", empty, "run.mcap"),
        ("run.mcap", |bytes| bytes.truncate(bytes.len() / 3), "10500 precede the checkpoint"),
    ];
    for (file, damage, expected) in cases {
        let folder = rig.path("damaged");
        copy(&run.folder, &folder);
        let path = folder.join(file);
        let mut bytes = std::fs::read(&path).expect("it is there");
        damage(&mut bytes);
        std::fs::write(&path, bytes).expect("it can be written");
        let from = folder.join("checkpoint-10500");
        rig.run(&format!("--from {}", from.display()))
            .expect(2)
            .says(&[expected]);
        std::fs::remove_dir_all(folder).expect("it is ours");
    }
    // If a recording continues differently, the records before the checkpoint are still the same.
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
