//! Real-time settings of whole runs: as requested and as granted by the system, without any effect on numbers.
//!
//! Not every machine grants everything. If something is refused, the test checks the reason and the command that
//! fixes it instead.

use std::process::Command;

use serde_json::Value;
use shared_types::thread::ThreadStatistics;

use crate::support::company::{Companion, busy_loop};
use crate::support::harness::{Rig, Run, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::program;

/// Two seconds under FTSC, 20,000 steps.
const SCENARIO: &str = "tests/scenarios/leakage.toml";

fn run(rig: &Rig, arguments: &str) -> Run {
    rig.run(&format!("{SCENARIO} {arguments}")).expect(0)
}

/// Returns a setting in the summary: requested, granted, and the reason of a refusal.
fn setting(run: &Run, pointer: &str) -> (Value, Value, Option<String>) {
    let summary = run.summary();
    let result = summary.pointer(&format!("/realtime/{pointer}"));
    let result = result.unwrap_or_else(|| panic!("no {pointer} in {}", summary["realtime"]));
    let reason = result["reason"].as_str().map(str::to_owned);
    (result["asked"].clone(), result["granted"].clone(), reason)
}

/// Returns the cores available to this process, from the kernel's own list.
fn cores() -> Vec<u32> {
    let status = std::fs::read_to_string("/proc/self/status").expect("reads");
    let list = status
        .lines()
        .find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    let mut cores = Vec::new();
    for part in list.expect("a list").trim().split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let number = |text: &str| text.parse::<u32>().expect("a number");
        cores.extend(number(first)..=number(last));
    }
    cores
}

#[test]
fn no_setting_changes_the_digest_and_each_figure_names_the_wait_strategy() {
    let rig = Rig::new();
    let expected = run(&rig, "--no-record --link in-process").digest();
    let cores = cores();
    let (first, last) = (cores[0], cores[cores.len() - 1]);
    let apart = format!("--plant-core {first} --controller-core {last}");
    let together = format!("--plant-core {first} --controller-core {first}");
    let alone = cores.len() == 1;
    for (arguments, wait) in [
        (String::new(), "hybrid"),
        ("--wait yield".into(), "yield"),
        ("--wait sleep".into(), "sleep"),
        ("--wait spin".into(), if alone { "hybrid" } else { "spin" }),
        (format!("{together} --wait sleep"), "sleep"),
        (together, "hybrid"),
        (format!("{apart} --wait hybrid --prefault"), "hybrid"),
        (
            format!("--link in-process --plant-core {last} --recorder-core {first}"),
            "hybrid",
        ),
        ("--pace 20 --wait yield".into(), "yield"),
    ] {
        let run = run(&rig, &format!("--no-record {arguments}"));
        assert_eq!(run.digest(), expected, "{arguments}");
        assert_eq!(run.summary()["realtime"]["wait"], wait, "{arguments}");
        run.prints(&[&format!("{wait} waits")]);
    }
}

#[test]
fn busy_loops_on_each_core_change_no_digest_and_are_reported() {
    let rig = Rig::new();
    let expected = run(&rig, "--no-record --link in-process").digest();
    let _busy: Vec<Companion> = cores().into_iter().map(busy_loop).collect();
    for arguments in ["--wait hybrid", "--wait sleep", "--pace 2"] {
        let run = run(&rig, &format!("--no-record {arguments}"));
        assert_eq!(run.digest(), expected, "{arguments}");
        let summary = run.summary();
        let company = |key: &str| summary["company"][key].as_f64().expect("a number");
        // Each loop gets at least the core's half, and no process has more than the cores.
        let count = cores().len() as f64;
        assert_eq!(company("cores"), count);
        let others_cores = company("others_cores");
        assert!(
            (0.3 * count..=count).contains(&others_cores),
            "{others_cores}"
        );
        run.prints(&["  meanwhile other programs kept "]);
    }
}

#[test]
fn two_busy_loops_on_each_core_end_no_recorded_run() {
    let rig = Rig::new();
    let expected = run(&rig, "--no-record --link in-process").digest();
    let _busy: Vec<Companion> = (cores().into_iter())
        .flat_map(|core| [core, core])
        .map(busy_loop)
        .collect();
    for arguments in ["", "--pace 2"] {
        let run = run(&rig, arguments);
        assert_eq!(run.digest(), expected, "{arguments}");
        let recording = Recording::open(&run.recording());
        assert_eq!(recording.records().count(), 20_001, "{arguments}");
    }
}

