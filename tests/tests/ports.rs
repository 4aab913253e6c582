//! Port files as controllers: a peer in Python that was written from the book's page alone.

use std::net::UdpSocket;

use crate::support::harness::Rig;
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
controller.program = "bench.port.toml"
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
