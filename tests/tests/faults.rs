//! Faults of scenarios in whole runs: they act, are recorded beside the truth, are reproducible, and never stop the
//! lockstep.

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::{Record, Recording};

/// Second of the hydraulic system under PID without a fault, 10,000 steps.
const BASE: &str = r#"
schema = 1
name = "faulted"
[run]
duration_s = 1.0
rate_hz = 10000
seed = 1
[plant]
model = "drhas"
substeps = 4
[controller]
law = "pid"
[[stimuli]]
target = "surface_angle_rad"
kind = "paper"
"#;

/// Returns a fault that begins at 0.2 s, given by kind, further keys of the event, and keys of the effect.
fn fault((kind, event, effect): (&str, &str, &str)) -> String {
    format!("[[faults]]\nkind = \"{kind}\"\nat_s = 0.2\n{event}\n[[faults.effects]]\n{effect}\n")
}

fn faulted(rig: &Rig, faults: &[(&str, &str, &str)], arguments: &str) -> Run {
    let faults: String = faults.iter().map(|&given| fault(given)).collect();
    let path = rig.write("faulted.toml", &format!("{BASE}{faults}"));
    rig.run(&format!("{} {arguments}", path.display()))
        .expect(0)
}

const ANGLE: &str = "target = \"measured.surface_angle_rad\"";

#[test]
fn a_lost_sensor_or_command_never_stops_the_lockstep() {
    let rig = Rig::new();
    for dead in [
        ("dropout", "", ANGLE),
        ("stuck", "", ANGLE),
        ("message-loss", "", "target = \"link.command\""),
        ("message-loss", "", "target = \"link.sample\""),
    ] {
        let run = faulted(&rig, &[dead], "");
        let summary = run.summary();
        assert_eq!(summary["steps"], 10_000, "{dead:?}");
        let acted = &summary["faults"][0]["effects"][0]["acted_steps"];
        assert!(acted.as_u64() > Some(7_000), "{dead:?}: {acted}");
    }
}

#[test]
fn a_dead_sensor_is_marked_invalid_and_keeps_its_last_value() {
    let rig = Rig::new();
    let recording = Recording::open(&faulted(&rig, &[("dropout", "", ANGLE)], "").recording());
    let records: Vec<Record> = recording.records().collect();
    let value = |step: usize, column: &str| recording.value(&records[step], column);
    let invalid = |step: usize| records[step].words[recording.place("sample_invalid[0]")];
    assert_eq!((invalid(1_999), invalid(2_000), invalid(9_999)), (0, 1, 1));
    let last = value(1_999, "measured.surface_angle_rad");
    for step in [2_000, 5_000, 9_999] {
        assert_eq!(value(step, "measured.surface_angle_rad"), last);
        let sensed = value(step, "sensed.surface_angle_rad");
        assert_eq!(sensed, value(step, "truth.surface_angle_rad"));
    }
}

#[test]
fn a_command_lost_on_the_way_to_the_plant_is_marked_invalid() {
    let rig = Rig::new();
    let current = "target = \"command.actuator2_valve_current_a\"";
    let run = faulted(&rig, &[("dropout", "duration_s = 0.1", current)], "");
    let recording = Recording::open(&run.recording());
    let records: Vec<Record> = recording.records().collect();
    let invalid = |step: usize| records[step].words[recording.place("command_invalid[0]")];
    let bits = [1_999, 2_000, 2_999, 3_000].map(invalid);
    assert_eq!(bits, [0, 0b10, 0b10, 0]);
    // The controller still sends the same commands: a replay finds no difference.
    let folder = run.folder.to_str().expect("plain");
    assert_eq!(rig.hil(&["replay", folder]).code, Some(0));
}

