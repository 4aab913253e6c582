//! Runs with and without an observer, in turns.
//!
//! Each run is held before its first steps until the observer is there, also where there is none, so that both are
//! held alike.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::effort::rounds;
use crate::measure::{Bystanders, machine, median};

/// Time limit for a run or an observer to start.
const LIMIT: Duration = Duration::from_secs(60);

/// Runs of `hil` with or without an observer.
pub(crate) struct Comparison<'a> {
    /// Program.
    pub(crate) hil: &'a Path,
    /// Scenario and its changed settings.
    pub(crate) arguments: &'a [&'a str],
    /// Title of the table.
    pub(crate) title: &'a str,
    /// Name of the bench in its line of JSON.
    pub(crate) bench: &'a str,
}

impl Comparison<'_> {
    /// Prints what an observer changes. `watch` begins to watch the held session of a name, until what it returns
    /// is dropped.
    pub(crate) fn print<T>(&self, watch: impl Fn(&str) -> T) {
        let pairs = 3 * rounds();
        let mut summaries = [Vec::new(), Vec::new()];
        let bystanders = Bystanders::watch();
        for round in 0..pairs {
            // First the one, then the other, so that neither always has the warmer machine.
            for at in if round % 2 == 0 { [0, 1] } else { [1, 0] } {
                summaries[at].push(self.run((at == 1).then_some(&watch)));
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
            "{}, {pairs} pairs, other programs took {:.0} % of the machine",
            self.title,
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
            "bench": self.bench,
            "machine": machine(),
            "pairs": pairs,
            "others_share": others,
            "figures": lines,
        });
        println!("{line}\n");
    }

    /// Returns the summary of a run, with or without an observer.
    fn run<T>(&self, watch: Option<impl Fn(&str) -> T>) -> Value {
        let folder = TempDir::new().expect("a folder");
        let session = format!("bench-{}", std::process::id());
        let run = Command::new(self.hil)
            .args(["run", "--pause-at", "0.001", "--wait-limit", "60"])
            .args(["--json", "--session", &session, "--out"])
            .arg(folder.path().join("run"))
            .args(self.arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("hil");
        until_held(self.hil, &session);
        let observer = watch.map(|watch| watch(&session));
        let resumed = Command::new(self.hil)
            .args(["resume", "--session", &session])
            .output();
        assert!(resumed.expect("hil").status.success(), "it is held");
        let output = run.wait_with_output().expect("hil");
        drop(observer);
        serde_json::from_slice(&output.stdout).expect("a summary")
    }
}

fn until_held(hil: &Path, session: &str) {
    until("the run is held", || {
        let asked = Command::new(hil)
            .args(["inject", "--active", "--json", "--session", session])
            .output()
            .expect("hil");
        let told: Value = serde_json::from_slice(&asked.stdout).unwrap_or_default();
        told["status"]["paused"] == true
    });
}

/// Waits for something that must arrive.
pub(crate) fn until(what: &str, mut happened: impl FnMut() -> bool) {
    let since = Instant::now();
    while !happened() {
        assert!(since.elapsed() < LIMIT, "{what}: not within {LIMIT:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}
