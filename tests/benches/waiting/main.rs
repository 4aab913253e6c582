//! Bench `waiting`: what do the wait strategies cost next to other programs?
//!
//! `cargo bench -p tests --bench waiting` runs the paper's scenario in every cell with every strategy, in
//! turns, beside a bare blocking UNIX socket and a bare futex with the same work, and where nobody else is a bare
//! ping-pong with a yield after each look, once more with the work of a recorded step, and prints us a step;
//! `-- idle "one core"` measures the cells whose names contain one of these words.
//! A cell says which busy loops there are, whether in the session of the runs or in another, and on which
//! cores the runs are. What the machine does not allow is skipped by name.
//!
//! `hybrid` is judged against the best fixed strategy, unless that one spreads by more than 1.5 itself.
//! Each run takes about `HIL_BENCH_SECONDS` (2) with `hybrid`, and is interrupted where it takes three times as long;
//! `HIL_BENCH_ROUNDS` (9) of them make a median.

mod bare;
#[path = "../shared/busy.rs"]
mod busy;
mod cell;
#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/programs.rs"]
mod programs;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{ExitCode, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use bare::Bare;
use cell::{Cell, cells};
use measure::{Bystanders, machine, median};
use programs::Programs;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use serde_json::{Value, json};
use tempfile::TempDir;

/// The strategies; the first is judged against the others.
const STRATEGIES: [&str; 4] = ["hybrid", "spin", "yield", "sleep"];
/// `hybrid` once more, with a recording; not judged.
const RECORDED: &str = "recorded";
/// A ping-pong with the work of a recorded step in one process, its recorder included, measured in the same cell.
const RECORDED_PING_PONG: &str = "ping-pong, recorded";
/// Steps per second of the scenario.
const RATE_HZ: f64 = 10_000.0;
/// Multiple of the time of `hybrid` after which a run is interrupted.
const LONGEST: f64 = 3.0;
/// Ratio of the judged strategy to the best one, and of the best one to itself.
const LIMIT: f64 = 1.5;

fn main() -> ExitCode {
    if busy::burned() || bare::answered() {
        return ExitCode::SUCCESS;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench waiting`");
        return ExitCode::SUCCESS;
    }
    let programs = Programs::built();
    let bench = Bench {
        rounds: number("HIL_BENCH_ROUNDS", 9.0) as usize,
        run_s: number("HIL_BENCH_SECONDS", 2.0),
        work: bare::Work::of(1e-6 * plain_step_us(&programs, false)),
        programs,
    };
    println!("machine: {}", machine());
    println!(
        "us a step, medians of {} (largest / smallest); work of a step: {:.2} us\n",
        bench.rounds,
        1e6 * bench.work.seconds()
    );
    let wanted: Vec<String> = (std::env::args().skip(1))
        .filter(|argument| !argument.starts_with('-'))
        .collect();
    let is_wanted = |cell: &Cell| {
        wanted.is_empty() || wanted.iter().any(|word| cell.name.contains(word.as_str()))
    };
    for cell in cells().iter().filter(|cell| is_wanted(cell)) {
        match cell.enter() {
            Ok(_within) => bench.measure(cell),
            Err(why) => println!("{:<34} skipped: {why}", cell.name),
        }
    }
    ExitCode::SUCCESS
}

/// Returns the time in us of a step of the scenario in one process: the work without any exchange.
fn plain_step_us(programs: &Programs, is_recorded: bool) -> f64 {
    let arguments = arguments(20.0);
    let mut arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    arguments.extend(["--link", "in-process"]);
    if !is_recorded {
        arguments.push("--no-record");
    }
    let summary = programs.run(&arguments);
    assert_eq!(summary["verdict"], "pass", "{summary}");
    step_us(&summary)
}

fn number(name: &str, otherwise: f64) -> f64 {
    let given = std::env::var(name).ok();
    given
        .and_then(|text| text.parse().ok())
        .unwrap_or(otherwise)
}

/// Returns the arguments of a run of the scenario without its events, for N simulated seconds.
fn arguments(duration_s: f64) -> Vec<String> {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/severe-leakage.toml");
    let mut arguments = vec![scenario.to_string_lossy().into_owned()];
    let duration = format!("run.duration_s={duration_s:.1}");
    for set in [&duration, "faults=[]", "requirements=[]", "metrics=[]"] {
        arguments.extend(["--set".into(), set.into()]);
    }
    arguments
}

/// Returns the time in us of an executed step.
fn step_us(summary: &Value) -> f64 {
    let number = |name: &str| summary[name].as_f64().expect("a number");
    1e6 * number("wall_time_s") / number("steps")
}

struct Bench {
    programs: Programs,
    rounds: usize,
    run_s: f64,
    work: bare::Work,
}

/// A wait strategy in a cell, with the times in us of a step in its runs.
struct Way {
    name: &'static str,
    step_us: Vec<f64>,
}

impl Way {
    const fn new(name: &'static str) -> Self {
        let step_us = Vec::new();
        Self { name, step_us }
    }

    fn spread(&self) -> f64 {
        let mut sorted = self.step_us.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() - 1] / sorted[0]
    }

    fn median(&self) -> f64 {
        median(self.step_us.iter().copied())
    }
}

impl Bench {
    /// Runs a strategy for N simulated seconds, in as many sessions at once as the cell says.
    fn run(
        &self,
        cell: &Cell,
        strategy: &str,
        length_s: f64,
        digests: &mut BTreeSet<String>,
    ) -> f64 {
        let mut arguments = arguments(length_s);
        let wait = match strategy {
            RECORDED => STRATEGIES[0],
            strategy => {
                arguments.push("--no-record".into());
                strategy
            }
        };
        arguments.extend(["--wait".into(), wait.into()]);
        if cell.priority > 0 {
            arguments.extend(["--priority".into(), cell.priority.to_string()]);
        }
        let ran: Vec<Value> = std::thread::scope(|scope| {
            let runs = (0..cell.sessions).map(|_| scope.spawn(|| self.run_once(&arguments)));
            let runs: Vec<_> = runs.collect();
            runs.into_iter()
                .map(|run| run.join().expect("a run"))
                .collect()
        });
        for run in ran.iter().filter(|run| run["verdict"] == "pass") {
            digests.insert(run["digest"].to_string());
        }
        ran.iter().map(step_us).sum::<f64>() / ran.len() as f64
    }

    /// Returns the summary of a completed run, or of its part until it exceeded the time limit.
    fn run_once(&self, arguments: &[String]) -> Value {
        let folder = TempDir::new().expect("a folder");
        let hil = (self.programs)
            .command(&folder.path().join("run"), arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("hil");
        let process = pidfd_open(Pid::from_child(&hil), PidfdFlags::empty()).expect("a child");
        let longest = Duration::from_secs_f64(LONGEST * self.run_s);
        let (running, ended) = channel::<()>();
        let (output, interrupted) = std::thread::scope(|scope| {
            let watch = scope.spawn(move || {
                let is_late = ended.recv_timeout(longest) == Err(RecvTimeoutError::Timeout);
                is_late && pidfd_send_signal(process, Signal::INT).is_ok()
            });
            let output = hil.wait_with_output().expect("hil");
            drop(running);
            (output, watch.join().expect("a watch"))
        });
        let summary: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| {
            panic!("{arguments:?}: {}", String::from_utf8_lossy(&output.stderr))
        });
        let verdict = &summary["verdict"];
        assert!(
            verdict == "pass" || interrupted && verdict == "aborted",
            "{summary}"
        );
        summary
    }

    fn measure(&self, cell: &Cell) {
        let probed_us = self.run(cell, STRATEGIES[0], 0.2, &mut BTreeSet::new());
        let length_s = (self.run_s / (1e-6 * probed_us * RATE_HZ)).clamp(0.2, 200.0);
        let mut ways: Vec<Way> = STRATEGIES
            .into_iter()
            .chain([RECORDED])
            .map(Way::new)
            .collect();
        let plain = |bare: Bare| (bare, self.work, bare.name());
        let mut bare = [Bare::Socket, Bare::Futex].map(plain).to_vec();
        // Beside others each yield would take a time slice.
        if cell.is_alone() {
            bare.push(plain(Bare::PingPong));
            let recorded = bare::Work::of(1e-6 * plain_step_us(&self.programs, true));
            bare.push((Bare::PingPong, recorded, RECORDED_PING_PONG));
        }
        let mut bare: Vec<(Bare, bare::Work, u64, Way)> = (bare.into_iter())
            .map(|(bare, work, name)| {
                let probed_us = bare.measure(work, 2000, cell);
                let trips = (1e6 * self.run_s / probed_us).clamp(2000.0, 2e6) as u64;
                (bare, work, trips, Way::new(name))
            })
            .collect();
        let mut digests = BTreeSet::new();
        let bystanders = Bystanders::watch();
        for _ in 0..self.rounds {
            for way in &mut ways {
                let us = self.run(cell, way.name, length_s, &mut digests);
                way.step_us.push(us);
            }
            for (bare, work, trips, way) in &mut bare {
                way.step_us.push(bare.measure(*work, *trips, cell));
            }
        }
        assert!(digests.len() <= 1, "the runs differ: {digests:?}");
        let bare: Vec<Way> = bare.into_iter().map(|(.., way)| way).collect();
        report(cell, &ways, &bare, bystanders.share());
    }
}

fn report(cell: &Cell, ways: &[Way], bare: &[Way], others: f64) {
    let hybrid = &ways[0];
    let best = ways[1..STRATEGIES.len()]
        .iter()
        .min_by(|a, b| a.median().total_cmp(&b.median()));
    let best = best.expect("fixed strategies");
    let ratio = hybrid.median() / best.median();
    let verdict = match ratio <= LIMIT {
        _ if best.spread() > LIMIT => "not judged",
        true => "ok",
        false => "OVER",
    };
    let shown = ways
        .iter()
        .chain(bare)
        .map(|way| format!("{} {:.2} ({:.1})", way.name, way.median(), way.spread()));
    println!(
        "{:<34} {}\n{:<34} hybrid / {}: {ratio:.2}, {verdict}; hybrid / socket: {:.2}; others took {:.0} %",
        cell.name,
        shown.collect::<Vec<_>>().join("  "),
        "",
        best.name,
        hybrid.median() / bare[0].median(),
        100.0 * others
    );
    let ways = ways.iter().chain(bare).map(|way| {
        (
            way.name.to_owned(),
            json!({ "step_us": way.median(), "spread": way.spread() }),
        )
    });
    let ways: serde_json::Map<String, Value> = ways.collect();
    println!(
        "{}\n",
        json!({ "bench": "waiting", "cell": cell.name, "ways": ways, "ratio": ratio, "verdict": verdict })
    );
}
