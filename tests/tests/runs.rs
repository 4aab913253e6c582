//! Runs in a folder as `hil runs` lists and removes them, and the newest run as found by commands.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::support::harness::{Rig, Run, until, until_gone};
use crate::support::programs::shipped;

/// Runs `hil` in the test's folder.
fn hil(rig: &Rig, line: &str) -> Run {
    let words: Vec<&str> = line.split(' ').collect();
    rig.hil_in(&rig.path(""), &words)
}

/// Copies a shipped scenario to the test's folder and returns its name there.
fn scenario(rig: &Rig, name: &str) -> String {
    rig.write(name, &shipped(format!("scenarios/{name}")));
    name.into()
}

fn listed(rig: &Rig, line: &str) -> Vec<Value> {
    let report = hil(rig, &format!("{line} --json")).expect(0).json();
    report["runs"].as_array().expect("runs").clone()
}

fn paths(runs: &[Value]) -> Vec<&str> {
    (runs.iter().map(|run| run["run"].as_str().expect("a path"))).collect()
}

fn summary(folder: &Path) -> Value {
    let text = fs::read(folder.join("summary.json")).expect("a summary");
    serde_json::from_slice(&text).expect("JSON")
}

/// Returns the size of the files in a folder, computed by another program.
fn bytes(folder: &Path) -> u64 {
    let files = fs::read_dir(folder).expect("a folder").flatten();
    (files.map(|file| file.metadata().expect("a file").len())).sum()
}

/// Creates three runs, oldest first: one that passes, one that fails and one in a subfolder that passes.
fn three(rig: &Rig) -> [PathBuf; 3] {
    let (spring, breaks) = (
        scenario(rig, "spring-mass.toml"),
        scenario(rig, "spring-breaks.toml"),
    );
    hil(rig, &format!("run {spring} --out runs/good")).expect(0);
    hil(
        rig,
        &format!("run {spring} --set controller.law=hold --pace 100 --out runs/bad"),
    )
    .expect(1);
    hil(
        rig,
        &format!("run {breaks} --no-record --out runs/of/today"),
    )
    .expect(0);
    ["runs/good", "runs/bad", "runs/of/today"].map(|path| rig.path(path))
}

#[test]
fn runs_are_listed_with_the_facts_of_their_summaries() {
    let rig = Rig::new();
    assert_eq!(hil(&rig, "runs").expect(0).stdout, "no run below runs\n");
    hil(&rig, "runs nowhere").expect(2).says(&["nowhere"]);
    let folders = three(&rig);
    let runs = listed(&rig, "runs");
    assert_eq!(paths(&runs), ["runs/of/today", "runs/bad", "runs/good"]);
    for (run, folder) in runs.iter().rev().zip(&folders) {
        let summary = summary(folder);
        for key in [
            "scenario",
            "set",
            "verdict",
            "digest",
            "steps",
            "started_utc",
        ] {
            assert!(
                !summary[key].is_null() && run[key] == summary[key],
                "{key}: {run}"
            );
        }
        assert_eq!(run["bytes"].as_u64(), Some(bytes(folder)));
        let least = summary["requirements"].as_array().expect("a list").iter();
        let least = least.map(|one| one["robustness"].as_f64().expect("a number"));
        let least = least.fold(f64::INFINITY, |a, b| if a < b { a } else { b });
        assert_eq!(run["margin"]["robustness"].as_f64(), Some(least));
    }
    let set = ["controller.law=hold", "run.clock=paced", "run.pace=100.0"];
    assert_eq!(runs[1]["set"], serde_json::json!(set));
    for (line, expected) in [
        ("runs --sort size", ["good", "bad", "of/today"].as_slice()),
        ("runs --sort margin --last 1", &["bad"]),
        ("runs --sort scenario", &["of/today", "bad", "good"]),
        ("runs --sort verdict --last 1", &["bad"]),
        ("runs --reverse --last 1", &["good"]),
        ("runs --scenario *breaks", &["of/today"]),
        ("runs --verdict fail --verdict aborted", &["bad"]),
        ("runs --since 1h --last 2", &["of/today", "bad"]),
        ("runs --since 9999-12-31", &[]),
        ("runs runs/of", &["of/today"]),
    ] {
        let expected: Vec<String> = expected.iter().map(|name| format!("runs/{name}")).collect();
        assert_eq!(paths(&listed(&rig, line)), expected, "{line}");
    }
    let text = hil(&rig, "runs").expect(0).stdout;
    assert!(
        text.contains("\n  --set controller.law=hold --set run.clock=paced"),
        "{text}"
    );
}

