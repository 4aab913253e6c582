//! A controller on a CAN interface of the kernel.

use super::{PEER, scenario};
use crate::support::harness::Rig;
use crate::support::programs::skip;

/// Interface that exists only for tests.
const INTERFACE: &str = "vcan0";

/// Arguments for a guest with an emulated processor, on which a peer takes several seconds to start.
const PATIENT: &[&str] = &["--wait-limit", "60"];

/// Returns `true` if the machine has the interface of these tests.
fn has_vcan() -> bool {
    std::path::Path::new("/sys/class/net")
        .join(INTERFACE)
        .exists()
}

/// Puts the frames of the scenario on a CAN interface.
fn on_can(rig: &Rig, interface: &str) {
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(&path).expect("it was written");
    let (head, rest) = text.split_once("kind = \"udp\"").expect("a medium");
    let (_, frames) = rest.split_once("[[frames]]").expect("frames");
    let frames = (frames.replacen("carries", "id = 0x101\ncarries", 1))
        .replace("carries = \"command\"", "id = 0x102\ncarries = \"command\"");
    let medium = format!("kind = \"can\"\ninterface = \"{interface}\"\n\n");
    rig.write(
        "bench.port.toml",
        &format!("{head}{medium}[[frames]]{frames}"),
    );
}

#[test]
fn a_machine_without_the_interface_is_told_what_to_use() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    on_can(&rig, "no-can");
    let arguments = [&["run", "wire.toml", "--out", "none"], PATIENT].concat();
    let run = rig.hil_in(&rig.path(""), &arguments);
    let text = run.expect(3).stderr;
    let medium = "medium `can` (CAN interface no-can): ";
    let has_no_can = format!(
        "{medium}this kernel has no CAN; load its modules `can` and `can_raw`, or use a medium `cannelloni`"
    );
    let has_no_interface = format!("{medium}there is no such interface");
    assert!(
        text.contains(&has_no_can) || text.contains(&has_no_interface),
        "{text}"
    );
    rig.assert_nothing_left();
}

#[test]
fn a_law_on_a_can_interface_has_the_digest_of_the_one_behind_udp() {
    if !has_vcan() {
        let why = format!(
            "there is no interface {INTERFACE}; `ip link add dev {INTERFACE} type vcan` makes one"
        );
        return skip(&why, "HIL_TEST_VCAN");
    }
    let rig = Rig::new();
    let Some(()) = scenario(&rig, ["20", "0.5", "1000000"]) else {
        return;
    };
    let run = |out: &str| {
        let arguments = [&["run", "wire.toml", "--out", out, "--json"], PATIENT].concat();
        let run = rig.hil_in(&rig.path(""), &arguments);
        run.expect(0).json()
    };
    let udp = run("udp");
    let peer = PEER
        .replace(
            "socket.AF_INET, socket.SOCK_DGRAM",
            "socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW",
        )
        .replace(
            "(\"127.0.0.1\", int(sys.argv[1]))",
            &format!("(\"{INTERFACE}\",)"),
        )
        .replace("\"<d\", data)", "\"<d\", data[8:])")
        .replace(
            "peer.sendto(struct.pack(\"<d\", ",
            "peer.send(struct.pack(\"=IB3xd\", 0x102, 8, ",
        )
        .replace("), sender)", "))")
        // An error frame in front of each answer, which is counted.
        .replace(
            "    peer.send(",
            "    peer.send(struct.pack(\"=IB3x8s\", 0x20000004, 8, bytes(8)))\n    peer.send(",
        );
    rig.write("peer.py", &peer);
    on_can(&rig, INTERFACE);
    let can = run("can");
    assert_eq!(can["digest"], udp["digest"]);
    assert_eq!(can["port"]["media"][0]["error_frames"], 200);
    rig.assert_nothing_left();
}
