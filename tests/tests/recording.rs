//! Content of a recording, read in Rust and in Python by code independent of the recorder.

use std::process::Command;

use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{skip, workspace};
use crate::support::python::python;

const SCENARIO: &str = "tests/scenarios/leakage.toml";
const SHORT: &str = "--set run.duration_s=0.2 --set faults[0].at_s=0.1";

#[test]
fn a_recording_has_a_record_for_every_step_and_one_for_the_final_truth() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let recording = Recording::open(&run.recording());
    let mut count = 0;
    for record in recording.records() {
        assert_eq!(record.step(), count);
        assert_eq!(
            record.log_time_ns,
            count * 100_000,
            "simulated time at 10 kHz"
        );
        assert_eq!(record.words[recording.place("time_ns")], record.log_time_ns);
        count += 1;
    }
    assert_eq!(count, 20_001);
    let summary = run.summary();
    assert_eq!(summary["steps"], 20_000);
    assert_eq!(summary["recording"]["records"], 20_001);
    assert_eq!(summary["recording"]["lost"], 0);
}

#[test]
fn only_the_last_record_has_no_command() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let recording = Recording::open(&run.recording());
    for record in recording.records() {
        for (place, name) in recording.columns.iter().enumerate() {
            let Some((group, _)) = name.split_once('.') else {
                continue; // not a signal
            };
            let missing = f64::from_bits(record.words[place]).is_nan();
            let of_command = matches!(group, "command" | "applied" | "internal");
            let expected = of_command && record.step() == 2000;
            assert_eq!(missing, expected, "{name} at step {}", record.step());
        }
    }
}

#[test]
fn the_metrics_can_be_recomputed_from_the_recording() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let recording = Recording::open(&run.recording());
    let largest = recording.records().fold(0.0, |largest, record| {
        let fight_n = recording.value(&record, "truth.force_fight_n").abs();
        if fight_n > largest { fight_n } else { largest }
    });
    let summary = run.summary();
    let metrics = summary["metrics"].as_array().expect("metrics");
    let stated = (metrics.iter()).find(|metric| metric["name"] == "max_abs_force_fight_n");
    assert_eq!(stated.expect("it is there")["value"], largest);
}

#[test]
fn a_recording_states_its_provenance() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let (recording, summary) = (Recording::open(&run.recording()), run.summary());
    let metadata = recording.metadata();
    let (facts, result) = (&metadata["hil.run"], &metadata["hil.result"]);
    assert_eq!(facts["scenario"], "leakage");
    assert_eq!(facts["session"], rig.session());
    assert_eq!(facts["evidence"], "sil");
    assert_eq!(
        (facts["steps"].as_str(), facts["seed"].as_str()),
        ("2000", "1")
    );
    for side in ["plant", "controller"] {
        let binary = summary[side]["binary"].as_str().expect("a path");
        let content = std::fs::read(binary).expect("the program is there");
        let hash = blake3::hash(&content).to_hex();
        assert_eq!(facts[&format!("{side}_blake3")], hash.as_str());
        assert_eq!(summary[side]["blake3"], hash.as_str());
    }
    for fact in [
        "hil_version",
        "hil_commit",
        "host",
        "kernel",
        "machine",
        "cores",
        "started_utc",
    ] {
        assert!(!facts[fact].is_empty(), "{fact}");
    }
    assert_eq!(result["digest"], run.digest());
    assert_eq!(result["outcome"], "completed");

    let attachments = recording.attachments();
    let beside = std::fs::read_to_string(run.folder.join("scenario.toml")).expect("it is there");
    assert_eq!(attachments["scenario.toml"], beside);
    let plant: serde_json::Value =
        serde_json::from_str(&attachments["plant-description.json"]).expect("JSON");
    assert_eq!(plant["program"], "plant-process");
    assert!(attachments.contains_key("controller-description.json"));
}

#[test]
fn the_scenario_in_a_recording_repeats_the_run() {
    let rig = Rig::new();
    let first = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let effective = first.folder.join("scenario.toml");
    let second = rig.run(effective.to_str().expect("plain text")).expect(0);
    assert_eq!(second.digest(), first.digest());
    let text = |folder: &std::path::Path| std::fs::read_to_string(folder.join("scenario.toml"));
    assert_eq!(
        text(&second.folder).expect("there"),
        text(&first.folder).expect("there")
    );
}

#[test]
fn faults_and_end_are_events_of_the_recording() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let events = Recording::open(&run.recording()).events;
    let [first, second, end] = &events[..] else {
        panic!("{events:?}");
    };
    for (fault, target) in [(first, "actuator1"), (second, "actuator2")] {
        assert_eq!(fault["kind"], "leakage");
        assert_eq!(fault["target"], target);
        assert_eq!(fault["step"], 1000);
    }
    assert_eq!(
        (&end["event"], &end["steps"]),
        (&"end".into(), &2000.into())
    );
}

#[test]
fn every_compression_holds_the_same_run() {
    let rig = Rig::new();
    for compression in ["none", "lz4", "zstd"] {
        let arguments = format!("{SCENARIO} {SHORT} --compression {compression}");
        let run = rig.run(&arguments).expect(0);
        let recording = Recording::open(&run.recording());
        let summary = recording.summary();
        let used = &summary.chunk_indexes.first().expect("chunks").compression;
        let expected = if compression == "none" {
            ""
        } else {
            compression
        };
        assert_eq!(used, expected);
        assert_eq!(recording.digest(|_| ()), run.digest(), "{compression}");
    }
}

#[test]
fn without_recording_there_is_no_file_but_the_same_digest_and_metrics() {
    let rig = Rig::new();
    let with = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let without = rig
        .run(&format!("{SCENARIO} {SHORT} --no-record"))
        .expect(0);
    assert!(!without.recording().exists());
    assert_eq!(without.digest(), with.digest());
    assert_eq!(without.summary()["metrics"], with.summary()["metrics"]);
    assert_eq!(
        without.summary()["recording"]["file"],
        serde_json::Value::Null
    );
}

#[test]
fn public_libraries_of_python_read_a_recording() {
    let Some(python) = python("mcap, mcap_ros2") else {
        let why = "python3 with mcap and mcap-ros2-support is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let read = Command::new(python)
        .arg(workspace().join("tests/python/read_run.py"))
        .arg(run.recording())
        .arg(run.folder.join("summary.json"))
        .arg("--require-metrics")
        .output()
        .expect("python can be run");
    let text = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "{text}");
    let output = String::from_utf8_lossy(&read.stdout);
    assert!(output.contains("20001 records"), "{output}");
    assert!(output.contains("2 metrics equal, bit by bit"), "{output}");
}