#[test]
fn a_bias_is_the_difference_between_measured_and_sensed_values() {
    let rig = Rig::new();
    let given = (
        "bias",
        "duration_s = 0.1",
        "target = \"measured.surface_angle_rad\"\nbias = 0.001",
    );
    let run = faulted(&rig, &[given], "");
    let recording = Recording::open(&run.recording());
    for record in recording.records() {
        let measured = recording.value(&record, "measured.surface_angle_rad");
        let sensed = recording.value(&record, "sensed.surface_angle_rad");
        let expected = if (2_000..3_000).contains(&record.step()) {
            sensed + 0.001
        } else {
            sensed
        };
        assert_eq!(measured, expected, "step {}", record.step());
    }
    let effect = &run.summary()["faults"][0]["effects"][0];
    assert_eq!(
        (&effect["ended_step"], &effect["acted_steps"]),
        (&3000.into(), &1000.into())
    );
    let largest = effect["max_effect"].as_f64().expect("a number");
    assert!((largest - 0.001).abs() < 1e-15, "{largest}");
}

#[test]
fn after_a_lost_command_the_last_one_is_held_and_its_age_grows() {
    let rig = Rig::new();
    let given = (
        "message-loss",
        "duration_s = 0.001",
        "target = \"link.command\"",
    );
    let recording = Recording::open(&faulted(&rig, &[given], "").recording());
    let records: Vec<Record> = recording.records().collect();
    let column = "actuator1_valve_current_a";
    let held = recording.value(&records[1_999], &format!("command.{column}"));
    for record in &records[1_990..2_020] {
        let step = record.step();
        let lost = (2_000..2_010).contains(&step);
        let applied = recording.value(record, &format!("applied.{column}"));
        let sent = recording.value(record, &format!("command.{column}"));
        assert_eq!(applied, if lost { held } else { sent }, "step {step}");
        let age = record.words[recording.place("command_age_steps")];
        assert_eq!(age, if lost { step - 1_999 } else { 0 }, "step {step}");
    }
}

#[test]
fn a_late_message_shows_the_receiver_the_past_and_its_age() {
    let rig = Rig::new();
    let given = ("message-delay", "", "target = \"link.sample\"\nsteps = 7");
    let recording = Recording::open(&faulted(&rig, &[given], "").recording());
    let records: Vec<Record> = recording.records().collect();
    let column = "actuator1_position_m";
    for step in [2_007_usize, 3_000, 9_999] {
        let measured = recording.value(&records[step], &format!("measured.{column}"));
        let then = recording.value(&records[step - 7], &format!("sensed.{column}"));
        assert_eq!(measured, then, "step {step}");
        assert_eq!(records[step].words[recording.place("sample_age_steps")], 7);
    }
}

#[test]
fn inverted_bits_are_detected_by_the_checksum_and_counted() {
    let rig = Rig::new();
    let given = (
        "message-corruption",
        "duration_s = 0.01",
        "target = \"link.sample\"\nprobability = 1",
    );
    let summary = faulted(&rig, &[given], "").summary();
    assert_eq!(summary["rejected_frames"], 100);
}

#[test]
fn a_late_controller_costs_time_and_changes_nothing_else() {
    let rig = Rig::new();
    let expected = faulted(&rig, &[], "").digest();
    for side in ["controller", "plant"] {
        let effect = format!("target = \"{side}\"\nbusy_us = 300");
        let run = faulted(&rig, &[("late", "duration_s = 0.01", &effect)], "");
        assert_eq!(run.digest(), expected, "{side}");
        let effect = &run.summary()["faults"][0]["effects"][0];
        assert_eq!(effect["unit"], "ns");
        assert!(effect["max_effect"].as_f64() >= Some(300_000.0), "{effect}");
    }
}

#[test]
fn skipped_steps_are_reproducible_and_visible_in_the_age() {
    let rig = Rig::new();
    let given = ("skip", "", "target = \"controller\"\nsteps = 4");
    let run = faulted(&rig, &[given], "");
    let recording = Recording::open(&run.recording());
    let place = recording.place("command_age_steps");
    let ages: Vec<u64> = (recording.records().skip(1_999).take(7))
        .map(|record| record.words[place])
        .collect();
    // The command of step 2000 takes effect at 2004; until then that of 1999 is active.
    assert_eq!(ages, [0, 1, 2, 3, 4, 4, 0]);
    assert_eq!(
        faulted(&rig, &[given], "--link in-process").digest(),
        run.digest()
    );
    assert_ne!(faulted(&rig, &[], "").digest(), run.digest());
}

