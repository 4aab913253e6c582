//! Bench `soak`: what does a long run, and what do many runs, cost in the end?
//!
//! `cargo bench -p tests --bench soak -- [STEPS [CYCLES [SESSIONS]]]` runs the teaching plant for STEPS steps
//! (10,000,000) under faults that another terminal injects at random, and looks at the memory of all
//! three processes and at the file; then CYCLES short runs one after the other (500); then SESSIONS
//! sessions at once (16). It fails if a step is lost, a digest differs or something is left.

#[path = "../shared/measure.rs"]
#[expect(dead_code, reason = "other benches use the rest")]
mod measure;
#[path = "../shared/programs.rs"]
mod programs;
#[path = "../shared/rig.rs"]
#[expect(dead_code, reason = "other benches use the rest")]
mod rig;

use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use measure::median;
use programs::Programs;
use rig::{Running, left, scenario};

/// Time between two looks at memory and file.
const LOOK: Duration = Duration::from_millis(250);
const RATE_HZ: u32 = 10_000;

fn main() {
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench soak`");
        return;
    }
    let mut arguments = std::env::args()
        .skip(1)
        .filter(|argument| argument != "--bench");
    let mut number = |default: u64| {
        let given = arguments.next();
        given.map_or(default, |text| text.parse().expect("a number"))
    };
    let (steps, cycles, sessions) = (number(10_000_000), number(500), number(16));
    let programs = Programs::built();
    let folder = TempDir::with_prefix("hil-soak-").expect("a folder");
    let long = long_run(&programs, &folder, steps);
    let many = many_runs(&programs, &folder, cycles);
    let together = sessions_at_once(&programs, &folder, sessions);
    let left = left(&programs.hil, "kept-");
    assert!(left.is_empty(), "{left:?}");
    let all = json!({"bench": "soak", "long": long, "many": many, "together": together});
    println!("{all:#}");
}

/// Memory of a process that is in use, in KiB.
fn resident_kib(pid: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_ascii_whitespace().nth(1)?.parse().ok()
}

fn long_run(programs: &Programs, folder: &TempDir, steps: u64) -> Value {
    let path = scenario(folder.path(), RATE_HZ, steps as f64 / f64::from(RATE_HZ));
    let place = folder.path().join("long");
    let session = format!("kept-{}", std::process::id());
    let scenario = path.to_str().expect("plain text");
    let mut running = Running::start(&programs.hil, place.clone(), session.clone(), &[scenario]);
    let [plant, controller] = running.children().expect("both start");
    let pids = [plant.pid, controller.pid, running.owner()];
    let mut seen: Vec<([f64; 3], f64)> = Vec::new();
    let (mut injected, mut number) = (0_u64, 1_u64);
    while !matches!(running.hil.try_wait(), Ok(Some(_))) {
        let kib = pids.map(resident_kib);
        let bytes = std::fs::metadata(place.join("run.mcap")).map_or(0, |file| file.len());
        if let [Some(plant), Some(controller), Some(hil)] = kib {
            seen.push(([plant, controller, hil], bytes as f64));
        }
        number = number
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        injected += u64::from(inject(programs, &session, number >> 33));
        std::thread::sleep(LOOK);
    }
    let text = std::fs::read_to_string(place.join("summary.json")).expect("a summary");
    let summary: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(summary["reason"], Value::Null, "{summary:#}");
    assert_eq!(summary["recording"]["lost"], 0);
    assert_eq!(summary["recording"]["records"], steps + 1);
    // The first tenth is the start; then a third in the middle against the last.
    let tenth = seen.len() / 10;
    let third = (seen.len() - tenth) / 3;
    let part = |from: usize, of: usize| {
        let part = seen[from..from + third].iter();
        median(part.map(|(kib, _)| kib[of]))
    };
    let growth = [0, 1, 2].map(|of| {
        let (early, late) = (part(tenth, of), part(seen.len() - third, of));
        json!({"early_kib": early, "late_kib": late, "ratio": late / early})
    });
    let half = seen.len() / 2;
    let file = json!({
        "bytes": seen.last().map(|(_, bytes)| *bytes),
        "bytes_at_half_of_time": seen[half].1,
    });
    let _ = std::fs::remove_dir_all(&place);
    json!({
        "steps": steps, "faults_injected": injected, "realtime_factor": summary["realtime_factor"],
        "plant": growth[0], "controller": growth[1], "hil": growth[2], "file": file,
        "looks": seen.len(),
    })
}

/// Puts a fault of some kind and size into the run; false if it was over.
fn inject(programs: &Programs, session: &str, number: u64) -> bool {
    let size = format!("{:e}", (number % 1000) as f64 * 1e-9);
    let arguments: &[&str] = match number % 4 {
        0 => &["bias", "measured.position_m", &size],
        1 => &["noise", "measured.position_m", &size],
        2 => &["stuck", "measured.position_m"],
        _ => &["drift", "measured.position_m", &size],
    };
    let output = Command::new(&programs.hil)
        .arg("inject")
        .args(arguments)
        .args(["--duration", "0.05", "--session", session])
        .output()
        .expect("hil");
    let said = String::from_utf8_lossy(&output.stderr);
    let is_over = said.contains("is running") || said.contains("ended") || said.contains("over");
    assert!(output.status.success() || is_over, "{arguments:?}: {said}");
    output.status.success()
}

fn many_runs(programs: &Programs, folder: &TempDir, cycles: u64) -> Value {
    let path = scenario(folder.path(), 1000, 0.02);
    let scenario = path.to_str().expect("plain text");
    let mut took_ms = Vec::new();
    let mut digest = None;
    for cycle in 0..cycles {
        let place = folder.path().join(format!("cycle{cycle}"));
        let since = Instant::now();
        let summary = programs.run_in(&place, &[scenario, "--session", &format!("kept-{cycle}")]);
        took_ms.push(since.elapsed().as_secs_f64() * 1e3);
        let found = summary["digest"].clone();
        assert_eq!(*digest.get_or_insert_with(|| found.clone()), found);
        let _ = std::fs::remove_dir_all(&place);
    }
    let tenth = (took_ms.len() / 10).max(1);
    let first = median(took_ms[..tenth].iter().copied());
    let last = median(took_ms[took_ms.len() - tenth..].iter().copied());
    json!({"cycles": cycles, "first_tenth_over_last_tenth": first / last, "median_ms": median(took_ms)})
}

fn sessions_at_once(programs: &Programs, folder: &TempDir, sessions: u64) -> Value {
    let path = scenario(folder.path(), 1000, 2.0);
    let scenario = path.to_str().expect("plain text");
    let alone = programs.run(&[scenario])["digest"].clone();
    let mut all: Vec<Running> = (0..sessions)
        .map(|number| {
            let place = folder.path().join(format!("together{number}"));
            Running::start(
                &programs.hil,
                place,
                format!("kept-at-once-{number}"),
                &[scenario],
            )
        })
        .collect();
    for one in &mut all {
        let status = one.hil.wait().expect("it was started");
        assert!(status.success(), "{}", one.folder.display());
        let text = std::fs::read_to_string(one.folder.join("summary.json")).expect("a summary");
        let summary: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(summary["digest"], alone);
    }
    json!({"sessions": sessions, "same_digest": true})
}
