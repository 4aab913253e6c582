//! A bus in simulation: the same frames in one process, in two, from a checkpoint and in a rerun, and what they do to
//! signals, against closed forms.

use std::fs;

use hil_config::plan::BusPlan;
use plant_process::faults::{Bus, FaultBuilder, FaultLayer, kinds};
use shared_types::describe::Settings;
use shared_types::frame::VALIDITY_WORDS;
use shared_types::record::{BusCounts, RecordLayout};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::{Record, Recording};
use crate::support::programs::{shipped, workspace};

const SCENARIO: &str = "examples/ports/spring-mass.toml";
const PORT: &str = "examples/ports/spring-mass.port.toml";

/// Copies scenario and port file, with more behind the scenario.
fn scenario(rig: &Rig, more: &str) -> String {
    rig.write("spring-mass.port.toml", &shipped(PORT));
    let text = format!("{}\n{more}\n", shipped(SCENARIO));
    rig.write("spring-mass.toml", &text).display().to_string()
}

fn run(rig: &Rig, file: &str, out: &str, more: &[&str]) -> Run {
    let out = rig.path(out).display().to_string();
    let arguments = ["run", file, "--out", &out];
    let mut run = rig.hil(&[&arguments[..], more].concat()).expect(0);
    run.folder = out.into();
    run
}

const LOSSES: &str = r#"
[[faults]]
kind = "message-loss"
at_s = 0.3
[[faults.effects]]
target = "link.sample.b"
probability = 0.3
[[faults]]
kind = "message-jitter"
at_s = 0.7
duration_s = 0.4
[[faults.effects]]
target = "link.sample"
steps = 3
"#;

#[test]
fn one_process_two_a_checkpoint_and_a_rerun_give_one_digest() {
    let rig = Rig::new();
    let file = scenario(&rig, LOSSES);
    let two = run(&rig, &file, "two", &["--checkpoint-at", "0.85"]);
    let one = run(&rig, &file, "one", &["--link", "in-process"]);
    assert_eq!(one.digest(), two.digest());
    let checkpoint = two.folder.join("checkpoint-850").display().to_string();
    let resumed = rig.path("resumed").display().to_string();
    rig.hil(&["run", "--from", &checkpoint, "--out", &resumed])
        .expect(0)
        .prints(&[&two.digest()]);
    let summary = two.summary();
    assert_eq!(
        summary["checkpoints"][0]["check"]["verdict"], "exact",
        "{summary}"
    );
    // The rerun has the frames from the run itself.
    fs::remove_file(rig.path("spring-mass.port.toml")).expect("there");
    let again = rig.path("again").display().to_string();
    let folder = two.folder.display().to_string();
    rig.hil(&["rerun", &folder, "--out", &again]).expect(0);
    rig.hil(&["compare", &folder, &again]).expect(0);
    rig.hil(&["replay", &folder]).expect(0);
}

#[test]
fn signals_are_sampled_at_the_period_and_rounded_to_the_resolution() {
    let rig = Rig::new();
    let file = scenario(&rig, "");
    let run = run(&rig, &file, "run", &[]);
    let recording = Recording::open(&run.recording());
    let records: Vec<Record> = recording.records().collect();
    let value = |step: usize, name: &str| recording.value(&records[step], name);
    for step in 0..2000 {
        let sent = step - step % 2; // every two steps
        let raw = (value(sent, "sensed.position_m") * 1e6).round();
        let measured = value(step, "measured.position_m");
        assert!((measured - raw * 1e-6).abs() < 1e-15, "{step}: {measured}");
        let raw = (value(sent, "sensed.velocity_mps") * 1e4).round();
        let measured = value(step, "measured.velocity_mps");
        assert!((measured - raw * 1e-4).abs() < 1e-12, "{step}: {measured}");
        // The command is limited by 16 bits, and what is applied is what arrived.
        let command = value(step, "command.force_n");
        let raw = (command * 1e3).round_ties_even().clamp(-32_767.0, 32_767.0);
        let applied = value(step, "applied.force_n");
        assert!((applied - raw * 1e-3).abs() < 1e-12, "{step}: {applied}");
    }
    let summary = run.summary();
    let saturated = &summary["bus"][2]["saturated"][0];
    assert_eq!(saturated["signal"], "command.force_n", "{summary}");
    // The jump of the reference at 0.5 s.
    assert_eq!(summary["marks"][0]["step"], 500);
}

