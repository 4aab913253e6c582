//! Invalid and old signals, from the plant's sensor and the law's command to the verdict.
//!
//! The plant is `tests/shared/patchy_plant.rs`, the law `tests/shared/watchful_law.rs`. Expected values come from a loop
//! over the formula of both.

#[path = "../shared/patchy_plant.rs"]
mod patchy_plant;
#[path = "../shared/watchful_law.rs"]
mod watchful_law;

use std::path::Path;

use controller_process::controller::LawKind;
use controller_process::runner::Runner;
use hil_config::plan::{Clock, PlantPlan, Run as RunPlan};
use plant_process::engine::{Engine, Progress};
use plant_process::faults::kinds;
use plant_process::plant::PlantKind;
use serde_json::Value;
use shared_types::describe::Settings;
use shared_types::digest::Digest;
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::link::in_process::pair;
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;
use shared_types::record::RecordLayout;
use shared_types::stream::{Item, RecordSource, in_process};
use shared_types::time::Rate;

use crate::support::board::Board;
use crate::support::harness::{Rig, Run, text};
use crate::support::programs::program_of_tests;
use patchy_plant::{EVERY, GAP};
use watchful_law::HELD;

const STEPS: u64 = 100;
const RATE_HZ: f64 = 100.0;

pub(crate) const SCENARIO: &str = r#"
schema = 1
name = "patchy"
run = { duration_s = 1.0, rate_hz = 100 }
plant.model = "patchy"
controller.law = "watchful"

[[metrics]]
name = "share_valid"
expression = "mean(valid(measured.position_m))"

[[metrics]]
name = "share_refreshed"
expression = "mean(valid(command.rate_mps))"

[[requirements]]
name = "never_older_than_150_ms"
formula = "always once[0s,150ms](valid(measured.position_m) > 0.5)"

[[requirements]]
name = "never_older_than_140_ms"
formula = "always once[0s,140ms](valid(measured.position_m) > 0.5)"

[[requirements]]
name = "always_measured"
formula = "always(measured.position_m < 5)"

[[requirements]]
name = "rate_is_fresh"
formula = "always(measured.rate_mps_age_steps < 4)"
"#;

/// Signals of a step.
#[derive(Clone, Debug, PartialEq)]
struct Expected {
    /// Invalid bits of position, rate and age, and of command and internals.
    invalid: [u64; 2],
    truth: f64,
    measured: [f64; 3],
    command: f64,
    applied: f64,
    internals: [f64; 3],
}

/// Computes every step from the formulas.
fn expected() -> Vec<Expected> {
    let (mut x, mut last_x, mut command, mut sampled) = (0.0, 0.0, 0.0, 0.0);
    let step = |k: u64| {
        if k > 0 {
            x += 1.0 / RATE_HZ * command;
            if k.is_multiple_of(EVERY) {
                sampled = command;
            }
        }
        let (is_valid, is_refreshed) = (!GAP.contains(&k), !HELD.contains(&k));
        if is_valid {
            last_x = x;
        }
        if is_refreshed {
            command = 1.0 - last_x;
        }
        let position_age = if is_valid { 0 } else { k + 1 - GAP.start };
        let age = (k % EVERY) as f64;
        Expected {
            invalid: [u64::from(!is_valid), u64::from(!is_refreshed)],
            truth: x,
            measured: [last_x, sampled, age],
            command,
            applied: command,
            internals: [if is_valid { 1.0 } else { 0.0 }, position_age as f64, age],
        }
    };
    (0..STEPS).map(step).collect()
}

/// Runs both sides in one thread; returns the steps and the digest.
fn in_one_process() -> (Vec<Expected>, String) {
    let rate = Rate::new(RATE_HZ).expect("legal");
    let run = RunPlan {
        rate,
        steps: STEPS,
        seed: 1,
        clock: Clock::Lockstep,
        overrun: OverrunPolicy::CatchUp,
        deadline: 0.8,
        on_controller_loss: OnLoss::Abort,
    };
    let plan = PlantPlan {
        model: "patchy".into(),
        substeps: 1,
        parameters: Settings::default(),
        limits: vec![],
        safe_command: Settings::default(),
        inputs: Settings::default(),
    };
    let job = plant_process::job::Job::new(5, run, plan, 5.0);
    let law_job = controller_process::job::Job::new(5, "patchy", "watchful", rate, 5.0);
    let (plant_link, law_link) = pair();
    let (sink, mut source) = in_process::pair();
    let plant = PlantKind::of::<patchy_plant::Patchy>();
    let law = LawKind::of::<watchful_law::Watchful>();
    let mut engine = Engine::new(&plant, &kinds::all(), job, plant_link, sink).expect("starts");
    let mut runner = Runner::new(&law, law_job, law_link).expect("starts");
    runner.begin().expect("says hello");
    let (commands, internals) = (law.description.commands.clone(), &law.description.internals);
    let frame = SignalTable::of(SignalKind::Command, &commands.expect("its own"))
        .and(SignalKind::Internal, internals);
    let layout = RecordLayout::of(&plant.description, Vec::new(), &frame);
    let (mut steps, mut digest) = (Vec::new(), Digest::default());
    let mut is_over = false;
    while !is_over {
        is_over = engine.poll().expect("the engine works") == Progress::Over;
        runner.poll().expect("the runner works");
        let mut take = |item: Item<'_>| match item {
            Item::Record(words) => {
                let view = layout.view(words);
                digest.record(view.hashed);
                let v = view.values;
                steps.push(Expected {
                    invalid: [words[1], words[2]],
                    truth: v[0],
                    measured: [v[1], v[2], v[3]],
                    command: v[4],
                    applied: v[5],
                    internals: [v[6], v[7], v[8]],
                });
            }
            Item::Event(event) => digest.event(&event),
            other => panic!("{other:?}"),
        };
        source.drain(&mut take).expect("drains");
    }
    steps.truncate(STEPS as usize);
    (steps, digest.finish())
}

