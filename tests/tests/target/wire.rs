//! Two hosts and the wire between them: disturbed, intruded, blocked and cut, with a real `ssh`.

use std::path::Path;

use serde_json::Value;

use super::{SHORT, log, under_way};
use crate::support::harness::{Rig, until};
use crate::support::hosts::Hosts;

/// Returns the number of answers that arrived as datagrams, and of all answers, as counted by the bridge at its
/// end.
fn answers(log: &str) -> (u64, u64) {
    let counted = log.lines().find_map(|line| {
        let (_, counts) = line.split_once("target board: ")?;
        let (datagrams, rest) = counts.split_once(" of ")?;
        let (all, _) = rest.split_once(" answers arrived as datagrams")?;
        Some((datagrams.parse().ok()?, all.parse().ok()?))
    });
    counted.unwrap_or_else(|| panic!("{log}"))
}

fn log_until(folder: &Path, what: &str) {
    until("the log tells it", || {
        std::fs::read_to_string(folder.join("controller.log")).is_ok_and(|log| log.contains(what))
    });
}

/// Returns steps after which the target missed samples, except those before this one.
fn switches_after(step: u64, log: &str) -> Vec<u64> {
    let parts = log.split("no sample after step ").skip(1);
    let steps = parts.filter_map(|part| part.split_once(' ')?.0.parse().ok());
    steps.filter(|at| *at >= step).collect()
}

pub(super) fn nothing_left_on_board(hosts: &Hosts) {
    until("the board is clean", || hosts.left_on_board().is_empty());
}

#[test]
fn over_a_wire_that_loses_duplicates_reorders_and_corrupts_the_digest_is_that_of_the_desk() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    let mut counts = vec![0; 6];
    for (percent, seed) in [(0, 0), (5, 1), (5, 2), (20, 3)] {
        hosts.order(&format!("spoil {percent} {seed}"));
        let run = hosts.start(&rig, SHORT).finish().expect(0);
        assert_eq!(
            run.summary()["digest"],
            here["digest"],
            "{percent} %, seed {seed}"
        );
        nothing_left_on_board(&hosts);
        // A clean wire carries nearly all answers; at the start and in a stall of the machine, the connection does.
        let (datagrams, all) = answers(&log(&run));
        assert!(
            percent > 0 || 10 * datagrams > 9 * all,
            "{datagrams} of {all}"
        );
        let before = std::mem::replace(&mut counts, counted(&mut hosts));
        let answers = counts[5] - before[5];
        assert!(answers > 400, "{percent} %, seed {seed}: {answers}");
    }
    assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
}

/// Counts the datagrams that the wire forwarded, lost, duplicated, delayed and changed, and those from the board.
fn counted(hosts: &mut Hosts) -> Vec<u64> {
    let counts = hosts.order("counts");
    let counts = counts.split_ascii_whitespace().skip(1);
    let counts: Vec<u64> = counts.filter_map(|count| count.parse().ok()).collect();
    assert_eq!(counts.len(), 6);
    counts
}

#[test]
fn an_attacker_on_the_wire_cannot_inject_anything() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    hosts.order("intrude");
    let run = hosts.start(&rig, SHORT).finish().expect(0);
    assert_eq!(run.summary()["digest"], here["digest"]);
    assert!(!log(&run).contains("no datagram"), "{}", log(&run));
    // In real time an accepted old sample would be answered, and the run not be repeatable.
    let there = rig.start_with(
        hosts.hil(),
        &format!("{SHORT} --target board --clock realtime"),
    );
    let there = there.finish().expect(0);
    rig.rerun(&there.folder, &[]).expect(0);
    nothing_left_on_board(&hosts);
}

#[test]
fn frames_use_the_connection_while_a_firewall_blocks_datagrams() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    let held = format!("{SHORT} --pause-at 0.4");
    hosts.order("block");
    let running = hosts.start(&rig, &held);
    rig.until_held_at(400);
    log_until(running.folder(), "no datagrams get through");
    hosts.order("mend");
    rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    assert_eq!(run.summary()["digest"], here["digest"]);
    let text = log(&run);
    assert!(
        text.contains("datagrams get through to 10.77.0.2"),
        "{text}"
    );
    // Everything before the pause went through the connection, and soon nothing after it.
    let (datagrams, all) = answers(&text);
    assert!((1..=all - 400).contains(&datagrams), "{text}");
    nothing_left_on_board(&hosts);
}

#[test]
fn real_time_runs_with_bursts_of_loss_repeat_at_the_desk_with_the_same_digest() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    // Slow enough for a busy machine to keep up, or the law loses the mass.
    let clock = "--set run.rate_hz=100 --clock realtime --set metrics=[] --set requirements=[]";
    let there = hosts.start(&rig, &format!("scenarios/spring-mass.toml {clock}"));
    under_way(&rig);
    hosts.order("spoil 2 1");
    for _ in 0..5 {
        hosts.order("burst 20");
        let step = rig.status().step;
        until("bursts are apart", || rig.status().step > step + 50);
    }
    let there = there.finish().expect(0);
    let missed = &there.summary()["missed_commands"];
    assert!(missed["longest_streak"].as_u64() >= Some(20), "{missed}");
    rig.rerun(&there.folder, &[]).expect(0);
}

