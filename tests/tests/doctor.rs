//! The doctor on this machine, whatever it is: every check once, and an exit code that follows from the grades.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::support::company::busy_loop;
use crate::support::harness::{Rig, Run, until_gone};
use crate::support::mcap_reader::Recording;

/// Facts that are read, with or without measurements.
const READ: [&str; 18] = [
    "clock_source",
    "cores",
    "governor",
    "huge_pages",
    "idle_states",
    "interrupts",
    "isolation",
    "load",
    "locked_memory",
    "preemption",
    "priority",
    "quota",
    "sessions",
    "shared_memory",
    "smt",
    "swap",
    "throttling",
    "virtualisation",
];
const MEASURED: [&str; 5] = [
    "company",
    "gaps",
    "ping_pong",
    "wake_up_idle",
    "wake_up_loaded",
];

/// Runs the doctor and returns a report that contains these checks, each once, with a verdict that follows from
/// them.
#[track_caller]
fn report(run: &Run, expected: &[&str]) -> Value {
    let report = run.json();
    let checks = report["checks"].as_array().expect("checks");
    let word = |check: &Value, key: &str| check[key].as_str().expect(key).to_owned();
    let mut names: Vec<String> = checks.iter().map(|check| word(check, "check")).collect();
    names.sort();
    let mut expected = expected.to_vec();
    expected.sort_unstable();
    assert_eq!(names, expected);
    let mut grades = BTreeSet::new();
    for check in checks {
        let grade = word(check, "grade");
        assert!(!word(check, "found").is_empty(), "{check}");
        assert!(!word(check, "why").is_empty(), "{check}");
        assert!(grade != "good" || check["mend"].is_null(), "{check}");
        grades.insert(grade);
    }
    let known = ["fair", "good", "poor", "unknown"].map(str::to_owned);
    assert!(grades.is_subset(&known.into()), "{grades:?}");
    let (verdict, code) = match grades.contains("poor") {
        true => ("unfit", 1),
        false => ("fit", 0),
    };
    assert_eq!(report["verdict"], verdict);
    assert_eq!(run.code, Some(code), "{}", run.stderr);
    report
}

fn finding<'a>(report: &'a Value, name: &str) -> &'a Value {
    let checks = report["checks"].as_array().expect("checks");
    let hit = checks.iter().find(|check| check["check"] == name);
    hit.unwrap_or_else(|| panic!("no {name} in {report}"))
}

#[test]
fn a_quick_report_has_every_check_once_and_measures_nothing() {
    let rig = Rig::new();
    let run = rig.hil(&["doctor", "--quick", "--json"]);
    let report = report(&run, &READ);
    assert_eq!(run.stderr, "", "nothing takes long enough to be told");
    for key in ["seconds", "class"] {
        assert!(report[key].is_null(), "{key}");
    }
    for check in report["checks"].as_array().expect("checks") {
        assert!(check["measured"].is_null(), "{check}");
    }
    let online = std::fs::read_to_string("/sys/devices/system/cpu/online").expect("cores");
    assert_eq!(report["online_cores"], online.trim());
}

#[test]
fn measurements_are_consistent() {
    let rig = Rig::new();
    let run = rig.hil(&["doctor", "--seconds", "0.1", "--json"]);
    let report = report(&run, &[&READ[..], &MEASURED].concat());
    assert_eq!(report["seconds"], 0.1);
    let cores = report["cores"].as_array().expect("cores").len();
    for (name, figures, cores_needed) in [
        ("wake_up_idle", "lateness_ns", 1),
        ("wake_up_loaded", "lateness_ns", 1),
        ("ping_pong", "round_trip_ns", 2),
    ] {
        let finding = finding(&report, name);
        if finding["grade"] == "unknown" || cores < cores_needed {
            continue; // a load at real-time priority, one core: reported, not measured
        }
        let figures = &finding["measured"][figures];
        let of = |key: &str| figures[key].as_u64().expect(key);
        assert!(of("count") > 0, "{finding}");
        assert!(
            of("p50") <= of("p99") && of("p99") <= of("max"),
            "{finding}"
        );
    }
    let gaps = &finding(&report, "gaps")["measured"];
    assert_eq!(gaps["cores"].as_array().map(Vec::len), Some(cores));
    for core in gaps["cores"].as_array().expect("cores") {
        let of = |key: &str| core[key].as_u64().expect(key);
        assert!(of("watched_ns") >= 100_000_000, "{core}");
        assert!(of("longest_ns") <= of("lost_ns"), "{core}");
        assert!(of("lost_ns") <= of("watched_ns"), "{core}");
    }
    for measured in ["contention", "wake-ups", "gaps", "under load"] {
        assert!(run.stderr.contains(measured), "{}", run.stderr);
    }
}

