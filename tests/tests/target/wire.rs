//! Two hosts and the wire between them: spoiled, intruded, blocked and cut, with a real `ssh`.

use std::path::Path;

use serde_json::Value;

use super::{SHORT, log, text, under_way};
use crate::support::harness::{Rig, until};
use crate::support::hosts::Hosts;

fn log_until(folder: &Path, what: &str) {
    until("the log tells it", || {
        std::fs::read_to_string(folder.join("controller.log")).is_ok_and(|log| log.contains(what))
    });
}

pub(super) fn nothing_left_on_board(hosts: &Hosts) {
    until("the board is clean", || hosts.left_on_board().is_empty());
}

#[test]
fn over_a_wire_that_loses_doubles_reorders_and_corrupts_the_digest_is_that_of_the_desk() {
    let test =
        "over_a_wire_that_loses_doubles_reorders_and_corrupts_the_digest_is_that_of_the_desk";
    let Some(mut hosts) = Hosts::new(test) else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    for (percent, seed) in [(0, 0), (5, 1), (5, 2), (20, 3)] {
        hosts.order(&format!("spoil {percent} {seed}"));
        let run = rig
            .start_with(hosts.hil(), &format!("{SHORT} --target board"))
            .finish()
            .expect(0);
        assert_eq!(
            run.summary()["digest"],
            here["digest"],
            "{percent} %, seed {seed}"
        );
        assert!(!log(&run).contains("no datagram"), "{}", log(&run));
        nothing_left_on_board(&hosts);
    }
    let counts = hosts.order("counts");
    let counts: Vec<u64> = counts
        .split_ascii_whitespace()
        .skip(1)
        .filter_map(|count| count.parse().ok())
        .collect();
    assert!(
        counts.len() == 5 && counts.iter().all(|count| *count > 50),
        "{counts:?}"
    );
}

#[test]
fn who_is_on_the_wire_gets_nothing_in() {
    let Some(mut hosts) = Hosts::new("who_is_on_the_wire_gets_nothing_in") else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    hosts.order("intrude");
    let run = rig.start_with(hosts.hil(), &format!("{SHORT} --target board"));
    let run = run.finish().expect(0);
    assert_eq!(run.summary()["digest"], here["digest"]);
    assert!(!log(&run).contains("no datagram"), "{}", log(&run));
    // Against the clock an old sample that got in would be answered, and the run not repeat.
    let there = rig.start_with(
        hosts.hil(),
        &format!("{SHORT} --target board --clock realtime"),
    );
    let there = there.finish().expect(0);
    let again = rig.path("again");
    rig.hil(&["rerun", text(&there.folder), "--out", text(&again)])
        .expect(0);
    nothing_left_on_board(&hosts);
}

#[test]
fn behind_a_firewall_frames_go_through_the_connection_and_back_when_it_opens() {
    let test = "behind_a_firewall_frames_go_through_the_connection_and_back_when_it_opens";
    let Some(mut hosts) = Hosts::new(test) else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    let paced = format!("{SHORT} --pace 0.3 --wait-limit 0.5 --target board");
    hosts.order("block");
    let running = rig.start_with(hosts.hil(), &paced);
    log_until(running.folder(), "no datagram gets through");
    hosts.order("mend");
    assert_eq!(
        running.finish().expect(0).summary()["digest"],
        here["digest"]
    );
    nothing_left_on_board(&hosts);
}

#[test]
fn against_the_clock_bursts_of_lost_datagrams_repeat_here_to_the_same_digest() {
    let test = "against_the_clock_bursts_of_lost_datagrams_repeat_here_to_the_same_digest";
    let Some(mut hosts) = Hosts::new(test) else {
        return;
    };
    let rig = Rig::new();
    let clock = "--set run.duration_s=2 --clock realtime --set metrics=[] --set requirements=[]";
    let there = rig.start_with(
        hosts.hil(),
        &format!("scenarios/spring-mass.toml {clock} --target board"),
    );
    under_way(&rig);
    hosts.order("spoil 2 1");
    for _ in 0..5 {
        hosts.order("burst 20");
        std::thread::sleep(std::time::Duration::from_millis(100)); // bursts apart
    }
    let there = there.finish().expect(0);
    let missed = &there.summary()["missed_commands"];
    assert!(missed["longest_streak"].as_u64() >= Some(20), "{missed}");
    let again = rig.path("again");
    rig.hil(&["rerun", text(&there.folder), "--out", text(&again)])
        .expect(0);
}

#[test]
fn a_cut_is_survived_or_named_and_the_board_is_clean_either_way() {
    let test = "a_cut_is_survived_or_named_and_the_board_is_clean_either_way";
    let Some(mut hosts) = Hosts::new(test) else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    let paced = format!("{SHORT} --pace 0.5 --target board");
    // A short cut costs time; the controller stays the same.
    let running = rig.start_with(hosts.hil(), &format!("{paced} --wait-limit 60"));
    under_way(&rig);
    let there = hosts.left_on_board();
    let has = |what: &str| there.iter().any(|found| found.contains(what));
    assert!(
        has("/session.json") && has(" agent") && has("--session"),
        "{there:?}"
    );
    hosts.order("cut");
    std::thread::sleep(std::time::Duration::from_millis(700)); // how long is of no account
    hosts.order("mend");
    let summary = running.finish().expect(0).summary();
    assert_eq!(summary["digest"], here["digest"]);
    assert_eq!(summary["controllers"], Value::Array(Vec::new()));
    nothing_left_on_board(&hosts);

    let running = rig.start_with(hosts.hil(), &format!("{paced} --wait-limit 1"));
    under_way(&rig);
    hosts.order("cut");
    let folder = running.folder().to_owned();
    let run = running.finish().expect(3);
    log_until(&folder, "target board: nothing received since step");
    drop(run);
    // The board hears nothing either, and ends by itself.
    nothing_left_on_board(&hosts);
    hosts.order("mend");

    // The same with a policy: the run goes on without the controller.
    let policy = "--set run.on_controller_loss=hold --wait-limit 1";
    let running = rig.start_with(hosts.hil(), &format!("{paced} {policy}"));
    under_way(&rig);
    hosts.order("cut");
    running.finish().expect(0);
    nothing_left_on_board(&hosts);
}

#[test]
fn a_real_ssh_refuses_strangers_impostors_and_nobody() {
    let test = "a_real_ssh_refuses_strangers_impostors_and_nobody";
    let Some(hosts) = Hosts::new(test) else {
        return;
    };
    let rig = Rig::new();
    for (host, told, code) in [
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
        run.says(&[&format!("target {host}"), told]);
    }
    nothing_left_on_board(&hosts);
}
