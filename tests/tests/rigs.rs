//! A rig behind UDP as the plant of a run: an independent peer with a spring and a mass in real time, a controller of
//! ours, requirements on measured signals, and the safe values after every kind of end.

use std::collections::BTreeSet;
use std::net::UdpSocket;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::support::harness::{Rig, Running, send, text, until};

/// Safe force in N, which no controller of these tests commands.
const SAFE_N: f64 = -0.25;
/// Number of times that the safe frame is sent.
const REPEATS: usize = 5;
/// First byte of every frame.
const SYNC: u8 = 0xA5;

/// Rig of the tests: its frames are packed and unpacked from the page, by nothing of ours.
struct Peer {
    ends: Arc<AtomicBool>,
    is_silent: Arc<AtomicBool>,
    /// Counter and force of each received frame.
    commands: Arc<Mutex<Vec<(u8, f64)>>>,
    thread: Option<JoinHandle<()>>,
    /// Own address.
    own: String,
    /// Address of the port.
    port: String,
}

impl Peer {
    fn start() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let own = socket.local_addr().expect("an address").to_string();
        let free = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let port = free.local_addr().expect("an address").to_string();
        drop(free);
        let [ends, is_silent] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let commands = Arc::default();
        let peer = (
            Arc::clone(&ends),
            Arc::clone(&is_silent),
            Arc::clone(&commands),
        );
        let to = port.clone();
        let thread = std::thread::spawn(move || swing(&socket, &to, &peer.0, &peer.1, &peer.2));
        Self {
            ends,
            is_silent,
            commands,
            thread: Some(thread),
            own,
            port,
        }
    }

    fn commands(&self) -> Vec<(u8, f64)> {
        self.commands.lock().expect("a list").clone()
    }

    /// Returns the number of safe frames since the last other one.
    fn safe_frames(&self) -> usize {
        let commands = self.commands();
        let is_safe = |(_, force): &&(u8, f64)| *force == SAFE_N;
        commands.iter().rev().take_while(is_safe).count()
    }

    /// Waits for a command of the controller.
    fn until_commanded(&self) {
        until("a command", || {
            let commands = self.commands();
            commands.iter().any(|(_, force)| *force != SAFE_N)
        });
    }

    fn until_safe(&self) {
        until("safe frames", || self.safe_frames() >= REPEATS);
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Integrates `x'' = F - 2 x' - 100 x` in real time with steps of 1 ms, and sends the state every 5 ms.
fn swing(
    socket: &UdpSocket,
    port: &str,
    ends: &AtomicBool,
    is_silent: &AtomicBool,
    commands: &Mutex<Vec<(u8, f64)>>,
) {
    let wait = Some(Duration::from_millis(1));
    socket.set_read_timeout(wait).expect("a limit");
    let (mut x_m, mut v_mps, mut force_n) = (0.0, 0.0, 0.0);
    let (begin, mut done_ms, mut counter) = (Instant::now(), 0, 0u8);
    while !ends.load(Ordering::Relaxed) {
        let mut frame = [0; 64];
        // A refused connection of an earlier send is an error here, and nothing to end for.
        if let Ok((10, _)) = socket.recv_from(&mut frame) {
            assert_eq!(frame[0], SYNC);
            force_n = f64::from_le_bytes(frame[2..10].try_into().expect("8 bytes"));
            commands.lock().expect("a list").push((frame[1], force_n));
        }
        let now_ms = begin.elapsed().as_millis();
        while done_ms < now_ms {
            v_mps += 1e-3 * (force_n - 2.0 * v_mps - 100.0 * x_m);
            x_m += 1e-3 * v_mps;
            done_ms += 1;
            if done_ms % 5 == 0 && done_ms + 5 > now_ms && !is_silent.load(Ordering::Relaxed) {
                let mut state = vec![SYNC, counter];
                state.extend(f64::to_le_bytes(x_m));
                state.extend(f64::to_le_bytes(v_mps));
                counter = counter.wrapping_add(1);
                let _ = socket.send_to(&state, port);
            }
        }
    }
}

fn write_port(rig: &Rig, peer: &Peer, more: &str) {
    let (own, port) = (&peer.own, &peer.port);
    let port_file = format!(
        r#"port = 1
name = "spring-mass"
{more}

[[media]]
kind = "udp"
to = "{own}"
listen = "{port}"

[[frames]]
name = "state"
carries = "sample"
stale_s = 0.5
fields = [
    {{ kind = "constant", type = "u8", value = {SYNC} }},
    {{ kind = "counter", type = "u8", max_jump = 250 }},
    {{ signal = "measured.position_m", type = "f64" }},
    {{ signal = "measured.velocity_mps", type = "f64" }},
]

[[frames]]
name = "drive"
carries = "command"
fields = [
    {{ kind = "constant", type = "u8", value = {SYNC} }},
    {{ kind = "counter", type = "u8" }},
    {{ signal = "command.force_n", type = "f64", safe = {SAFE_N} }},
]
"#
    );
    rig.write("rig.port.toml", &port_file);
}

/// Writes a scenario of the port, and returns its path. The section of the controller is that of an emulated plant.
fn scenario(rig: &Rig, duration_s: f64, more: &str) -> String {
    let scenario = format!(
        r#"schema = 1
name = "rig"
[run]
duration_s = {duration_s:?}
rate_hz = 100
clock = "realtime"
[plant]
model = "spring-mass"
program = "rig.port.toml"
[plant.limits]
position_m = [-1.0, 1.0]
[controller]
law = "pid"
[controller.pid]
proportional_n_per_m = 40.0
integral_n_per_m_s = 200.0
derivative_n_s_per_m = 2.0
[[stimuli]]
target = "position_m"
kind = "step"
at_s = 0.1
after = 0.01
{more}"#
    );
    text(&rig.write("rig.toml", &scenario)).to_owned()
}

const REQUIREMENTS: &str = r#"
[[requirements]]
name = "arrives"
formula = "eventually measured.position_m > 0.008"
[[metrics]]
name = "largest_m"
expression = "max(measured.position_m)"
"#;

#[test]
fn a_rig_is_controlled_recorded_and_judged_without_a_simulated_plant() {
    let (rig, peer) = (Rig::new(), Peer::start());
    write_port(&rig, &peer, "");
    let path = scenario(&rig, 3.0, REQUIREMENTS);
    let run = rig.start_hil(&[
        "run",
        &path,
        "--session",
        rig.session(),
        "--out",
        text(&rig.path("out")),
    ]);
    let run = run.finish().expect(0);
    peer.until_safe();
    let folder = rig.path("out");
    let summary = std::fs::read_to_string(folder.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(summary["verdict"], "pass");
    assert_eq!(summary["plant"]["kind"], "port");
    assert_eq!(summary["evidence"], "sil", "the peer is on this machine");
    assert_eq!(summary["plant"]["simulated"], serde_json::json!(["udp"]));
    assert!(run.stdout.contains("plant behind a port"), "{}", run.stdout);
    // Every frame has the next counter, those of the keeper too.
    let commands = peer.commands();
    let counts = commands
        .windows(2)
        .all(|pair| pair[1].0 == pair[0].0.wrapping_add(1));
    assert!(counts, "{commands:?}");
    let out = text(&folder).to_owned();
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

/// Starts a run that lasts until something is lost.
fn endless<'r>(rig: &'r Rig, peer: &Peer, more: &str) -> Running<'r> {
    write_port(rig, peer, more);
    let path = scenario(rig, 3600.0, "");
    let running = rig.start(&path);
    peer.until_commanded();
    running
}

/// Returns the keeper of a test's port.
fn keeper(rig: &Rig) -> u32 {
    let file = rig.path("rig.port.toml");
    let is_keeper = |pid: &u32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let words: BTreeSet<&[u8]> = line.split(|byte| *byte == 0).collect();
        words.contains(b"keeper".as_slice()) && words.contains(text(&file).as_bytes())
    };
    let processes = Path::new("/proc").read_dir().expect("processes");
    let pids = processes.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    pids.into_iter().find(is_keeper).expect("a keeper")
}

