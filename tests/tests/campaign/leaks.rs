//! Workers that run many cases leak neither descriptors nor threads.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use super::{STUDY, campaign, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::program;

/// Difference between early and late cases in the same worker that does not count as a leak, for example a thread
/// about to end. One leaked descriptor per case would add up to over 50.
const PASSING: usize = 20;

/// Counts descriptors and threads of a worker and of the processes that it keeps.
fn held(worker: u32) -> usize {
    let process = PathBuf::from(format!("/proc/{worker}"));
    let count = |path: &Path| std::fs::read_dir(path).map_or(0, Iterator::count);
    let mut all = count(&process.join("fd")) + count(&process.join("task"));
    let tasks = std::fs::read_dir(process.join("task"));
    for task in tasks.into_iter().flatten().flatten() {
        let children = std::fs::read_to_string(task.path().join("children")).unwrap_or_default();
        let children = children
            .split_whitespace()
            .filter_map(|child| child.parse().ok());
        all += children.map(held).sum::<usize>();
    }
    all
}

/// Runs all cases in one worker and compares its resources in the first cases with those in the last.
fn assert_no_growth(rig: &Rig, folder: &Path) {
    let mut worker = rig.command(program("hil"));
    worker.args(["campaign", "work", "--tell", text(folder)]);
    let mut worker = worker.stdout(Stdio::piped()).spawn().expect("hil runs");
    let lines = BufReader::new(worker.stdout.take().expect("piped")).lines();
    let mut counts = Vec::new();
    for line in lines.map_while(Result::ok) {
        if line.starts_with("case ") {
            counts.push(held(worker.id()));
        }
    }
    assert!(worker.wait().expect("it ends").success());
    assert!(counts.len() >= 120, "{}", counts.len());
    // Skips the first cases, which open persistent resources, and the last one, after which everything is closed.
    // Short-lived resources are seen in some cases only, leaked ones in all that follow.
    let least = |counts: &[usize]| counts.iter().copied().min().unwrap_or_default();
    let (early, late) = (least(&counts[5..30]), least(&counts[90..counts.len() - 1]));
    assert!(early > 0 && late < early + PASSING, "{early}, later {late}");
}

#[test]
fn a_worker_that_runs_in_one_process_leaks_nothing_from_case_to_case() {
    let rig = Rig::new();
    let study = study(&rig, &STUDY.replace("cases = 30", "cases = 60"));
    assert_no_growth(&rig, &planned(&rig, &study, "in-process"));
}

#[test]
fn a_worker_with_kept_or_new_processes_leaks_nothing_from_case_to_case() {
    let rig = Rig::new();
    for (name, more) in [("kept", ""), ("new", "fresh_processes = true\n")] {
        let text_of = STUDY.replace("cases = 30", "cases = 60");
        let (study, folder) = (study(&rig, &format!("{more}{text_of}")), rig.path(name));
        let sides = ["plant-process", "controller-process"].map(program);
        let plan = ["plan", text(&study), "-o", text(&folder)];
        let options = [
            "--plant-bin",
            text(&sides[0]),
            "--controller-bin",
            text(&sides[1]),
        ];
        campaign(&rig, &[&plan[..], &options[..]].concat()).expect(0);
        assert_no_growth(&rig, &folder);
    }
}
