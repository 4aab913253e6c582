//! Recordings in the programs that engineers use: rerun's converter, Foxglove's decoding packages, and rosbags,
//! which accepts only recordings of ROS 2.

use std::path::PathBuf;
use std::process::Command;

use crate::support::harness::{Rig, Run};
use crate::support::node::node_packages;
use crate::support::programs::{skip, workspace};
use crate::support::python::{python, succeeds};

const SCENARIO: &str = "tests/scenarios/leakage.toml";
const SHORT: &str = "--set run.duration_s=0.2 --set faults[0].at_s=0.1";

/// Creates recordings with different settings, and one that was truncated and recovered.
fn recordings(rig: &Rig) -> Vec<Run> {
    let ways = [
        "",
        "--compression none",
        "--compression zstd",
        "--record truth.* --record measured.surface_angle_rad --record-every 10",
    ];
    let run = |way: &&str| rig.run(&format!("{SCENARIO} {SHORT} {way}")).expect(0);
    let mut runs: Vec<Run> = ways.iter().map(run).collect();
    let torn = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let whole = std::fs::read(torn.recording()).expect("read");
    std::fs::write(torn.recording(), &whole[..whole.len() * 2 / 3]).expect("cut");
    let folder = torn.folder.to_str().expect("text");
    rig.hil(&["recover", folder]).expect(0);
    runs.push(torn);
    runs
}

#[test]
fn rerun_converts_recordings_to_columns_with_the_names_and_bits_of_the_signals() {
    let Some(python) = python("rerun.chunk, mcap, numpy, pyarrow") else {
        return skip("Python has no `rerun`", "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let (runs, folder) = (recordings(&rig), rig.path("rerun"));
    std::fs::create_dir(&folder).expect("a folder");
    let script = workspace().join("tests/python/compare_rerun.py");
    let folders = runs.iter().map(|run| &run.folder);
    let mut compare = Command::new(&python);
    let output = succeeds(compare.arg(script).arg(folder).args(folders));
    let same = output.matches("the same bits in rerun").count();
    assert_eq!(same, runs.len(), "{output}");
}

/// Exports a run to a table; returns the table's path, beside the run's folder.
fn exported(rig: &Rig, run: &Run, number: usize) -> PathBuf {
    let table = rig.path(&format!("table-{number}.csv"));
    let arguments = [run.folder.to_str(), Some("-o"), table.to_str()];
    let arguments = arguments.map(|argument| argument.expect("text"));
    rig.hil(&[&["export"], &arguments[..]].concat()).expect(0);
    table
}

#[test]
fn rosbags_reads_every_message_with_the_exported_bits() {
    let Some(python) = python("rosbags, pandas") else {
        return skip("Python has no `rosbags`", "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let runs = recordings(&rig);
    let mut compare = Command::new(&python);
    compare.arg(workspace().join("tests/python/compare_rosbags.py"));
    for (number, run) in runs.iter().enumerate() {
        let table = exported(&rig, run, number);
        compare.arg(run.recording()).arg(table);
    }
    let output = succeeds(&mut compare);
    let same = output.matches("the same bits in rosbags").count();
    assert_eq!(same, runs.len(), "{output}");
}

#[test]
fn foxgloves_decoders_agree_with_the_export_of_the_same_recording() {
    let Some(packages) = node_packages("@foxglove/rosmsg") else {
        let why = "node or the packages of tests/node are not installed";
        return skip(why, "HIL_TEST_NODE");
    };
    let rig = Rig::new();
    for (number, run) in recordings(&rig).iter().enumerate() {
        let table = exported(&rig, run, number);
        let script = workspace().join("tests/node/compare_export.mjs");
        let mut compare = Command::new("node");
        let output = succeeds(
            compare
                .arg(script)
                .arg(&packages)
                .arg(run.recording())
                .arg(table),
        );
        assert!(
            output.contains("the same numbers as decoded by Foxglove"),
            "{output}"
        );
    }
}