/// Waits for the end of the keeper, which ends by itself after its frames.
fn without_keeper(rig: &Rig) {
    let is_keeper = |line: &String| line.contains(" keeper ");
    until("the end of the keeper", || {
        !rig.processes().iter().any(is_keeper)
    });
}

fn kill_port() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    let [plant, _] = running.children_at_once();
    send(plant.pid, Signal::KILL);
    peer.until_safe();
    without_keeper(&rig);
    running.finish().expect(3);
}

fn kill_controller() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    let [_, controller] = running.children_at_once();
    send(controller.pid, Signal::KILL);
    peer.until_safe();
    running.finish().expect(3);
}

fn kill_keeper() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    send(keeper(&rig), Signal::KILL);
    peer.until_safe();
    running.finish().expect(3).says(&["keeper"]);
}

fn silence_peer() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    peer.is_silent.store(true, Ordering::Relaxed);
    running
        .finish()
        .expect(3)
        .says(&["no valid frame", &peer.own]);
    peer.until_safe();
}

fn kill_hil() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let running = endless(&rig, &peer, "");
    running.children_at_once();
    running.kill();
    peer.until_safe();
    without_keeper(&rig);
}

#[test]
fn the_safe_value_is_last_on_the_wire_after_kill_9_of_the_port() {
    kill_port();
}

#[test]
fn the_safe_value_is_last_on_the_wire_after_the_loss_of_the_controller() {
    kill_controller();
}

#[test]
fn a_killed_keeper_ends_the_run_and_the_port_sends_the_safe_value() {
    kill_keeper();
}

#[test]
fn a_silent_peer_ends_the_run_and_gets_the_safe_value() {
    silence_peer();
}

#[test]
fn the_safe_value_is_last_on_the_wire_after_kill_9_of_hil() {
    kill_hil();
}

#[test]
#[ignore = "long: .ci/run long"]
fn two_hundred_kills_leave_the_safe_value_on_the_wire_and_nothing_else() {
    for _ in 0..40 {
        kill_port();
        kill_keeper();
        silence_peer();
        kill_controller();
        kill_hil();
    }
}

#[test]
fn a_watchdog_is_fed_and_disarmed_at_an_orderly_end_only() {
    let (rig, peer) = (Rig::new(), Peer::start());
    let watchdog = rig.write("watchdog", "");
    let key = format!("watchdog = {:?}", text(&watchdog));
    write_port(&rig, &peer, &key);
    rig.run(&scenario(&rig, 0.5, "")).expect(0);
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
    without_keeper(&other);
    running.finish().expect(3);
    let content = std::fs::read(&watchdog).expect("a file");
    assert!(
        content.starts_with(&[0]) && !content.contains(&b'V'),
        "{content:?}"
    );
}

#[test]
fn a_port_without_a_safe_value_for_each_command_is_refused_as_a_plant() {
    let (rig, peer) = (Rig::new(), Peer::start());
    write_port(&rig, &peer, "");
    let file = rig.path("rig.port.toml");
    let port = std::fs::read_to_string(&file).expect("text");
    rig.write(
        "rig.port.toml",
        &port.replace(&format!(", safe = {SAFE_N}"), ""),
    );
    let run = rig.run(&scenario(&rig, 1.0, ""));
    run.expect(2).says(&["command.force_n", "safe"]);
}