#[test]
fn commands_that_a_bus_does_not_refresh_are_counted() {
    let rig = Rig::new();
    let lost = "[[faults]]\nkind = \"message-loss\"\nat_s = 1.0\nduration_s = 0.1\n[[faults.effects]]\ntarget = \"link.command\"\n";
    // One network, so that the loss is none of the second's.
    rig.write("spring-mass.port.toml", &shipped(PORT));
    let text = shipped(SCENARIO).replace("redundancy = 2", "");
    let flood = text.find("[[faults]]").expect("a fault");
    let text = format!("{}{lost}", &text[..flood]);
    let file = rig.write("single.toml", &text).display().to_string();
    let out = rig.path("run").display().to_string();
    let run = rig.hil(&["run", &file, "--out", &out]).expect(0);
    let text = fs::read_to_string(rig.path("run").join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    // 100 frames are lost: the 11th step without one is stale, and the first frame afterwards has a counter that jumps.
    let held = &summary["held_commands"];
    assert_eq!(held[0]["command"], "force_n", "{summary}");
    assert_eq!(held[0]["steps"], 100 - 10 + 1, "{summary}");
    let line = "command force_n was held for 91 of 2000 steps";
    assert!(run.stdout.contains(line), "{}", run.stdout);
}

#[test]
fn a_live_fault_acts_on_one_network_and_is_refused_where_there_is_one() {
    let rig = Rig::new();
    let file = scenario(&rig, "");
    let session = rig.session();
    let arguments = [
        "run",
        &file,
        "--pause-at",
        "0.2",
        "--no-record",
        "--session",
        session,
    ];
    let running = rig.start_hil(&arguments);
    rig.until_held_at(200);
    rig.in_session("inject --list --kind message-loss")
        .expect(0)
        .prints(&["link.sample.a, link.sample.b, link.command, link.command.a, link.command.b"]);
    rig.in_session("inject message-loss link.sample.b")
        .expect(0);
    let refused = rig
        .in_session("inject message-loss link.sample.c")
        .expect(2);
    assert!(
        refused.stderr.contains("link.sample.c"),
        "{}",
        refused.stderr
    );
    rig.in_session("resume").expect(0);
    running
        .finish()
        .expect(0)
        .prints(&["at step 200, link.sample.b"]);
}

#[test]
fn a_step_of_a_bus_with_faults_allocates_nothing() {
    let plants = plant_process::models::all();
    let plant = plants
        .iter()
        .find(|kind| kind.description.name == "spring-mass");
    let plant = plant.expect("built in").description.clone();
    let reference = [Field::signal("position_m", "m", "x")];
    let rate = Rate::new(1000.0).expect("legal");
    let kinds = kinds::all();
    let parameters: Settings = {
        let mut settings = Settings::default();
        for field in &plant.parameters {
            settings.set(&field.name, field.default.unwrap_or(0.0));
        }
        settings
    };
    let text = shipped(SCENARIO) + LOSSES;
    let path = workspace().join(SCENARIO);
    let scenario = hil_config::scenario::Scenario::parse(&text, path).expect("TOML");
    let laws: Vec<_> = controller_process::laws::all()
        .into_iter()
        .map(|law| law.description)
        .collect();
    let described: Vec<_> = kinds.iter().map(|kind| kind.description.clone()).collect();
    let plan = scenario.check(std::slice::from_ref(&plant), &laws, &described);
    let plan = plan.unwrap_or_else(|problems| panic!("{problems}"));
    let bus: &BusPlan = plan.bus.as_ref().expect("a bus");
    let builder = FaultBuilder::new(&plant, &reference, &kinds, &parameters, (rate, 1), &[]);
    let builder = builder.expect("parameters").with_networks(bus.networks);
    let bus = Bus::new(bus, &plant, &reference, rate).expect("sound");
    let layer = FaultLayer::new(&builder, &plan.faults).expect("sound");
    let mut layer = layer.with_bus(Some(bus));
    let layout = RecordLayout {
        measured: plant.measured.clone(),
        reference: reference.to_vec(),
        command: plant.commands.clone(),
        command_signals: 1,
        ..RecordLayout::default()
    };
    layer.open(&builder, &layout).expect("signals");
    let (mut row, mut applied) = ([0.0; 3], [0.0; 1]);
    let mut step = |k: u64| {
        let mut invalid = [0; VALIDITY_WORDS];
        layer.advance(Step(k), None);
        let sensed = ([k as f64 * 1e-4, 9.0], [0.5]);
        layer.sample(Step(k), (&sensed.0, &sensed.1), &mut row, &mut invalid);
        layer.timing(Step(k));
        let mut invalid = [0; VALIDITY_WORDS];
        layer.command(Step(k), (0, 0), (&[k as f64], &mut invalid), &mut applied);
        while let Some(event) = layer.next_event() {
            std::mem::forget(event);
        }
    };
    let counted = allocation_counter::measure(|| (0..2000).for_each(&mut step));
    assert_eq!(counted.count_total, 0);
    let sent: Vec<u64> = layer
        .bus_counts()
        .iter()
        .map(|one: &BusCounts| one.sent)
        .collect();
    assert_eq!(sent, [1000, 2000, 2000]);
}
