//! The three clocks: paced and real-time runs compared with lockstep, late steps and commands, the overrun
//! policies, and reruns that repeat all of it.

use std::collections::BTreeMap;

use rustix::process::Signal;
use serde_json::Value;

use crate::support::harness::{EXPIRES_S, Rig, Run, send, text, until};
use crate::support::mcap_reader::{Record, Recording};

/// Run of 1 s of the teaching plant at 200 Hz: 5 ms per step.
pub(crate) const SCENARIO: &str = r#"
schema = 1
name = "clocks"
[run]
duration_s = 1.0
rate_hz = 200
[plant]
model = "spring-mass"
[controller]
law = "pid"
[[stimuli]]
target = "position_m"
kind = "sine"
amplitude = 0.01
frequency_hz = 2.0
"#;

/// Returns a fault that makes a side busy for 12 ms at each of ten steps from 0.2 s, step 40, on.
fn busy(side: &str) -> String {
    busy_for(12, side, 0.2)
}

/// Returns a fault that makes a side busy for so long at each of ten steps from a time on.
pub(crate) fn busy_for(ms: u32, side: &str, at_s: f64) -> String {
    format!(
        "[[faults]]\nkind = \"late\"\nat_s = {at_s:?}\noccurrences = 10\n\
         [[faults.effects]]\ntarget = \"{side}\"\nbusy_us = {ms}000\n"
    )
}

fn run(rig: &Rig, faults: &str, arguments: &str) -> Run {
    let path = rig.write("clocks.toml", &format!("{SCENARIO}{faults}"));
    rig.run(&format!("{} {arguments}", path.display()))
}

fn lockstep(rig: &Rig) -> String {
    run(rig, "", "--no-record").expect(0).digest()
}

fn number(summary: &Value, pointer: &str) -> u64 {
    let number = summary.pointer(pointer).and_then(Value::as_u64);
    number.unwrap_or_else(|| panic!("no {pointer} in {summary}"))
}

#[test]
fn in_real_time_a_run_without_a_miss_has_the_digest_of_lockstep() {
    let rig = Rig::new();
    // Slow steps with matching gains: a busy machine occupies a core for 10 ms and more.
    let slow = "--set run.rate_hz=20 --set run.duration_s=2 --set run.deadline=1 \
        --set controller.pid.proportional_n_per_m=10 --set controller.pid.derivative_n_s_per_m=0";
    let expected = run(&rig, "", slow).expect(0).digest();
    // Another program may still occupy it for longer than a step: such a run proves nothing here.
    for _ in 0..10 {
        let real = run(&rig, "", &format!("{slow} --clock realtime")).expect(0);
        let summary = real.summary();
        assert_eq!(summary["clock"], "realtime");
        if number(&summary, "/missed_commands/count") == 0 {
            assert_eq!(real.digest(), expected);
            return;
        }
    }
    panic!("none of ten runs at 20 Hz was in time");
}

#[test]
fn a_busy_controller_misses_deadlines_and_a_rerun_repeats_them() {
    let rig = Rig::new();
    let late = run(&rig, &busy("controller"), "--clock realtime").expect(0);
    let summary = late.summary();
    // 12 ms of every 5 ms: of three samples it answers one, late.
    assert!(number(&summary, "/missed_commands/count") >= 10);
    assert!(number(&summary, "/missed_commands/longest_streak") >= 2);
    assert!(number(&summary, "/missed_commands/first_step") <= 40);
    assert_eq!(summary["steps"], 200, "the plant went on");
    assert_ne!(late.digest(), lockstep(&rig));

    let recording = Recording::open(&late.recording());
    let records: Vec<Record> = recording.records().collect();
    let word = |record: &Record, name| record.words[recording.place(name)];
    let mut of_step = BTreeMap::new();
    let mut held = 0;
    for record in &records[..200] {
        let held_steps = word(record, "held_steps");
        held += u64::from(held_steps > 0);
        assert_eq!(word(record, "command_age_steps"), held_steps);
        // All steps with the same command agree.
        let command = word(record, "command.force_n");
        let first = *of_step.entry(record.step() - held_steps).or_insert(command);
        assert_eq!(command, first, "step {}", record.step());
    }
    assert_eq!(held, number(&summary, "/missed_commands/count"));

    let folder = text(&late.folder);
    let session = ["--session", rig.session()];
    let again = rig.rerun(&late.folder, &session).expect(0).folder;
    // The rerun reports the same about itself, so that it can be repeated as well.
    let output = rig
        .hil(&[
            "rerun",
            text(&again),
            "--link",
            "in-process",
            "--no-record",
            "--json",
        ])
        .expect(0)
        .json();
    assert_eq!(
        (&output["same"], &output["digest"]),
        (&true.into(), &late.digest().into())
    );
    let counts = ["count", "longest_streak", "first_step"];
    for count in counts.map(|count| format!("/missed_commands/{count}")) {
        assert_eq!(number(&output["summary"], &count), number(&summary, &count));
    }
    rig.hil(&["rerun", folder, "--clock", "realtime"])
        .expect(2)
        .says(&["in lockstep"]);
}