/// Faults of each class, some of them random.
#[rustfmt::skip] // a table
const MANY: [(&str, &str, &str); 9] = [
    ("leakage", "", "actuator = 1\ncoefficient_m3ps_per_sqrt_pa = 1e-7\nspeed_per_s = 10"),
    ("noise", "", "target = \"measured.surface_angle_rad\"\nstandard_deviation = 1e-5"),
    ("noise", "", "target = \"measured.actuator1_velocity_mps\"\nstandard_deviation = 1e-5"),
    ("message-jitter", "", "target = \"link.sample\"\nsteps = 3"),
    ("message-loss", "", "target = \"link.command\"\nprobability = 0.1"),
    ("message-corruption", "", "target = \"link.command\"\nprobability = 0.01"),
    ("skip", "", "target = \"controller\"\nsteps = 2\nperiod_steps = 100"),
    ("late", "occurrences = 3", "target = \"controller\"\nbusy_us = 20\nspread_us = 20"),
    ("scale", "", "target = \"parameter.actuator2.bulk_modulus_pa\"\nfactor = 0.9"),
];

#[test]
fn random_faults_repeat_over_links_and_clocks_and_differ_by_seed() {
    let rig = Rig::new();
    let expected = faulted(&rig, &MANY, "").digest();
    for arguments in ["", "--link in-process", "--pace 20", "--no-record"] {
        assert_eq!(
            faulted(&rig, &MANY, arguments).digest(),
            expected,
            "{arguments}"
        );
    }
    assert_ne!(faulted(&rig, &MANY, "--set run.seed=2").digest(), expected);
}

#[test]
fn a_fault_that_does_nothing_and_one_that_never_begins_are_flagged() {
    let rig = Rig::new();
    let path = rig.write(
        "idle.toml",
        &format!(
            "{BASE}{}[[faults]]\nkind = \"bias\"\nwhen = \"truth.surface_angle_rad > 100\"\n[[faults.effects]]\n{ANGLE}\nbias = 1\n",
            fault(("bias", "", "target = \"measured.surface_angle_rad\"\nbias = 0"))
        ),
    );
    let run = rig.run(&path.display().to_string()).expect(0);
    let summary = run.summary();
    assert_eq!(summary["faults"][0]["effects"][0]["no_effect"], true);
    assert_eq!(
        summary["faults"][1]["effective_step"],
        serde_json::Value::Null
    );
    run.prints(&["NO EFFECT", "never took effect"]);
}

#[test]
fn a_chain_of_triggers_takes_hold_at_the_defined_steps() {
    let rig = Rig::new();
    let faults = r#"
[[faults]]
name = "first"
kind = "bias"
when = "abs(truth.surface_rate_radps) > 0 and truth.surface_angle_rad > -1"
for_s = 0.01
duration_s = 0.002
effects = [{ target = "measured.surface_angle_rad", bias = 1e-4 }]

[[faults]]
kind = "bias"
after = "first"
delay_s = 0.1
effects = [
  { target = "measured.surface_angle_rad", bias = 1e-4 },
  { target = "measured.surface_rate_radps", bias = 1e-4, skew_s = 0.05 },
]
"#;
    let path = rig.write("chain.toml", &format!("{BASE}{faults}"));
    let run = rig.run(&path.display().to_string()).expect(0);
    let recording = Recording::open(&run.recording());
    let rate = |record: &Record| recording.value(record, "truth.surface_rate_radps");
    let begin = recording.records().position(|record| rate(&record) != 0.0);
    // The condition holds in records begin .. begin + 99, a hundred in a row; the fault acts one record later.
    let first = begin.expect("the surface moves") as u64 + 100;
    let taken: Vec<u64> = (recording.events.iter())
        .filter(|event| event["event"] == "fault")
        .map(|event| event["step"].as_u64().expect("a step"))
        .collect();
    assert_eq!(taken, [first, first + 1_000, first + 1_500]);
}
