//! Kills of every process of a run in front of a rig, whose safe value an independent receiver must get.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use super::peer::{Peer, SYNC, free, scenario, write_port};
use crate::support::harness::{Rig, Running, send, text, until};
use crate::support::python::python;

/// Processes in the order in which they are killed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Victim {
    Port,
    Keeper,
    Peer,
    Controller,
    Hil,
}

const VICTIMS: [Victim; 5] = [
    Victim::Port,
    Victim::Keeper,
    Victim::Peer,
    Victim::Controller,
    Victim::Hil,
];

/// Sender of a state that stands still. The commands go to the receiver, another program at another address.
const SENDER: &str = r#"
import socket, struct, sys, time
host, port = sys.argv[1].split(":")
sender, count = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), 0
while True:
    sender.sendto(struct.pack("<BBdd", int(sys.argv[2]), count % 256, 0.0, 0.0), (host, int(port)))
    count += 1
    time.sleep(0.005)
"#;

/// Starts a run that lasts until something is lost, with a wait limit that does not expire on a loaded machine.
pub(super) fn endless<'r>(rig: &'r Rig, peer: &Peer, more: &str) -> Running<'r> {
    endless_within(60.0, rig, peer, more)
}

/// Starts such a run with a wait limit in s.
pub(super) fn endless_within<'r>(
    limit_s: f64,
    rig: &'r Rig,
    peer: &Peer,
    more: &str,
) -> Running<'r> {
    write_port(rig, &peer.medium, more);
    let path = scenario(rig, 3600.0, "");
    let out = rig.path("out");
    let session = ["--session", rig.session(), "--out", text(&out)];
    let limit = limit_s.to_string();
    let run = ["run", &path, "--wait-limit", &limit];
    let running = rig.start_hil(&[&run[..], &session].concat());
    peer.until_commanded();
    running
}

/// Returns a process of the test whose command line has this word.
pub(super) fn process_with(rig: &Rig, word: &str) -> u32 {
    let folder = rig.path("");
    let is_one = |pid: &u32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line);
        line.split('\0').any(|part| part == word) && line.contains(text(&folder))
    };
    let processes = Path::new("/proc").read_dir().expect("processes");
    let pids = processes.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    pids.into_iter()
        .find(is_one)
        .unwrap_or_else(|| panic!("no process `{word}`"))
}

/// Waits until every process of the test has ended; the keeper ends by itself after its frames.
pub(super) fn without_processes(rig: &Rig) {
    until("the end of all processes", || rig.processes().is_empty());
}

/// Kills one process of a run; returns the time until the first safe frame.
fn kill(victim: Victim, python: &Path) -> Duration {
    let (rig, mut peer) = (Rig::new(), Peer::start());
    // The receiver says nothing, so that the sender is the peer.
    peer.is_silent.store(true, Ordering::Relaxed);
    let sender = rig.write("sender.py", SENDER);
    let listen = free();
    let own = { peer.medium.lines() }
        .find_map(|line| line.strip_prefix("to = "))
        .expect("an address");
    peer.medium = format!("kind = \"udp\"\nto = {own}\nlisten = \"{listen}\"");
    let start = [text(python), text(&sender), &listen, &SYNC.to_string()];
    let running = endless(&rig, &peer, &format!("start = {start:?}"));
    let [plant, controller] = running.children_at_once();
    let pid = match victim {
        Victim::Port => plant.pid,
        Victim::Keeper => process_with(&rig, "keeper"),
        Victim::Peer => process_with(&rig, text(&sender)),
        Victim::Controller => controller.pid,
        Victim::Hil => running.pid(),
    };
    let before = Instant::now();
    if victim == Victim::Hil {
        running.kill();
        let safe = peer.until_safe();
        without_processes(&rig);
        rig.hil(&["sessions", "--clean"]).expect(0);
        rig.assert_nothing_left();
        return safe.saturating_duration_since(before);
    }
    send(pid, Signal::KILL);
    let safe = peer.until_safe();
    without_processes(&rig);
    running.finish().expect(3);
    safe.saturating_duration_since(before)
}

/// Kills processes in turn.
fn kill_in_turn(count: usize) {
    let Some(python) = python("socket") else {
        return;
    };
    let mut longest = [Duration::ZERO; VICTIMS.len()];
    for number in 0..count {
        let index = number % VICTIMS.len();
        let time = kill(VICTIMS[index], &python);
        longest[index] = longest[index].max(time);
    }
    for (victim, longest) in VICTIMS.iter().zip(longest) {
        let of = count.div_ceil(VICTIMS.len());
        println!("{victim:?}: safe value at most {longest:?} after the kill, of {of}");
    }
}

#[test]
fn the_safe_value_follows_every_kill_and_nothing_is_left() {
    let count = std::env::var("HIL_TEST_KILLS").ok();
    kill_in_turn(count.and_then(|count| count.parse().ok()).unwrap_or(5));
}

/// `.ci/run long`.
mod long {
    #[test]
    #[ignore = "long: .ci/run long"]
    fn the_safe_value_follows_two_hundred_kills() {
        super::kill_in_turn(200);
    }
}