#[test]
fn a_target_without_samples_switches_its_output_to_the_safe_command_by_itself() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    const HELD_N: f64 = 0.5;
    const SAFE_N: f64 = -1.25;
    let rig = Rig::new();
    // A law that keeps the mass where it is, however late its commands arrive, and periods that a busy machine keeps.
    let clock = format!(
        "--set run.duration_s=12 --set run.rate_hz=100 --clock realtime --wait-limit 60 --set metrics=[] --set requirements=[] \
         --set controller.law=hold --set controller.hold.value={HELD_N} --set plant.safe_command.force_n={SAFE_N}"
    );
    let running = hosts.start(&rig, &format!("scenarios/spring-mass.toml {clock}"));
    under_way(&rig);
    let mut last = 0;
    until("commands are put out", || {
        let output = hosts.output();
        output.is_some_and(|(step, is_safe, values)| {
            last = step;
            !is_safe && step > 0 && values == [HELD_N]
        })
    });
    hosts.order("cut");
    let mut safe = None;
    until("the output is the safe command", || {
        safe = hosts.output().filter(|(_, is_safe, _)| *is_safe);
        safe.is_some()
    });
    let (step, _, values) = safe.expect("seen");
    assert_eq!(values, [SAFE_N]);
    assert!(step >= last, "{step} {last}");
    // The desk did not order it: it received no report of a switch after that step.
    let controller_log = running.folder().join("controller.log");
    let before = std::fs::read_to_string(controller_log).expect("a log");
    assert!(switches_after(step, &before).is_empty(), "{before}");
    hosts.order("mend");
    until("the output is the controller's again", || {
        let output = hosts.output();
        output.is_some_and(|(back, is_safe, _)| back > step && !is_safe)
    });
    let run = running.finish().expect(0);
    // Switches without a connection are counted: in the log, as a mark in the recording, and in the summary.
    let switches = switches_after(step, &log(&run));
    // The last sample may have had no answer.
    let last_sample = switches.first().expect("a switch is logged");
    let text = format!("no sample after step {last_sample} ");
    let summary = run.summary();
    assert!(
        summary["target"]["safe_switches"].as_u64() >= Some(1),
        "{summary}"
    );
    let marks = summary["marks"].as_array().expect("notes");
    let answer = marks.iter().find(|mark| {
        let mark_text = mark["text"].as_str().unwrap_or_default();
        mark_text.contains(&text) && mark_text.contains("its output was the safe command for")
    });
    let answer = answer.unwrap_or_else(|| panic!("{summary}"));
    assert!(answer["step"].as_u64() > Some(step), "{answer}");
    nothing_left_on_board(&hosts);
}

#[test]
fn a_cut_is_survived_or_named_and_leaves_the_board_clean() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    // A paused run cannot end before the cut, however slow the machine is.
    let held = format!("{SHORT} --pause-at 0.4");
    let last = "since step 399";
    // A cut shorter than the limit costs time; the controller stays the same.
    let running = hosts.start(&rig, &format!("{held} --wait-limit 60"));
    rig.until_held_at(400);
    let there = hosts.left_on_board();
    let has = |what: &str| there.iter().any(|entry| entry.contains(what));
    assert!(
        has("/session.json") && has(" agent") && has("--session"),
        "{there:?}"
    );
    hosts.order("cut");
    rig.in_session("resume").expect(0);
    log_until(running.folder(), "no datagrams get through");
    hosts.order("mend");
    let summary = running.finish().expect(0).summary();
    assert_eq!(summary["digest"], here["digest"]);
    assert_eq!(summary["controllers"], Value::Array(Vec::new()));
    nothing_left_on_board(&hosts);

    // While paused the plant awaits no answer: only the bridge misses the board.
    let running = hosts.start(&rig, &held);
    rig.until_held_at(400);
    hosts.order("cut");
    let folder = running.folder().to_owned();
    let lost = &format!("target board: nothing received {last}");
    let summary = running.finish().expect(3).summary();
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(reason.contains(lost), "{reason}");
    log_until(&folder, lost);
    // The board receives nothing either, and ends by itself.
    nothing_left_on_board(&hosts);
    hosts.order("mend");

    // The same with a policy: the run continues without the controller.
    let policy = "--set run.on_controller_loss=hold";
    let running = hosts.start(&rig, &format!("{held} {policy}"));
    rig.until_held_at(400);
    hosts.order("cut");
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
    nothing_left_on_board(&hosts);
}

#[test]
fn a_real_ssh_refuses_strangers_and_impostors() {
    let Some(hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    for (host, expected, code) in [
        ("nobody.invalid", "Could not resolve hostname", 2),
        ("impostor", "Host key verification failed", 2),
        ("stranger", "Permission denied", 2),
        ("elsewhere", "ssh: connect to host 10.77.0.9", 3),
    ] {
        let run = rig
            .start_with(hosts.hil(), &format!("{SHORT} --target {host}"))
            .finish()
            .expect(code);
        assert!(!run.folder.exists(), "{host}");
        run.says(&[&format!("target {host}"), expected]);
    }
    nothing_left_on_board(&hosts);
}
