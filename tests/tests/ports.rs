//! Port files as controllers: a peer in Python that was written from the book's page alone.

mod campaigns;
mod can;
mod first_sample;
mod serial;

use std::net::UdpSocket;

use crate::support::harness::Rig;
use crate::support::programs::shipped;
use crate::support::python::python;

/// Peer that answers each sample with a force of its law.
const PEER: &str = r#"
import socket, struct, sys
gain, bias, answers = float(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
peer.bind(("127.0.0.1", int(sys.argv[1])))
print("ready", flush=True)
for _ in range(answers):
    data, sender = peer.recvfrom(4096)
    (position_m,) = struct.unpack("<d", data)
    peer.sendto(struct.pack("<d", bias - gain * position_m), sender)
sys.exit(7)
"#;

/// Writes a port with its peer and a scenario that the peer controls for 0.2 s; `None` without Python.
fn scenario(rig: &Rig, law: [&str; 3]) -> Option<()> {
    let python = python("socket")?;
    let free = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let port = free.local_addr().expect("an address").port();
    rig.write("peer.py", PEER);
    let mut start = vec![python.display().to_string(), "peer.py".into()];
    start.push(port.to_string());
    start.extend(law.map(str::to_owned));
    let text = format!(
        r#"
port = 1
name = "bench"
start = {start:?}
ready = "ready"

[[media]]
kind = "udp"
to = "127.0.0.1:{port}"

[[frames]]
name = "motion"
carries = "sample"
fields = [{{ signal = "measured.position_m", type = "f64" }}]

[[frames]]
name = "drive"
carries = "command"
fields = [{{ signal = "command.force_n", type = "f64" }}]
"#
    );
    rig.write("bench.port.toml", &text);
    let text = r#"
schema = 1
name = "behind-a-wire"
run = { duration_s = 0.2, rate_hz = 1000 }
plant.model = "spring-mass"
controller = { law = "bench", program = "bench.port.toml" }
"#;
    rig.write("wire.toml", text);
    Some(())
}

#[test]
fn a_peer_that_sends_nothing_but_zeros_has_the_digest_of_hold() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["0", "0", "1000000"]) else {
        return;
    };
    let run = rig.hil_in(&rig.path(""), &["run", "wire.toml", "--out", "wire"]);
    run.expect(0);
    rig.scenario(0.2, "spring-mass", "hold");
    let run = rig.hil_in(&rig.path(""), &["run", "scenario.toml", "--out", "hold"]);
    run.expect(0);
    rig.hil_in(&rig.path(""), &["compare", "wire", "hold"])
        .expect(0);
}

#[test]
fn a_pid_loop_behind_a_wire_has_the_digest_of_the_built_in_one() {
    let rig = Rig::new();
    if python("socket").is_none() {
        return;
    }
    let free = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let port = free.local_addr().expect("an address").port().to_string();
    drop(free);
    for file in ["pid.py", "pid.port.toml", "wired.toml"] {
        let text = shipped(format!("examples/ports/{file}"));
        rig.write(file, &text.replace("9103", &port));
    }
    rig.write("own.toml", &shipped("scenarios/spring-mass.toml"));
    for name in ["own", "wired"] {
        let scenario = format!("{name}.toml");
        let arguments = ["run", &scenario, "--out", name];
        rig.hil_in(&rig.path(""), &arguments).expect(0);
    }
    let of = |name: &str| {
        let path = rig.path(name).join("summary.json");
        let text = std::fs::read_to_string(path).expect("a summary");
        serde_json::from_str::<serde_json::Value>(&text).expect("JSON")
    };
    let (own, wired) = (of("own"), of("wired"));
    assert_eq!(own["digest"], wired["digest"]);
    assert_eq!(wired["port"]["repeatable"], true);
    let [sample, force] = [0, 1].map(|frame| &wired["port"]["frames"][frame]);
    assert_eq!(sample["sent"], 5000);
    assert_eq!(force["accepted"], 5000);
    for count in ["repeated", "refused", "lost", "refused_fields", "unasked"] {
        assert_eq!(force[count], 0, "{count}");
    }
    rig.assert_nothing_left();
}

#[test]
fn frames_that_are_refused_are_printed_with_their_bytes_and_counted() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    // Before each answer one frame is too short and one too long; the answer of step 100 is NaN.
    let bad = "for bad in (b'abc', bytes(9)):\n        peer.sendto(bad, sender)\n    peer.sendto(struct.pack";
    let peer = PEER.replace("peer.sendto(struct.pack", bad);
    let nan = "float('nan') if _ == 100 else bias - gain * position_m";
    rig.write("peer.py", &peer.replace("bias - gain * position_m", nan));
    let run = rig.hil_in(
        &rig.path(""),
        &["run", "wire.toml", "--out", "bad", "--json"],
    );
    let summary = run.expect(0).json();
    let [_, drive] = [0, 1].map(|frame| &summary["port"]["frames"][frame]);
    assert_eq!(drive["refused"], 400);
    assert_eq!(drive["accepted"], 200);
    assert_eq!(drive["refused_fields"], 1);
    assert_eq!(summary["held_commands"][0]["steps"], 1);
    let log = std::fs::read_to_string(rig.path("bad").join("controller.log")).expect("a log");
    for part in [
        "frame `drive` has 3 bytes and needs 8; bytes: 61 62 63",
        "frame `drive` has 9 bytes, more than its 8; bytes: 00 00 00 00 00 00 00 00 00",
        "field `force_n` of frame `drive` is NaN or infinite; bytes: 00 00 00 00 00 00 f8 7f",
    ] {
        assert_eq!(log.matches(part).count(), 1, "{part}: {log}");
    }
}

#[test]
fn a_silent_peer_is_named_before_the_plant_gives_up() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    let silent = PEER.replace("peer.sendto", "(lambda *_: None)");
    rig.write("peer.py", &silent);
    let arguments = ["run", "wire.toml", "--out", "silent", "--wait-limit", "1"];
    let run = rig.hil_in(&rig.path(""), &arguments);
    run.expect(3)
        .says(&["no frame `drive` within 0.", " s from UDP, 127.0.0.1:"]);
    rig.assert_nothing_left();
}

#[test]
fn a_port_with_a_clock_of_its_own_is_not_audited() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(&path).expect("it was written");
    let text = text.replace("name = \"bench\"", "name = \"bench\"\nrepeatable = false");
    rig.write("bench.port.toml", &text);
    let run = rig.hil_in(&rig.path(""), &["run", "wire.toml", "--audit"]);
    run.expect(2)
        .says(&["equal runs differ and there is nothing to audit"]);
}

#[test]
fn a_law_behind_udp_is_repeated_bit_by_bit() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    for out in ["first", "second"] {
        let run = rig.hil_in(&rig.path(""), &["run", "wire.toml", "--out", out]);
        run.expect(0);
    }
    rig.hil_in(&rig.path(""), &["compare", "first", "second"])
        .expect(0);
    rig.assert_nothing_left();
}

#[test]
fn a_peer_that_ends_is_named_with_its_exit_status_and_the_awaited_frame() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "50"]) else {
        return;
    };
    let run = rig.hil_in(&rig.path(""), &["run", "wire.toml", "--out", "ended"]);
    run.expect(3)
        .says(&["exit status: 7", "while frame `drive` was awaited"]);
    rig.assert_nothing_left();
}