#[test]
fn a_law_that_runs_at_every_fifth_sample_repeats_its_misses_too() {
    let rig = Rig::new();
    let divided =
        "--clock realtime --set controller.rate_hz=40 --set controller.command_delay_steps=1";
    let late = run(&rig, &busy("controller"), divided).expect(0);
    assert!(number(&late.summary(), "/missed_commands/count") >= 10);
    let folder = text(&late.folder);
    rig.hil(&["rerun", folder, "--link", "in-process", "--no-record"])
        .expect(0);
}

#[test]
fn a_busy_plant_overruns_and_each_policy_keeps_the_trajectory() {
    let rig = Rig::new();
    let expected = lockstep(&rig);
    // By these times the run is longer at least: 7 ms of lateness are two whole periods, or 7 ms.
    for (policy, longer_ms) in [("catch-up", 0), ("skip", 100), ("stretch", 70)] {
        let arguments = format!("--clock paced --set run.overrun={policy}");
        let paced = run(&rig, &busy("plant"), &arguments).expect(0);
        let summary = paced.summary();
        assert_eq!(summary["overruns"]["policy"], policy);
        assert!(number(&summary, "/overruns/count") >= 10, "{policy}");
        assert!(number(&summary, "/overruns/first_step") <= 41, "{policy}");
        assert_eq!(paced.digest(), expected, "{policy}");
        let wall_time_s = summary["wall_time_s"].as_f64().expect("a time");
        assert!(
            wall_time_s >= 0.995 + 1e-3 * f64::from(longer_ms),
            "{policy}: {wall_time_s} s"
        );
    }
}

#[test]
fn the_policy_abort_ends_a_run_at_the_late_step() {
    let rig = Rig::new();
    let paced = "--clock paced --set run.overrun=abort";
    run(&rig, &busy("plant"), paced).expect(3).says(&[
        "was due",
        "before the previous step was done",
        "`abort`",
    ]);
    let real = "--clock realtime --set run.overrun=abort";
    run(&rig, &busy("controller"), real)
        .expect(3)
        .says(&["`abort`"]);
}

#[test]
fn one_thread_has_no_real_time() {
    run(&Rig::new(), "", "--clock realtime --link in-process")
        .expect(2)
        .says(&["two processes"]);
}

/// Ten seconds of the hydraulic system at 10 kHz in real time, under a law without feedback: on a loaded machine,
/// late commands of another law would make the plant diverge.
fn long(rig: &Rig) -> String {
    let text = "schema = 1\nname = \"long\"\n[run]\nduration_s = 10.0\nrate_hz = 10000\n\
        clock = \"realtime\"\n[plant]\nmodel = \"drhas\"\n[controller]\nlaw = \"hold\"\n\
        [[stimuli]]\ntarget = \"surface_angle_rad\"\nkind = \"paper\"\n";
    rig.write("long.toml", text).display().to_string()
}

#[test]
fn in_real_time_a_stopped_controller_is_named_after_the_wait_limit() {
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{} --set run.duration_s=100 --wait-limit {EXPIRES_S}",
        long(&rig)
    ));
    let [_, controller] = running.children_at_once();
    until("steps are exchanged", || rig.status().step > 1000);
    send(controller.pid, Signal::STOP);
    let stopped = running.finish().expect(3);
    let summary = stopped.summary();
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(
        reason.contains("controller did not answer step "),
        "{reason}"
    );
    assert!(reason.contains("controller was stopped"), "{reason}");
    // Until then the plant continued with the last command.
    assert!(number(&summary, "/missed_commands/longest_streak") > 1000);
}

#[test]
fn in_real_time_a_slow_recorder_loses_records_and_says_how_many() {
    let rig = Rig::new();
    let running = rig.start(&long(&rig));
    running.children_at_once();
    until("steps are exchanged", || rig.status().step > 1000);
    running.signal(Signal::STOP);
    let last = rig.status().step + 15_000; // more than the buffer holds
    until("the plant goes on", || rig.status().step > last);
    running.signal(Signal::CONT);
    let slow = running.finish().expect(0);
    let summary = slow.summary();
    assert_eq!(summary["steps"], 100_000, "the plant did not wait");
    let lost = number(&summary, "/recording/lost");
    assert!(lost > 0);
    assert_eq!(number(&summary, "/recording/records") + lost, 100_001);
    assert_eq!(summary["digest"], Value::Null);
    let folder = text(&slow.folder);
    rig.hil(&["rerun", folder]).expect(2).says(&["lost"]);
}