#[test]
fn a_busy_core_is_named() {
    let rig = Rig::new();
    let cores = finding_of_company(&rig);
    let (core, _) = cores[0];
    let _busy = busy_loop(core as u32);
    let (_, others) = finding_of_company(&rig)[0];
    // The loop is always ready to run.
    assert!(others > 0.7, "{others}");
}

/// Returns the shares of the judged cores that other programs used, by core.
fn finding_of_company(rig: &Rig) -> Vec<(u64, f64)> {
    let run = rig.hil(&["doctor", "--seconds", "0.5", "--json"]);
    let report = report(&run, &[&READ[..], &MEASURED].concat());
    let cores = finding(&report, "company")["measured"]["cores"].as_array();
    let share = |core: &Value| Some((core["core"].as_u64()?, core["others"].as_f64()?));
    let shares = cores.expect("cores").iter().map(share);
    shares.collect::<Option<_>>().expect("shares by core")
}

#[test]
fn the_plain_text_has_every_check_and_the_verdict() {
    let rig = Rig::new();
    let run = rig.hil(&["doctor", "--quick"]);
    assert!(!run.stdout.contains('\x1b'), "colours without a terminal");
    let row = |line| {
        let (grade, rest) = str::split_once(line, ' ')?;
        let check = rest.split_ascii_whitespace().next()?;
        ["good", "fair", "poor", "unknown"]
            .contains(&grade)
            .then_some(check)
    };
    let mut rows: Vec<&str> = run.stdout.lines().filter_map(row).collect();
    rows.sort_unstable();
    assert_eq!(rows, READ, "{}", run.stdout);
    let verdict = match run.code {
        Some(0) => "\nfit for timing claims\n",
        Some(1) => "\nunfit for timing claims: ",
        other => panic!("{other:?}\n{}", run.stderr),
    };
    assert!(run.stdout.contains(verdict), "{}", run.stdout);
}

#[test]
fn nonexistent_cores_are_refused() {
    let rig = Rig::new();
    for (arguments, fragment) in [
        (["doctor", "--cores", "0,99999"], "no core 99999"),
        (["doctor", "--cores", "0,0"], "two different cores"),
        (["doctor", "--cores", "0"], "two different cores"),
        (["doctor", "--seconds", "0"], "0.1 to 3600 s"),
    ] {
        let run = rig.hil(&arguments).expect(2).says(&[fragment]);
        assert_eq!(run.stdout, "", "{arguments:?}");
    }
}

#[test]
fn remains_of_a_dead_session_are_removed_before_the_checks() {
    let rig = Rig::new();
    let running = rig.start("tests/scenarios/leakage.toml --set run.duration_s=1000");
    let children = running.children();
    running.kill();
    until_gone(&children);
    let run = rig.beside(&["doctor", "--quick", "--json"]);
    let report = report(&run, &READ);
    let sessions = finding(&report, "sessions");
    let result = sessions["found"].as_str().expect("found");
    assert!(!result.contains(rig.session()), "{result}");
    rig.assert_nothing_left();
}

#[test]
fn a_recording_contains_the_doctors_findings() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/spring-mass.toml --set metrics=[]")
        .expect(0);
    let metadata = Recording::open(&run.recording()).metadata();
    let facts = &metadata["hil.run"];
    for check in READ {
        // The run is itself a session, which the doctor would report.
        if check == "sessions" {
            continue;
        }
        let fact = &facts[&format!("doctor_{check}")];
        let (grade, found) = fact.split_once(": ").expect("grade and finding");
        assert!(
            ["good", "fair", "poor", "unknown"].contains(&grade),
            "{fact}"
        );
        assert!(!found.is_empty(), "{check}");
    }
}
