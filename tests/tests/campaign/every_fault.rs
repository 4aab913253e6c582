//! Every kind of fault that ships, alone and on top of a leakage, under every law: no run hangs or ends abnormally, no
//! value that is not a number passes as valid, every fault acts, and one process and two give the same digest.

use serde_json::Value;

use super::{Planned, campaign, planned, text};
use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{shipped, workspace};
use crate::tried_faults::{LAWS, STUDY};

/// Two seconds with the paper's leakage at 1 s.
const SCENARIO: &str = "tests/scenarios/leakage.toml";

/// Plans the shipped study over the short scenario; the faults begin at 1.2 s.
fn short(rig: &Rig) -> Planned<'_> {
    let scenario = workspace().join(SCENARIO);
    let study = shipped(STUDY)
        .replace("../scenarios/severe-leakage.toml", text(&scenario))
        .replace("onsets_s = [10.0]", "onsets_s = [1.2]");
    planned(rig, &rig.write("faults.toml", &study), "faults")
}

fn rows(planned: &Planned<'_>) -> Vec<Value> {
    let answers = planned.on("show --json").expect(0).json();
    answers["faults"].as_array().expect("a list").clone()
}

#[test]
fn the_shipped_study_tries_every_kind_of_fault_under_every_law_and_no_run_is_lost() {
    let rig = Rig::new();
    let planned = short(&rig);
    planned.on("run").expect(0);
    let rows = rows(&planned);
    let plant = plant_process::models::all().into_iter();
    let mut plant = plant.filter(|plant| plant.description.name == "drhas");
    let plant = plant.next().expect("built in").description;
    let shared = plant_process::faults::kinds::all().into_iter();
    let offered = (plant.faults.into_iter().map(|fault| fault.kind))
        .chain(shared.map(|kind| kind.description.kind));
    for kind in offered {
        for law in LAWS {
            let row = rows
                .iter()
                .find(|row| row["kind"] == *kind && row["variant"] == law);
            let row = row.unwrap_or_else(|| panic!("{kind} under {law} has no row"));
            let outcome = row["outcome"].as_str().expect("a text");
            assert!(["pass", "diverged"].contains(&outcome), "{row}");
        }
    }
}

#[test]
fn no_fault_ends_a_process_abnormally_or_lets_nan_pass_as_valid() {
    let number = LAWS.len();
    // Each kind under one law, and each law in turn; all of them in `long`.
    assert_sound(|case| case % number == case / number % number);
}

/// Runs the cases that are wanted, each by itself, and examines their recordings.
fn assert_sound(is_wanted: impl Fn(usize) -> bool) {
    let rig = Rig::new();
    let planned = short(&rig);
    let rows = rows_of_plan(&planned).into_iter();
    for (case, about) in rows.filter(|(case, _)| is_wanted(*case)) {
        let out = rig.path(&format!("case{case}"));
        let number = case.to_string();
        let run = campaign(
            &rig,
            &[
                "case",
                text(&planned),
                &number,
                "--json",
                "--out",
                text(&out),
            ],
        );
        assert!(matches!(run.code, Some(0 | 1)), "{about}: {}", run.stderr);
        let summary = run.json();
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
        assert_numbers(&Recording::open(&out.join("run.mcap")), &about);
        std::fs::remove_dir_all(&out).expect("removed");
    }
}

/// Lists the cases of the study with their fault and law.
fn rows_of_plan(planned: &Planned<'_>) -> Vec<(usize, String)> {
    let faults = crate::tried_faults::faults();
    let of_fault = faults
        .iter()
        .flat_map(|fault| LAWS.map(|law| format!("{} under {law}", fault.kind)));
    let cases: Vec<(usize, String)> = of_fault.enumerate().collect();
    let status = planned.on("status --json").expect(0).json();
    assert_eq!(status["cases"], cases.len() as u64, "{status}");
    cases
}

/// Fails unless each value is finite or marked invalid; only the last record has no command.
fn assert_numbers(recording: &Recording, about: &str) {
    let place = |group: &str| {
        let mut columns = recording.columns.iter();
        columns
            .position(|name| name.starts_with(group))
            .expect("a group")
    };
    let truth = place("truth.");
    let command = place("command.");
    let sensed = place("sensed.");
    let sample = place("measured.");
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

/// `.ci/run long`.
mod long {
    #[test]
    #[ignore = "long: .ci/run long"]
    fn no_fault_under_any_law_ends_a_process_abnormally_or_lets_nan_pass_as_valid() {
        super::assert_sound(|_| true);
    }
}
