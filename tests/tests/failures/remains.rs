//! Remains of a run: logs, child processes and sessions, after every kind of end.

use hil_session::session::GROUP;
use rustix::process::Signal;
use serde_json::json;

use super::{Aborted, LONG, misbehaves};
use crate::support::harness::{Rig, send, until, until_gone};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{misbehaving_controller, program};

#[test]
fn an_endless_log_keeps_its_beginning_and_its_end() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "chatters").says(&["the first line", "the law said enough"]);
    let log = std::fs::read(run.folder.join("controller.log")).expect("a log");
    // 64 MiB were written; the last read finds the complete log.
    assert!(log.len() <= 8 << 20, "{} bytes", log.len());
    let log = String::from_utf8_lossy(&log);
    assert!(log.starts_with("the first line\nxxxx"));
    assert!(log.contains("the law said enough") && log.contains("bytes here"));
    assert!(run.stderr.len() < 100_000, "{} bytes", run.stderr.len());
    Aborted::of(run, 3, &["controller", "step 100", "panicked"]);
}

#[test]
fn background_processes_of_a_side_end_with_the_run() {
    let rig = Rig::new();
    // A bystander that looks alike, but was not started by the run.
    let bystander = std::process::Command::new("sleep").arg("1000").spawn();
    let mut bystander = bystander.expect("it can be run");
    // The rig searches for every process that names its session.
    misbehaves(&rig, "forks").expect(0);
    let run = misbehaves(&rig, "forks-and-dies");
    assert_eq!(bystander.try_wait().expect("our child"), None);
    bystander.kill().expect("our child");
    bystander.wait().expect("our child");
    Aborted::of(run, 3, &["step 100", "controller was killed by SIGABRT"]);
}

#[test]
fn processes_that_outlived_a_killed_hil_end_with_the_next() {
    let rig = Rig::new();
    let scenario = rig.scenario(1.0, "spring-mass", "forks");
    let controller = misbehaving_controller();
    let (scenario, controller) = (scenario.display(), controller.display());
    let running = rig.start(&format!(
        "{scenario} --controller-bin {controller} --set run.duration_s=1000 --clock paced"
    ));
    until("somebody is left by the controller", || {
        rig.processes()
            .iter()
            .filter(|line| line.contains("while"))
            .count()
            >= 2
    });
    running.kill();
    rig.hil(&["sessions", "--clean"]).expect(0);
}

#[test]
fn background_processes_of_a_description_are_ended() {
    let rig = Rig::new();
    let own = program("controller-process");
    // One that holds the answer's pipe open, in a session of its own; its arguments name this test.
    let text = format!(
        "#!/bin/sh\nsetsid sh -c 'while :; do sleep 1000; done' {} &\nexec '{}' \"$@\"\n",
        rig.path("left").display(),
        own.display()
    );
    let leaving = rig.script("leaving", &text);
    let run = rig.run(&format!(
        "scenarios/spring-mass.toml --controller-bin {}",
        leaving.display()
    ));
    run.expect(0);
}

#[test]
fn ctrl_c_ends_both_processes_and_finishes_the_recording() {
    for signal in [Signal::INT, Signal::TERM] {
        let rig = Rig::new();
        let running = rig.start(LONG);
        let children = running.children();
        running.signal(signal);
        let run = running.finish();
        assert!(children.iter().all(|child| !child.is_alive()));
        let aborted = Aborted::of(run, 130, &["interrupted"]);
        let end = aborted.recording.events.last().expect("an end");
        assert_eq!(
            (&end["event"], &end["outcome"]),
            (&"end".into(), &"stopped".into())
        );
    }
}

#[test]
fn ctrl_c_ends_a_run_in_one_process_too() {
    let rig = Rig::new();
    let running = rig.start(&format!("{LONG} --link in-process"));
    running.wait_for_records();
    running.signal(Signal::INT);
    Aborted::of(running.finish(), 130, &["interrupted"]);
}

#[test]
fn without_hil_both_processes_end_and_the_next_hil_cleans_up() {
    let rig = Rig::new();
    let running = rig.start(LONG);
    let children = running.children();
    running.kill();
    until_gone(&children);
    assert!(
        rig.session_folder().exists(),
        "nobody was there to remove it"
    );
    let records: Vec<_> = Recording::open(&rig.path("run0/run.mcap"))
        .records()
        .collect();
    assert!(records.len() > 100, "{} records survive", records.len());

    rig.hil(&["sessions", "--clean"])
        .expect(0)
        .prints(&[rig.session()]);
}

#[test]
fn the_next_run_cleans_up_after_everything_was_killed() {
    let rig = Rig::new();
    let running = rig.start(LONG);
    let children = running.children();
    running.kill();
    children.iter().for_each(|child| child.kill());
    let run = rig.run("scenarios/spring-mass.toml --set run.duration_s=5");
    run.expect(0);
}

#[test]
fn a_stopped_process_does_not_outlive_hil_for_long() {
    let rig = Rig::new();
    let running = rig.start(LONG);
    let [plant, controller] = running.children();
    send(plant.pid, Signal::STOP);
    until("the plant is stopped", || plant.is_stopped());
    running.kill();
    until("the controller ends by itself", || !controller.is_alive());
    // The kernel may have ended it already: its process group was orphaned.
    rig.hil(&["sessions", "--clean"]).expect(0);
    assert!(!plant.is_alive());
}

#[test]
fn sessions_lists_running_sessions_and_clean_leaves_them_alone() {
    let rig = Rig::new();
    let running = rig.start(LONG);
    let children = running.children();
    for arguments in [&["sessions"][..], &["sessions", "--clean"]] {
        let mut hil = rig.command(program("hil"));
        let output = hil.args(arguments).output().expect("hil can be run");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success() && text.contains(rig.session()),
            "{text}"
        );
    }
    assert!(children.iter().all(|child| child.is_alive()));
    running.signal(Signal::INT);
    running.finish().expect(130);
}

#[test]
fn a_session_of_another_group_is_neither_listed_nor_removed() {
    let rig = Rig::new();
    let running = rig.held();
    let elsewhere = |group: &str, arguments: &[&str]| {
        let mut hil = rig.command(program("hil"));
        hil.args(arguments).env(GROUP, group);
        rig.program(hil)
    };
    let other = format!("{}-b", rig.session());
    let all = elsewhere(&other, &["sessions", "--clean", "--json"]).expect(0);
    assert_eq!(
        all.json(),
        json!({"sessions": [], "removed": []}),
        "of {other}"
    );
    let mark = elsewhere(&other, &["mark", "x", "--session", rig.session()]);
    mark.expect(2).says(&["no session"]);
    let mark = elsewhere("no/group", &["mark", "x"]);
    mark.expect(3).says(&["`no/group` in HIL_SESSION_GROUP"]);
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
}
