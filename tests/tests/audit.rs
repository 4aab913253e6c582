//! `hil run --audit`: a deterministic run passes, and a dependency on anything but the samples is reported with
//! step and signal.

use serde_json::Value;

use crate::support::harness::{Rig, Run, names};
use crate::support::programs::program_of_tests;

/// Runs and audits a quarter of a second of the teaching plant at 1 kHz under a law of the test's controller.
fn audited(rig: &Rig, law: &str, arguments: &str) -> Run {
    let scenario = rig.scenario(0.25, "spring-mass", law);
    let controller = program_of_tests("clock-reading-controller");
    rig.run(&format!(
        "{} --audit --controller-bin {} {arguments}",
        scenario.display(),
        controller.display()
    ))
}

fn repetitions(summary: &Value) -> &[Value] {
    let repetitions = summary["audit"]["repetitions"].as_array();
    repetitions.expect("a list of repetitions")
}

#[test]
fn a_law_that_depends_only_on_its_samples_has_one_digest_under_all_conditions() {
    let rig = Rig::new();
    let honest = audited(&rig, "honest", "--json").expect(0);
    let summary = honest.summary();
    assert_eq!(summary["audit"]["verdict"], "pass");
    let report = honest.json();
    assert_eq!(report, summary);
    for one in repetitions(&summary) {
        if one["skipped"].is_null() {
            assert_eq!(one["digest"], summary["digest"], "{one}");
        }
    }
    // On a single core, one condition is missing.
    let ran = repetitions(&summary)
        .iter()
        .filter(|one| one["agrees"] == true);
    assert!(ran.count() >= 5);
    let checks = repetitions(&summary)
        .iter()
        .filter(|one| !one["check"].is_null());
    let checks: Vec<_> = checks.map(|one| &one["check"]["text"]).collect();
    assert_eq!(checks, ["exact for 100 steps"]);
    let mut left = names(&honest.folder);
    left.retain(|name| name.starts_with("audit"));
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn an_audit_names_a_law_with_an_incomplete_state() {
    let rig = Rig::new();
    let audited = audited(&rig, "forgets", "").expect(0);
    assert_eq!(audited.summary()["audit"]["verdict"], "pass");
    audited.prints(&[
        "NOT   its restored state: differs at step 1: command.force_n is ",
        "(controller)",
    ]);
}

#[test]
fn a_law_that_reads_the_clock_is_detected_with_step_and_signal() {
    let rig = Rig::new();
    let caught = audited(&rig, "reads-clock", "").expect(1);
    let summary = caught.summary();
    assert_eq!(summary["audit"]["verdict"], "fail");
    // Under every condition: no two runs have the same times.
    for one in repetitions(&summary) {
        if !one["skipped"].is_null() {
            continue;
        }
        assert_eq!(one["agrees"], false, "{one}");
        let difference = &one["first_difference"];
        assert_eq!(difference["signal"], "command.force_n", "{one}");
        // At step 0 the position is the initial one: the first quotient that can differ is later.
        assert!(difference["step"].as_u64() < Some(10), "{one}");
        let run = one["run"].as_str().expect("a folder that is kept");
        assert!(std::path::Path::new(run).join("run.mcap").exists());
    }
    caught.prints(&[
        "first difference at step",
        "command.force_n",
        "reads a clock",
    ]);
}

#[test]
fn a_law_that_counts_the_cores_is_detected_by_reducing_them() {
    if std::thread::available_parallelism().is_ok_and(|cores| cores.get() < 2) {
        return; // a single core cannot be reduced
    }
    let rig = Rig::new();
    let caught = audited(&rig, "counts-cores", "").expect(1);
    let summary = caught.summary();
    let of = |message: &str| {
        let mut all = repetitions(&summary).iter();
        let hit = all.find(|one| {
            one["condition"]
                .as_str()
                .is_some_and(|c| c.contains(message))
        });
        hit.unwrap_or_else(|| panic!("no `{message}` in {summary}"))
    };
    assert_eq!(of("the same again")["agrees"], true);
    assert_eq!(of("one core")["agrees"], false);
}

#[test]
fn options_without_anything_to_audit_are_refused() {
    let rig = Rig::new();
    for (arguments, why) in [
        ("--no-record", "recordings"),
        ("--clock realtime", "lockstep"),
        ("--pause-at 0.1", "--pause-at"),
    ] {
        audited(&rig, "honest", arguments).expect(2).says(&[why]);
    }
}