#[test]
fn each_process_runs_on_its_core() {
    let rig = Rig::new();
    let cores = cores();
    let (first, last) = (cores[0], cores[cores.len() - 1]);
    let run = run(
        &rig,
        &format!("--plant-core {first} --controller-core {last} --recorder-core {first}"),
    );
    for (side, core) in [("plant", first), ("controller", last), ("recorder", first)] {
        let (asked, granted, reason) = setting(&run, &format!("{side}/core"));
        assert_eq!((asked, granted, reason), (core.into(), core.into(), None));
    }
    // Not only by their own reports: each sample states the cores of its sides.
    let recording = Recording::open(&run.recording());
    for (column, core) in [
        ("plant_surroundings", first),
        ("controller_surroundings", last),
    ] {
        let place = recording.place(column);
        for record in recording.records() {
            let word = record.words[place];
            // The last record has no command, and so no data of the controller.
            if word != 0 {
                assert_eq!(
                    u32::from(ThreadStatistics::from_wire(word).core),
                    core,
                    "{column}"
                );
            }
        }
    }
}

#[test]
fn a_nonexistent_core_is_refused_with_the_available_ones() {
    let rig = Rig::new();
    let online = std::fs::read_to_string("/sys/devices/system/cpu/online").expect("reads");
    let run = rig
        .run(&format!("{SCENARIO} --controller-core 1023"))
        .expect(2);
    let run = run.says(&[
        "realtime.controller_core = 1023 cannot be used",
        online.trim(),
    ]);
    assert!(!run.folder.exists());
}

#[test]
fn settings_are_granted_or_refused_with_reason_and_fix() {
    let rig = Rig::new();
    let run = run(&rig, "--priority 3 --lock-memory --dma-latency 100");
    let settings = [
        "plant/priority",
        "controller/priority",
        "plant/lock_memory",
        "controller/lock_memory",
        "dma_latency_us",
    ];
    for name in settings {
        let (asked, granted, reason) = setting(&run, name);
        assert_ne!(asked, Value::Null, "{name}");
        // The kernel keeps the shortest latency requested by any process.
        let shorter = name == "dma_latency_us" && granted.as_u64() < asked.as_u64();
        if granted == asked || shorter && !granted.is_null() {
            assert_eq!(reason.is_some(), granted != asked, "{name}");
            continue;
        }
        let reason = reason.unwrap_or_else(|| panic!("{name}: {asked} became {granted}"));
        let (who, key) = name.split_once('/').unwrap_or(("hil", name));
        let line = run.stderr.lines().find(|line| {
            line.starts_with("warning: ")
                && line.contains(&format!("{key} was not granted: {reason}"))
        });
        let line = line.unwrap_or_else(|| panic!("no {key} in:\n{}", run.stderr));
        assert!(line.contains(who), "{line}");
        assert!(run.stderr.contains("\n  fix: "), "{}", run.stderr);
    }
}

/// Returns `hil` without the right to raise priorities and to lock memory.
fn without_rights(rig: &Rig) -> Option<Command> {
    let mut hil = rig.command("setpriv");
    hil.args(["--bounding-set", "-sys_nice,-ipc_lock"]);
    hil.args([
        "--inh-caps",
        "-sys_nice,-ipc_lock",
        "--ambient-caps",
        "-all",
    ]);
    let tried = Command::new("setpriv")
        .args(hil.get_args())
        .arg("true")
        .status();
    hil.arg(program("hil"));
    tried.is_ok_and(|tried| tried.success()).then_some(hil)
}

#[test]
fn without_rights_a_run_continues_and_reports_each_refusal_once() {
    // Only root has rights to give up.
    let rig = Rig::new();
    let hil = without_rights(&rig).unwrap_or_else(|| rig.command(program("hil")));
    let expected = run(&rig, "--no-record").digest();
    let arguments = format!("{SCENARIO} --priority 50 --lock-memory --prefault");
    let run = rig.start_with(hil, &arguments).finish().expect(0);
    assert_eq!(run.digest(), expected);
    let limits = std::fs::read_to_string("/proc/self/limits").expect("reads");
    let limit = |name: &str| {
        let row = limits.lines().find_map(|line| line.strip_prefix(name));
        let soft = row.and_then(|row| row.split_ascii_whitespace().next());
        soft.expect("a limit").to_owned()
    };
    // Unless they were changed, these limits leave no priority and little memory.
    if limit("Max realtime priority") == "0" {
        assert_refused(&run, "priority", 0.into(), "Operation not permitted");
    }
    if limit("Max locked memory") != "unlimited" {
        assert_refused(
            &run,
            "lock_memory",
            false.into(),
            "the limit for locked memory is",
        );
        assert_refused(
            &run,
            "prefault",
            false.into(),
            "the limit for locked memory is",
        );
    }
}

