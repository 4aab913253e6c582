//! A rig behind a port as the plant of a run: an independent peer with a spring and a mass in real time, a controller of
//! ours, requirements on measured signals, and the safe values after every kind of end.

mod can;
mod kills;
mod media;
mod peer;

use std::sync::atomic::Ordering;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::support::harness::{EXPIRES_S, Rig, send, text};
use crate::support::programs::shipped;
use crate::support::python::python;
use kills::{endless, endless_within, process_with, without_processes};
use peer::{Peer, REPEATS, SAFE_N, free, scenario, write_port};

const REQUIREMENTS: &str = r#"
[[requirements]]
name = "arrives"
formula = "eventually measured.position_m > 0.008"
[[metrics]]
name = "largest_m"
expression = "max(measured.position_m)"
"#;

/// Runs a scenario into the folder `out`, and returns the summary.
fn run(rig: &Rig, path: &str) -> Value {
    let out = rig.path("out");
    let session = ["--session", rig.session(), "--out", text(&out), "--json"];
    let run = ["run", path, "--wait-limit", "60"];
    let run = rig.hil(&[&run[..], &session].concat());
    run.expect(0).json()
}

#[test]
fn a_rig_is_controlled_recorded_and_judged_without_a_simulated_plant() {
    let (rig, peer) = (Rig::new(), Peer::start());
    write_port(&rig, &peer.medium, "");
    let path = scenario(&rig, 3.0, REQUIREMENTS);
    let out = text(&rig.path("out")).to_owned();
    let session = ["--session", rig.session(), "--out", &out];
    let run = ["run", &path, "--wait-limit", "60"];
    let run = rig.hil(&[&run[..], &session].concat()).expect(0);
    peer.until_safe();
    let summary = std::fs::read_to_string(rig.path("out").join("summary.json"));
    let summary: Value = serde_json::from_str(&summary.expect("a summary")).expect("JSON");
    assert_eq!(summary["verdict"], "pass");
    assert_eq!(summary["plant"]["kind"], "port");
    assert_eq!(summary["evidence"], "sil", "the peer is on this machine");
    assert_eq!(summary["plant"]["simulated"], json!(["udp"]));
    assert_eq!(summary["plant_port"]["repeatable"], false);
    assert!(run.stdout.contains("plant behind a port"), "{}", run.stdout);
    // Every frame has the next counter, those of the keeper too.
    let received = peer.received();
    let counts = received
        .windows(2)
        .all(|pair| pair[1].counter == pair[0].counter.wrapping_add(1));
    assert!(counts, "{received:?}");
    for (arguments, code) in [
        (
            vec!["report", &out, "-o", text(&rig.path("report.html"))],
            0,
        ),
        (vec!["export", &out, "-o", text(&rig.path("run.csv"))], 0),
        (vec!["compare", &out, &out], 0),
        (vec!["replay", &out], 0),
        (vec!["rerun", &out], 2),
        (vec!["run", &path, "--audit"], 2),
        (vec!["run", &path, "--clock", "lockstep"], 2),
        (vec!["run", &path, "--checkpoint-at", "1"], 2),
        (vec!["run", &path, "--link", "in-process"], 2),
    ] {
        let result = rig.hil(&arguments);
        assert_eq!(result.code, Some(code), "{arguments:?}: {}", result.stderr);
        if code == 2 {
            let is_named = ["port", "real time", "realtime"]
                .iter()
                .any(|word| result.stderr.contains(word));
            assert!(is_named, "{arguments:?}: {}", result.stderr);
        }
    }
    rig.assert_nothing_left();
}

#[test]
fn a_rig_that_only_answers_is_spoken_to_with_the_safe_value() {
    let Some(python) = python("socket") else {
        return;
    };
    let rig = Rig::new();
    let own = free();
    for file in ["rig.py", "rig.port.toml", "rig.toml"] {
        let text = shipped(format!("examples/ports/{file}"));
        let port = own.rsplit(':').next().expect("a port");
        let text = text.replace(
            "\"python3\"",
            &format!("{:?}", python.display().to_string()),
        );
        rig.write(file, &text.replace("9105", port));
    }
    let summary = run(&rig, text(&rig.path("rig.toml")));
    assert_eq!(summary["verdict"], "pass");
    assert_eq!(summary["plant"]["simulated"], json!(["udp", "start"]));
    let [state, drive] = [0, 1].map(|frame| &summary["plant_port"]["frames"][frame]);
    // One safe value at least before the first command, of 100 a second.
    assert!(drive["sent"].as_u64() > Some(300), "{summary}");
    assert!(state["accepted"].as_u64() > Some(0), "{summary}");
    assert_eq!(state["refused"], 0, "{summary}");
    rig.assert_nothing_left();
}

