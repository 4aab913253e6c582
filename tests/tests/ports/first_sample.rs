//! The first sample of a port: a peer may start late, be slow, or never answer.

use super::{PEER, scenario};
use crate::support::harness::Rig;

/// Law of the peers: gain, bias and number of answers.
const LAW: [&str; 3] = ["20", "0.5", "1000000"];

/// Runs the scenario with this text of the peer, which does not say when it is ready; returns the summary.
fn unannounced(rig: &Rig, out: &str, peer: &str) -> serde_json::Value {
    rig.write("peer.py", peer);
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(&path).expect("it was written");
    rig.write("bench.port.toml", &text.replace("ready = \"ready\"\n", ""));
    let run = rig.hil_in(&rig.path(""), &["run", "wire.toml", "--out", out, "--json"]);
    run.expect(0).json()
}

#[test]
fn a_peer_that_misses_the_first_sample_or_reads_it_late_gets_every_sample_once() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let plain = unannounced(&rig, "plain", PEER);
    // The network loses the first sample and says nothing.
    let lossy = PEER.replace("for _", "peer.recvfrom(4096)\nfor _");
    let lossy = unannounced(&rig, "lossy", &lossy);
    // Copies of the first sample wait for the peer, which answers each.
    let slow = PEER.replace("for _", "import time\ntime.sleep(1)\nfor _");
    let slow = unannounced(&rig, "slow", &slow);
    for summary in [&lossy, &slow] {
        assert_eq!(summary["digest"], plain["digest"]);
        let frames = &summary["port"]["frames"];
        assert!(frames[0]["resent"].as_u64() > Some(0), "{frames}");
        assert_eq!(frames[0]["sent"], 200);
        assert_eq!(frames[1]["unasked"], 0);
    }
    assert!(slow["port"]["frames"][1]["accepted"].as_u64() > Some(200));
    rig.assert_nothing_left();
}

#[test]
fn a_peer_that_is_ready_late_and_silent_is_named_before_the_plant_gives_up() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    // A third of the wait limit for the ready line, and no answer after it.
    let silent = PEER.replace("peer.sendto", "(lambda *_: None)");
    let late = "import time\ntime.sleep(1.5)\nprint(\"ready\"";
    rig.write("peer.py", &silent.replace("print(\"ready\"", late));
    let arguments = ["run", "wire.toml", "--out", "late", "--wait-limit", "5"];
    let run = rig.hil_in(&rig.path(""), &arguments);
    let run = run.expect(3).says(&[" s from UDP, 127.0.0.1:"]);
    let (_, text) = run
        .stderr
        .split_once("no frame `drive` within ")
        .expect("a limit");
    let limit_s = text
        .split(' ')
        .next()
        .and_then(|text| text.parse::<f64>().ok());
    // Both waits together take at most 80 % of the wait limit.
    assert!(
        limit_s.is_some_and(|limit_s| limit_s < 4.0 - 1.5),
        "{}",
        run.stderr
    );
    rig.assert_nothing_left();
}
