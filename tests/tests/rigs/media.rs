//! A rig behind each kind of medium that a test can have: the run passes, and the safe value is last after its end and
//! after `kill -9` of the port.

use rustix::process::Signal;

use super::kills::{endless, without_processes};
use super::peer::{Peer, Received, scenario, write_port};
use super::{REQUIREMENTS, run};
use crate::support::harness::{Rig, names, send};

pub(super) fn is_controlled_and_gets_the_safe_value(start: impl Fn(&Rig) -> Peer) {
    let rig = Rig::new();
    let peer = start(&rig);
    write_port(&rig, &peer.medium, "");
    let path = scenario(&rig, 2.0, REQUIREMENTS);
    let summary = run(&rig, &path);
    peer.until_safe();
    assert_eq!(summary["verdict"], "pass");
    let [state, drive] = [0, 1].map(|frame| &summary["plant_port"]["frames"][frame]);
    assert!(state["accepted"].as_u64() > Some(100), "{summary}");
    assert_eq!(state["refused"], 0, "{summary}");
    // A peer that gets no processor for 100 ms has a full queue: Linux gives a socket of datagrams ten places.
    let unsent = &summary["plant_port"]["media"][0]["unsent"];
    let [sent, unsent] = [&drive["sent"], unsent].map(|count| count.as_u64().expect("a count"));
    assert!(sent + unsent >= 200, "{summary}");
    let received = peer.received();
    let gap = |pair: &[Received]| {
        pair[1]
            .counter
            .wrapping_sub(pair[0].counter)
            .wrapping_sub(1)
    };
    let gaps: u64 = received.windows(2).map(|pair| u64::from(gap(pair))).sum();
    assert!(gaps <= unsent, "{received:?}");
    drop(peer);
    drop(rig);

    let rig = Rig::new();
    let peer = start(&rig);
    let running = endless(&rig, &peer, "");
    let [plant, _] = running.children_at_once();
    send(plant.pid, Signal::KILL);
    peer.until_safe();
    without_processes(&rig);
    running.finish().expect(3);
    let is_of_port = |name: &String| name == "rig.socket" || name.contains(".hil-");
    assert!(!names(&rig.path("")).iter().any(is_of_port));
}

#[test]
fn a_rig_behind_tcp_is_controlled_and_gets_the_safe_value() {
    is_controlled_and_gets_the_safe_value(|_| Peer::on_tcp());
}

#[test]
fn a_rig_behind_a_unix_socket_is_controlled_and_gets_the_safe_value() {
    is_controlled_and_gets_the_safe_value(|rig| Peer::on_unix(rig.path("rig.socket")));
}

#[test]
fn a_rig_with_a_socket_of_datagrams_is_controlled_and_gets_the_safe_value() {
    is_controlled_and_gets_the_safe_value(|rig| Peer::on_datagrams(&rig.path("peer.socket")));
}

#[test]
fn a_rig_behind_a_serial_line_is_controlled_and_gets_the_safe_value() {
    is_controlled_and_gets_the_safe_value(|_| Peer::on_serial());
}

#[test]
fn a_rig_behind_files_is_controlled_and_gets_the_safe_value() {
    let rig = Rig::new();
    rig.write("position_raw", "1000\n");
    rig.write("force_raw", "0\n");
    rig.write(
        "rig.port.toml",
        r#"port = 1
name = "spring-mass"
[[media]]
name = "converter"
kind = "file"
path = "position_raw"
[[media]]
name = "output"
kind = "file"
path = "force_raw"
[[frames]]
name = "position"
carries = "sample"
medium = "converter"
format = "json"
fields = [
    { signal = "measured.position_m", path = "", scale = 1e-5 },
]
[[frames]]
name = "force"
carries = "command"
medium = "output"
format = "json"
fields = [{ signal = "command.force_n", path = "", safe = -0.25 }]
"#,
    );
    let requirement =
        "[[requirements]]\nname = \"reads\"\nformula = \"always measured.position_m == 0.01\"\n";
    let path = scenario(&rig, 1.0, requirement);
    // The law needs the velocity, of which the port knows nothing.
    let text = std::fs::read_to_string(&path).expect("it was written");
    let begin = text.find("law = \"pid\"").expect("a law");
    let end = text.find("[[stimuli]]").expect("a stimulus");
    let held = format!("{}law = \"hold\"\n{requirement}", &text[..begin]);
    assert!(end > begin);
    rig.write("rig.toml", &held);
    let summary = run(&rig, &path);
    assert_eq!(summary["verdict"], "pass");
    let force = std::fs::read_to_string(rig.path("force_raw")).expect("a file");
    assert_eq!(force.trim().parse(), Ok(-0.25), "{force}");
}
