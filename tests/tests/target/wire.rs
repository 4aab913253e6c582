//! Two hosts and the wire between them: spoiled, intruded, blocked and cut, with a real `ssh`.

use std::path::Path;

use serde_json::Value;

use super::{SHORT, log, under_way};
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
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    let mut counts = vec![0; 6];
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
        nothing_left_on_board(&hosts);
        // On a busy machine some frames go through the connection too, which nobody spoils; most answers are datagrams.
        let before = std::mem::replace(&mut counts, counted(&mut hosts));
        let answers = counts[5] - before[5];
        assert!(answers > 400, "{percent} %, seed {seed}: {answers}");
    }
    assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
}

/// Counts of the datagrams that the wire passed on, lost, doubled, held back and changed, and of those from the board.
fn counted(hosts: &mut Hosts) -> Vec<u64> {
    let counts = hosts.order("counts");
    let counts = counts.split_ascii_whitespace().skip(1);
    let counts: Vec<u64> = counts.filter_map(|count| count.parse().ok()).collect();
    assert_eq!(counts.len(), 6);
    counts
}

#[test]
fn who_is_on_the_wire_gets_nothing_in() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    hosts.order("intrude");
    let run = rig.start_with(hosts.hil(), &format!("{SHORT} --target board"));
    let run = run.finish().expect(0);
    assert_eq!(run.summary()["digest"], here["digest"]);
    assert!(!log(&run).contains("no datagram"), "{}", log(&run));
    // In real time an old sample that got in would be answered, and the run not repeat.
    let there = rig.start_with(
        hosts.hil(),
        &format!("{SHORT} --target board --clock realtime"),
    );
    let there = there.finish().expect(0);
    rig.rerun(&there.folder, &[]).expect(0);
    nothing_left_on_board(&hosts);
}

#[test]
fn behind_a_firewall_frames_go_through_the_connection_and_back_when_it_opens() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(SHORT).expect(0).summary();
    // The limit is below the second after which a way counts as closed: frames go through the connection until then.
    let paced = format!("{SHORT} --pace 0.3 --wait-limit 0.9 --target board");
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
    let Some(mut hosts) = Hosts::new() else {
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
    // A law that keeps the mass where it is, however late its commands come.
    let clock = format!(
        "--set run.duration_s=12 --clock realtime --wait-limit 60 --set metrics=[] --set requirements=[] \
         --set controller.law=hold --set controller.hold.value={HELD_N} --set plant.safe_command.force_n={SAFE_N}"
    );
    let running = rig.start_with(
        hosts.hil(),
        &format!("scenarios/spring-mass.toml {clock} --target board"),
    );
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
    // Nobody told it to.
    let controller_log = running.folder().join("controller.log");
    let heard = std::fs::read_to_string(controller_log).expect("a log");
    let is_told = format!("no sample after step {step} ");
    assert!(!heard.contains(&is_told), "{heard}");
    hosts.order("mend");
    until("the output is the controller's again", || {
        let output = hosts.output();
        output.is_some_and(|(back, is_safe, _)| back > step && !is_safe)
    });
    let run = running.finish().expect(0);
    // What it did alone is told by number: in the log, as a note of the recording, and in the summary.
    assert!(log(&run).contains(&is_told), "{}", log(&run));
    let summary = run.summary();
    assert!(
        summary["target"]["safe_switches"].as_u64() >= Some(1),
        "{summary}"
    );
    let marks = summary["marks"].as_array().expect("notes");
    let told = marks.iter().find(|mark| {
        let text = mark["text"].as_str().unwrap_or_default();
        text.contains(&is_told) && text.contains("its output was the safe command for")
    });
    let told = told.unwrap_or_else(|| panic!("{summary}"));
    assert!(told["step"].as_u64() > Some(step), "{told}");
    nothing_left_on_board(&hosts);
}

#[test]
fn a_cut_is_survived_or_named_and_the_board_is_clean_either_way() {
    let Some(mut hosts) = Hosts::new() else {
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
    let lost = "target board: nothing received since step";
    let summary = running.finish().expect(3).summary();
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(reason.contains(lost), "{reason}");
    log_until(&folder, lost);
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
    let Some(hosts) = Hosts::new() else {
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