#[test]
fn latest_is_the_most_recently_started_run() {
    let rig = Rig::new();
    hil(&rig, "judge latest")
        .expect(2)
        .says(&["newest run below runs, but there is none"]);
    three(&rig);
    // Neither a copy nor the target of a link is a newer run.
    let copied = rig.path("runs/copy");
    fs::create_dir(&copied).expect("made");
    for file in ["scenario.toml", "summary.json", "run.mcap"] {
        fs::copy(rig.path("runs/good").join(file), copied.join(file)).expect("copied");
    }
    symlink(rig.path("runs/good"), rig.path("runs/zzz")).expect("linked");
    hil(&rig, "judge latest").expect(2).says(&["runs/of/today"]);
    let spring = scenario(&rig, "spring-mass.toml");
    hil(
        &rig,
        &format!("run {spring} --checkpoint-at 2 --out runs/a"),
    )
    .expect(0);
    let digest = summary(&rig.path("runs/a"))["digest"].clone();
    for line in [
        "judge latest",
        "compare latest runs/good",
        "compare runs/good latest/run.mcap",
        "rerun latest --no-record --out again",
        "replay latest",
        "report latest -o page.html",
        "export latest -o table.csv",
        "layout latest foxglove -o layout.json",
        "recover latest",
        "latency latest",
        "scenario from latest -o repeated.toml",
        "run --from latest/checkpoint-2000 --out runs/b",
    ] {
        hil(&rig, line).expect(0);
    }
    assert_eq!(summary(&rig.path("again"))["digest"], digest);
    assert_eq!(summary(&rig.path("runs/b"))["digest"], digest);
    assert_eq!(paths(&listed(&rig, "runs --last 1")), ["runs/b"]);
    // A folder of that name is still accessible.
    fs::rename(rig.path("runs/bad"), rig.path("latest")).expect("renamed");
    hil(&rig, "judge ./latest").expect(1);
}

#[test]
fn runs_are_removed_by_a_rule_and_only_with_confirmation() {
    let rig = Rig::new();
    let [good, bad, today] = three(&rig);
    let all = [&good, &bad, &today];
    hil(&rig, "runs rm").expect(2).says(&["--keep-last"]);
    let text = hil(&rig, "runs rm --keep-last 0").expect(0).stdout;
    assert!(text.starts_with("would remove 3 runs"), "{text}");
    hil(&rig, "runs rm --older-than 1h --yes").expect(0);
    assert!(all.iter().all(|folder| folder.exists()));
    hil(&rig, "runs rm --keep-last 1 --keep-failed --yes").expect(0);
    assert_eq!(all.map(|folder| folder.exists()), [false, true, true]);
    // A file added by the user stays, and so does the run that contains it.
    fs::write(today.join("note.txt"), "mine").expect("written");
    symlink("/etc", bad.join("checkpoint-1")).expect("linked");
    let text = hil(&rig, "runs rm --keep-last 0 --yes").expect(0).stdout;
    assert!(
        text.contains("kept: runs/of/today: it contains note.txt"),
        "{text}"
    );
    assert_eq!(all.map(|folder| folder.exists()), [false, false, true]);
    assert_eq!(fs::read_dir(&today).expect("a folder").count(), 5);
    assert!(Path::new("/etc/passwd").exists());
}

#[test]
fn a_live_run_is_kept_and_a_killed_one_is_broken() {
    let rig = Rig::new();
    let running = rig.start("scenarios/spring-mass.toml --pace 0.1 --wait-limit 60");
    let children = running.children_at_once();
    let folder = running.folder().to_owned();
    until("its folder is there", || folder.join("plant.log").exists());
    let path = folder.display().to_string();
    let verdict = || {
        let report = rig.beside(&["runs", &path, "--json"]).expect(0).json();
        assert_eq!(report["runs"][0]["scenario"], "spring-mass");
        report["runs"][0]["verdict"].clone()
    };
    let remove = || {
        let rm = ["runs", "rm", &path, "--keep-last", "0", "--yes"];
        rig.beside(&rm).expect(0).stdout
    };
    assert_eq!(verdict(), "running");
    let report = remove();
    assert!(report.contains("it is still running"), "{report}");
    assert!(folder.join("scenario.toml").exists());
    running.kill();
    until_gone(&children);
    assert_eq!(verdict(), "broken");
    remove();
    assert!(!folder.exists());
}
