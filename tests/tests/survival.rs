//! The paper's scenario for each law with each kind of fault: whatever happens to the surface, both processes end
//! in order, NaN never counts as valid, and the fault acted.

mod long;

use crate::every_fault::{LAWS, faults, with_fault};
use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program, shipped};

/// Two seconds with the paper's leakage at 1 s; the other fault begins at 1.2 s.
const SCENARIO: &str = "tests/scenarios/leakage.toml";

#[test]
fn every_fault_kind_of_the_plant_is_tested() {
    let rig = Rig::new();
    // Without a session: another test's may be the only one, and end meanwhile.
    let plant = program("plant-process");
    let plant = plant.to_str().expect("plain text");
    let listed = rig.hil(&["inject", "--list", "--json", "--plant-bin", plant]);
    let listed = listed.expect(0).stdout;
    let mut tried: Vec<String> = faults().into_iter().map(|fault| fault.kind).collect();
    let plant = plant_process::models::all()
        .into_iter()
        .find(|plant| plant.description.name == "drhas");
    let plant = plant.expect("built in").description;
    let kinds = plant_process::faults::kinds::all();
    let mut offered: Vec<String> = (plant.faults.into_iter().map(|fault| fault.kind))
        .chain(kinds.into_iter().map(|kind| kind.description.kind))
        .collect();
    tried.sort();
    offered.sort();
    assert_eq!(tried, offered);
    assert!(
        offered
            .iter()
            .all(|kind| listed.contains(&format!("\"{kind}\"")))
    );
}

#[test]
fn no_fault_ends_a_process_abnormally_or_lets_nan_pass_as_valid() {
    let text = shipped(SCENARIO);
    for fault in faults() {
        // Each with its own rig: a test that must run alone need not wait for all.
        let rig = Rig::new();
        let path = rig.write("faulted.toml", &with_fault(&text, &fault, 1.2));
        for law in LAWS {
            let about = format!("{} under {law}", fault.kind);
            let arguments = format!("{} --set controller.law={law}", path.display());
            let run = rig.run(&arguments);
            assert!(matches!(run.code, Some(0 | 1)), "{about}: {}", run.stderr);
            let summary = run.summary();
            let outcome = (summary["verdict"].as_str(), summary["reason"].as_str());
            let diverged = |reason: &str| reason.contains("diverged");
            assert!(
                outcome == (Some("pass"), None) || outcome.1.is_some_and(diverged),
                "{about}: {outcome:?}"
            );
            let effect = &summary["faults"][1]["effects"][0];
            assert!(
                effect["acted_steps"].as_u64() > Some(0),
                "{about}: {summary}"
            );
            assert_numbers(&Recording::open(&run.recording()), &about);
        }
    }
}

/// Fails unless each value is finite or marked invalid; only the last record has no command.
fn assert_numbers(recording: &Recording, about: &str) {
    let place = |group: &str| {
        recording
            .columns
            .iter()
            .position(|name| name.starts_with(group))
    };
    let truth = place("truth.").expect("truth");
    let command = place("command.").expect("commands");
    let sensed = place("sensed.").expect("sensed");
    let sample = place("measured.").expect("measured");
    let invalid = recording.place("sample_invalid[0]");
    let records: Vec<_> = recording.records().collect();
    for (index, record) in records.iter().enumerate() {
        let last = index + 1 == records.len();
        for column in truth..sensed {
            let marked = (sample..command).contains(&column)
                && record.words[invalid] >> (column - sample) & 1 == 1;
            let finite = f64::from_bits(record.words[column]).is_finite();
            assert!(
                finite || marked || (last && column >= command),
                "{about}: {} of step {}",
                recording.columns[column],
                record.step()
            );
        }
    }
}
