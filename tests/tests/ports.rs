//! Port files as controllers: a peer in Python that was written from the book's page alone.

mod campaigns;
mod can;
mod first_sample;
mod senders;
mod serial;

use std::net::UdpSocket;

use crate::support::harness::{EXPIRES_S, Rig};
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
    let limit = EXPIRES_S.to_string();
    let arguments = [
        "run",
        "wire.toml",
        "--out",
        "silent",
        "--wait-limit",
        &limit,
    ];
    let run = rig.hil_in(&rig.path(""), &arguments);
    run.expect(3)
        .says(&["no frame `drive` within ", " s from UDP, 127.0.0.1:"]);
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

#[test]
fn a_peer_that_starts_again_and_counts_from_0_costs_one_command() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    let counted =
        "fields = [{ kind = \"counter\", type = \"u8\", max_jump = 3 }, { signal = \"command";
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(path).expect("it was written");
    rig.write(
        "bench.port.toml",
        &text.replace("fields = [{ signal = \"command", counted),
    );
    let peer = PEER.replace(
        "pack(\"<d\", bias",
        "pack(\"<Bd\", _ % 256 if _ < 100 else _ - 100, bias",
    );
    rig.write("peer.py", &peer);
    let arguments = ["run", "wire.toml", "--out", "again", "--json"];
    let summary = rig.hil_in(&rig.path(""), &arguments).expect(0).json();
    let drive = &summary["port"]["frames"][1];
    assert_eq!(drive["accepted"], 199);
    assert_eq!(drive["refused"], 1);
    assert_eq!(summary["held_commands"][0]["steps"], 1);
    let log = std::fs::read_to_string(rig.path("again").join("controller.log")).expect("a log");
    let part = "the counter `counter` of frame `drive` jumps to 0 instead of 100; bytes: 00 ";
    assert_eq!(log.matches(part).count(), 1, "{log}");
}

#[test]
fn frames_of_another_byte_order_are_named_in_the_error_that_they_lead_to() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(path).expect("it was written");
    let constant = "fields = [{ kind = \"constant\", name = \"sync\", type = \"u16\", value = 0x55AA }, { signal = \"command";
    let text = text.replace("fields = [{ signal = \"command", constant);
    // The position, 0.02 m, is beyond a range that ends at 0.01 m.
    let narrow = "measured.position_m\", range = [-0.01, 0.01]";
    rig.write(
        "bench.port.toml",
        &text.replace("measured.position_m\"", narrow),
    );
    let scenario = rig.path("wire.toml");
    let text = std::fs::read_to_string(scenario).expect("it was written");
    rig.write(
        "wire.toml",
        &format!("{text}plant.parameters.initial_position_m = 0.02\n"),
    );
    let swapped = PEER.replace("pack(\"<d\", bias", "pack(\">Hd\", 0x55AA, bias");
    rig.write("peer.py", &swapped);
    let limit = EXPIRES_S.to_string();
    let arguments = [
        "run",
        "wire.toml",
        "--out",
        "swapped",
        "--wait-limit",
        &limit,
    ];
    rig.hil_in(&rig.path(""), &arguments).expect(3).says(&[
        "the constant `sync` of frame `drive` is 0xaa55 and not 0x55aa, in the other byte order; bytes: 55 aa ",
        "no frame `drive` within ",
        "; arrived so far: 1 refused",
        "frame `motion`: `measured.position_m` is beyond -0.01 to 0.01 and sent as the limit; bytes: 7b 14 ae 47 e1 7a 84 3f ",
    ]);
}