#[test]
fn the_safe_value_is_last_on_the_wire_after_kill_9_of_the_port() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    let [plant, _] = running.children_at_once();
    send(plant.pid, Signal::KILL);
    peer.until_safe();
    without_processes(&rig);
    running.finish().expect(3);
}

#[test]
fn the_safe_value_is_last_on_the_wire_after_the_loss_of_the_controller() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    let [_, controller] = running.children_at_once();
    send(controller.pid, Signal::KILL);
    peer.until_safe();
    running.finish().expect(3);
}

#[test]
fn a_killed_keeper_ends_the_run_and_the_port_sends_the_safe_value() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    send(process_with(&rig, "keeper"), Signal::KILL);
    peer.until_safe();
    running.finish().expect(3).says(&["keeper"]);
}

#[test]
fn a_silent_peer_ends_the_run_and_gets_the_safe_value() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless_within(EXPIRES_S, &rig, &peer, "");
    peer.is_silent.store(true, Ordering::Relaxed);
    let run = running.finish().expect(3);
    run.says(&["sent no valid frame for 4.000 s", "UDP, 127.0.0.1:"]);
    peer.until_safe();
}

#[test]
fn the_safe_value_is_last_on_the_wire_after_kill_9_of_hil() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    running.children_at_once();
    running.kill();
    peer.until_safe();
    without_processes(&rig);
}

#[test]
fn a_watchdog_is_fed_and_disarmed_at_an_orderly_end_only() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let watchdog = rig.write("watchdog", "");
    let key = format!("watchdog = {:?}", text(&watchdog));
    write_port(&rig, &peer.medium, &key);
    run(&rig, &scenario(&rig, 0.5, ""));
    let content = std::fs::read(&watchdog).expect("a file");
    assert!(
        content.starts_with(&[0]) && content.ends_with(b"V"),
        "{content:?}"
    );
    std::fs::write(&watchdog, "").expect("written");

    let other = Rig::new();
    let running = endless(&other, &peer, &key);
    let [plant, _] = running.children_at_once();
    send(plant.pid, Signal::KILL);
    peer.until_safe();
    without_processes(&other);
    running.finish().expect(3);
    let content = std::fs::read(&watchdog).expect("a file");
    // Fed at the begin and with each safe frame.
    assert!(
        content.len() > REPEATS && !content.contains(&b'V'),
        "{content:?}"
    );
}

#[test]
fn a_port_without_a_safe_value_for_each_command_is_refused_as_a_plant() {
    let (rig, peer) = (Rig::new(), Peer::start());
    write_port(&rig, &peer.medium, "");
    let file = rig.path("rig.port.toml");
    let port = std::fs::read_to_string(&file).expect("text");
    let port = port.replace(&format!(", safe = {SAFE_N}"), "");
    rig.write("rig.port.toml", &port);
    let run = rig.hil(&["run", &scenario(&rig, 1.0, "")]);
    run.expect(2).says(&["command.force_n", "safe"]);
}

#[test]
fn the_port_sends_the_safe_values_if_the_keeper_hangs_at_an_orderly_end() {
    let (rig, peer) = (Rig::new(), Peer::start());
    write_port(&rig, &peer.medium, "");
    let path = scenario(&rig, 3.0, "");
    let out = rig.path("out");
    let session = ["--session", rig.session(), "--out", text(&out)];
    let line = ["run", &path, "--wait-limit", "60"];
    let running = rig.start_hil(&[&line[..], &session].concat());
    peer.until_commanded();
    send(process_with(&rig, "keeper"), Signal::STOP);
    running.finish().expect(0);
    peer.until_safe();
    without_processes(&rig);
    let log = std::fs::read_to_string(out.join("plant.log")).expect("a log");
    for part in [
        "the keeper has not ended within ",
        " s, for safe values of 0.080 s; it was killed",
        "the port has sent the safe values itself, and a watchdog stays armed",
    ] {
        assert!(log.contains(part), "{part}: {log}");
    }
    rig.assert_nothing_left();
}
