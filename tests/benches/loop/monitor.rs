//! Costs of `hil monitor` for the run that it watches.
//!
//! Runs with and without one, in turns. Each run is held before its first steps until the monitor is
//! there, also where there is none, so that both are held alike.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::effort::rounds;
use crate::experiment::scenario_file;
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;
use crate::pseudo_terminal::open_terminal;

/// Time that a run or a monitor may take to be there.
const LIMIT: Duration = Duration::from_secs(60);

/// Prints what a monitor changes.
pub(crate) fn compare(programs: &Programs) {
    let pairs = 3 * rounds();
    let mut summaries = [Vec::new(), Vec::new()];
    let bystanders = Bystanders::watch();
    for round in 0..pairs {
        // First the one, then the other, so that neither always has the warmer machine.
        for at in if round % 2 == 0 { [0, 1] } else { [1, 0] } {
            summaries[at].push(run(&programs.hil, at == 1));
        }
    }
    let others = bystanders.share();
    let figures = |pointer: &str| {
        let of = |summaries: &[Value]| -> Vec<f64> {
            let number = |summary: &Value| summary.pointer(pointer).and_then(Value::as_f64);
            summaries.iter().filter_map(number).collect()
        };
        let (alone, watched) = (of(&summaries[0]), of(&summaries[1]));
        let ratio = median(alone.iter().zip(&watched).map(|(a, b)| b / a));
        (median(alone), median(watched), ratio)
    };
    println!(
        "severe-leakage.toml alone and with `hil monitor` in a terminal of 80 x 24, {pairs} pairs, \
         other programs took {:.0} % of the machine",
        100.0 * others
    );
    println!(
        "{:<20} {:>12} {:>12} {:>10}",
        "", "alone", "watched", "change"
    );
    let mut lines = Vec::new();
    for (name, pointer) in [
        ("round trip p50 ns", "/latency_ns/round_trip/p50"),
        ("round trip p99 ns", "/latency_ns/round_trip/p99"),
        ("wall time s", "/wall_time_s"),
    ] {
        let (alone, watched, ratio) = figures(pointer);
        let change = 100.0 * (ratio - 1.0);
        println!("{name:<20} {alone:>12.3} {watched:>12.3} {change:>+8.1} %");
        lines.push(json!({"figure": name, "alone": alone, "watched": watched, "ratio": ratio}));
    }
    let digests: Vec<&Value> = (summaries.iter().flatten())
        .map(|summary| &summary["digest"])
        .collect();
    assert!(
        digests.iter().all(|digest| *digest == digests[0]),
        "the runs differ: {digests:?}"
    );
    let line = json!({
        "bench": "loop/monitor",
        "machine": machine(),
        "pairs": pairs,
        "others_share": others,
        "figures": lines,
    });
    println!("{line}\n");
}

/// The summary of a run, perhaps watched.
fn run(hil: &Path, is_watched: bool) -> Value {
    let folder = TempDir::new().expect("a folder");
    let out = folder.path().join("run");
    let session = format!("bench-{}", std::process::id());
    let run = Command::new(hil)
        .args(["run", "--pause-at", "0.001", "--wait-limit", "60"])
        .args(["--json", "--session", &session, "--out"])
        .arg(&out)
        .arg(scenario_file())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("hil");
    until("the run is held", || {
        let asked = Command::new(hil)
            .args(["inject", "--active", "--json", "--session", &session])
            .output()
            .expect("hil");
        let told: Value = serde_json::from_slice(&asked.stdout).unwrap_or_default();
        told["status"]["paused"] == true
    });
    let monitor = is_watched.then(|| watch(hil, &session));
    let resumed = Command::new(hil)
        .args(["resume", "--session", &session])
        .output();
    assert!(resumed.expect("hil").status.success(), "it is held");
    let output = run.wait_with_output().expect("hil");
    if let Some(mut monitor) = monitor {
        monitor.kill().expect("it stays until a key");
        monitor.wait().expect("our child");
    }
    serde_json::from_slice(&output.stdout).expect("a summary")
}

/// A monitor in a terminal, once it has drawn the held run.
fn watch(hil: &Path, session: &str) -> Child {
    let (holder, line) = open_terminal(80, 24);
    let end = || Stdio::from(line.try_clone().expect("another handle"));
    let monitor = Command::new(hil)
        .args(["monitor", "--session", session])
        .env("TERM", "xterm-256color")
        .env("LC_ALL", "C.UTF-8")
        .stdin(end())
        .stdout(end())
        .stderr(end())
        .spawn()
        .expect("hil");
    let is_there = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&is_there);
    std::thread::spawn(move || {
        let mut screen = File::from(holder);
        let (mut bytes, mut seen) = ([0; 4096], Vec::new());
        // Reads on to the end: a full terminal would hold the monitor up.
        while let Ok(count @ 1..) = screen.read(&mut bytes) {
            if !told.load(Ordering::Relaxed) {
                seen.extend_from_slice(&bytes[..count]);
                let is_drawn = seen.windows(6).any(|word| word == b"PAUSED");
                told.store(is_drawn, Ordering::Relaxed);
            }
        }
    });
    until("the monitor is there", || is_there.load(Ordering::Relaxed));
    monitor
}

fn until(what: &str, mut happened: impl FnMut() -> bool) {
    let since = Instant::now();
    while !happened() {
        assert!(since.elapsed() < LIMIT, "{what}: not within {LIMIT:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}