/// Checks that both sides were refused a setting, reported once for both, with one fix for all.
fn assert_refused(run: &Run, name: &str, left: Value, why: &str) {
    for side in ["plant", "controller"] {
        let (_, granted, reason) = setting(run, &format!("{side}/{name}"));
        assert_eq!(granted, left, "{side} {name}");
        assert!(reason.expect("a reason").contains(why));
    }
    let text = &run.stderr;
    let warning = format!("warning: plant and controller: {name} was not granted: ");
    assert_eq!(text.matches(&warning).count(), 1, "{text}");
    assert_eq!(text.matches("/etc/security/limits.d/").count(), 1, "{text}");
}

/// Counts page faults of a side between its first sample of statistics, in step 0, and its last.
fn faults(run: &Run, side: &str) -> u32 {
    let recording = Recording::open(&run.recording());
    let place = recording.place(&format!("{side}_surroundings"));
    let looks: Vec<ThreadStatistics> = (recording.records())
        .map(|record| record.words[place])
        .filter(|word| *word != 0)
        .map(ThreadStatistics::from_wire)
        .collect();
    let (first, last) = (looks[0], looks[looks.len() - 1]);
    last.since(first).1
}

#[test]
fn a_prefaulted_loop_has_no_page_faults() {
    let rig = Rig::new();
    let without = run(&rig, "");
    assert!(faults(&without, "plant") > 0, "records go to fresh memory");
    let with = run(&rig, "--prefault");
    for side in ["plant", "controller"] {
        let (_, granted, reason) = setting(&with, &format!("{side}/prefault"));
        if granted == true {
            assert_eq!(faults(&with, side), 0, "{side}");
        } else {
            assert!(reason.is_some(), "{side}");
        }
    }
}

/// Returns scheduling policy and cores of each thread of a process: 0 is ordinary, 1 `SCHED_FIFO`.
fn threads(pid: u32) -> Vec<(bool, u32, String)> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).expect("the process is there");
    let of = |task: std::path::PathBuf| {
        let read = |name| std::fs::read_to_string(task.join(name)).ok();
        let (stat, status) = (read("stat")?, read("status")?);
        let (_, after_name) = stat.rsplit_once(')')?;
        let policy = after_name
            .split_ascii_whitespace()
            .nth(41 - 3)?
            .parse()
            .ok()?;
        let cores = status
            .lines()
            .find_map(|line| line.strip_prefix("Cpus_allowed_list:"))?;
        let is_main = task.ends_with(pid.to_string());
        Some((is_main, policy, cores.trim().to_owned()))
    };
    tasks.flatten().filter_map(|task| of(task.path())).collect()
}

#[test]
fn only_the_loop_leaves_ordinary_scheduling() {
    let rig = Rig::new();
    let cores = cores();
    let core = cores[0];
    let arguments = format!(
        "{SCENARIO} --pace 0.5 --plant-core {core} --controller-core {core} --priority 3 --pause-at 0.01"
    );
    let hil = rig.start(&arguments);
    let session = rig.session_folder();
    until("both sides tell what they run with", || {
        ["plant", "controller"]
            .iter()
            .all(|side| session.join(format!("{side}-realtime.json")).exists())
    });
    let info = hil_session::session::SessionInfo::read(&session).expect("the session is there");
    let all = std::fs::read_to_string("/proc/self/status").expect("reads");
    let all = all
        .lines()
        .find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    let all = all.expect("a list").trim();
    for (child, side) in info.children.iter().zip(["plant", "controller"]) {
        let report: Value = info
            .read_file(&format!("{side}-realtime.json"))
            .expect("a report");
        let granted = report["priority"]["granted"] == 3;
        let result = threads(child.pid);
        assert!(result.len() > 1, "{side}: {result:?}");
        for (is_loop, policy, allowed) in result {
            if is_loop {
                assert_eq!(
                    (policy, allowed),
                    (u32::from(granted), core.to_string()),
                    "{side}"
                );
            } else {
                assert_eq!((policy, allowed.as_str()), (0, all), "{side}");
            }
        }
    }
    rig.in_session("resume").expect(0);
    hil.finish().expect(0);
}

#[test]
fn a_rerun_requests_none_of_the_settings_of_the_run() {
    let rig = Rig::new();
    let core = cores()[0];
    let before = run(&rig, &format!("--plant-core {core} --wait yield"));
    let metadata = Recording::open(&before.recording()).metadata();
    let kept: Vec<&String> = metadata
        .values()
        .filter_map(|facts| facts.get("realtime_plant"))
        .collect();
    let report: Value = serde_json::from_str(kept[0]).expect("JSON");
    assert_eq!(report["core"]["granted"], core);
    let answer = rig.rerun(&before.folder, &["--json"]).expect(0).json();
    assert_eq!(answer["same"], true);
    assert_eq!(
        answer["summary"]["realtime"]["plant"]["core"]["asked"],
        Value::Null
    );
    assert_eq!(
        answer["summary"]["realtime"]["plant"]["wait"]["asked"],
        "hybrid"
    );
}