/// Returns the arguments of a run in two processes.
fn line(rig: &Rig, more: &str) -> String {
    let scenario = rig.write("patchy.toml", SCENARIO);
    let [plant, law] = ["patchy-plant", "watchful-controller"].map(program_of_tests);
    let (scenario, plant, law) = (scenario.display(), plant.display(), law.display());
    format!("{scenario} --plant-bin {plant} --controller-bin {law} {more}")
}

/// Runs it, with one requirement too many to pass.
fn in_two(rig: &Rig, more: &str) -> Run {
    rig.run(&line(rig, more)).expect(1)
}

#[test]
fn a_gap_is_recorded_as_it_follows_from_the_formulas() {
    let (steps, _) = in_one_process();
    for (step, (actual, expected)) in steps.iter().zip(expected()).enumerate() {
        assert_eq!(*actual, expected, "step {step}");
    }
    assert_eq!(steps.len() as u64, STEPS);
}

#[test]
fn a_gap_has_one_digest_in_one_process_in_two_resumed_and_on_a_target() {
    let (_, expected) = in_one_process();
    let rig = Rig::new();
    let run = in_two(&rig, "--checkpoint-at 0.27 --checkpoint-at 0.55");
    assert_eq!(run.digest(), expected);
    for step in [27, 55] {
        let from = run.folder.join(format!("checkpoint-{step}"));
        let resumed = rig.run(&format!("--from {}", from.display())).expect(1);
        assert_eq!(resumed.digest(), expected, "from step {step}");
    }
    assert_eq!(in_two(&rig, "--pace 20 --no-record").digest(), expected);
    let again = rig.rerun(&run.folder, &[]);
    assert!(again.stdout.contains(&expected), "{}", again.stdout);
    let board = Board::new(&rig);
    let there = rig.start_with(board.hil(), &line(&rig, "--no-record --target me@board"));
    assert_eq!(there.finish().expect(1).digest(), expected, "on a target");
}

#[test]
fn a_recorded_gap_gives_a_replayed_law_the_same_validity_and_ages() {
    let rig = Rig::new();
    let run = in_two(&rig, "");
    let law = program_of_tests("watchful-controller");
    let arguments = ["replay", text(&run.folder), "--controller-bin", text(&law)];
    rig.hil(&arguments).expect(0);
}

#[test]
fn metrics_and_requirements_ask_for_validity_and_age() {
    let rig = Rig::new();
    let run = in_two(&rig, "");
    let summary = run.summary();
    let entry = |list: &str, name: &str| -> Value {
        let entries = summary[list].as_array().expect("a list");
        let entry = entries.iter().find(|entry| entry["name"] == name);
        entry.unwrap_or_else(|| panic!("no {name}")).clone()
    };
    // The final record has a sample, but no command.
    assert_eq!(entry("metrics", "share_valid")["value"], 86.0 / 101.0);
    assert_eq!(entry("metrics", "share_refreshed")["value"], 90.0 / 101.0);
    for (name, verdict) in [
        ("never_older_than_150_ms", "pass"),
        ("never_older_than_140_ms", "fail"),
        ("always_measured", "fail"),
        ("rate_is_fresh", "pass"),
    ] {
        assert_eq!(entry("requirements", name)["verdict"], verdict, "{name}");
    }
}

#[test]
fn an_export_marks_the_steps_of_a_gap() {
    let rig = Rig::new();
    let run = in_two(&rig, "");
    let table = rig.path("gap.csv");
    let arguments = [
        "export",
        text(&run.folder),
        "-o",
        text(&table),
        "--validity",
    ];
    rig.hil(&arguments).expect(0);
    let expected: Vec<u64> = GAP.collect();
    assert_eq!(invalid_in(&table, "measured.position_m.valid"), expected);
    let mut expected: Vec<u64> = HELD.collect();
    expected.push(STEPS);
    assert_eq!(invalid_in(&table, "command.rate_mps.valid"), expected);
}

/// Lists the rows of a table in which a column is 0.
fn invalid_in(table: &Path, column: &str) -> Vec<u64> {
    let text = std::fs::read_to_string(table).expect("a table");
    let mut lines = text.lines();
    let header = lines.next().expect("a header");
    let place = header.split(',').position(|name| name == column);
    let place = place.unwrap_or_else(|| panic!("no {column} in {header}"));
    let marks = (0..).zip(lines.map(|line| line.split(',').nth(place).expect("a cell")));
    let invalid = marks.filter(|(_, cell)| matches!(*cell, "0" | "false"));
    invalid.map(|(row, _)| row).collect()
}
