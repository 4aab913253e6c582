//! Bench `waiting`: what do the ways to wait cost beside other programs?
//!
//! `cargo bench -p tests --bench waiting` runs the paper's scenario in every cell with every strategy, in
//! turns, beside a bare blocking UNIX socket and a bare futex with the same work, and prints us a step;
//! `-- idle "one core"` measures the cells whose names contain one of these words.
//! A cell says which busy loops there are, whether in the session of the runs or in another, and on which
//! cores the runs are. What the machine does not allow is skipped by name.
//!
//! `hybrid` is judged against the best fixed strategy, unless that one spreads by more than 1.5 itself.
//! Each run takes about `HIL_BENCH_SECONDS` (2) with `hybrid`; `HIL_BENCH_ROUNDS` (9) of them make a median.

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
use std::process::ExitCode;

use bare::Bare;
use cell::{Cell, cells};
use measure::{Bystanders, machine, median};
use programs::Programs;
use serde_json::{Value, json};

/// The strategies; the first is judged by the others.
const STRATEGIES: [&str; 4] = ["hybrid", "spin", "yield", "sleep"];
/// `hybrid` once more, with a recording; not judged.
const RECORDED: &str = "recorded";
/// Steps of a second of the scenario.
const RATE_HZ: f64 = 10_000.0;
/// Longest expected time of a run of a slow strategy, in times that of `hybrid`.
const LONGEST: f64 = 3.0;
/// Ratio of what is judged, and of the best to itself.
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
        work: bare::Work::of(1e-6 * plain_step_us(&programs)),
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

/// Us a step of the scenario in one process and not recorded: the work without any exchange.
fn plain_step_us(programs: &Programs) -> f64 {
    let arguments = arguments(20.0);
    let mut arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    arguments.extend(["--link", "in-process", "--no-record"]);
    step_us(&programs.run(&arguments))
}

fn number(name: &str, otherwise: f64) -> f64 {
    let given = std::env::var(name).ok();
    given
        .and_then(|text| text.parse().ok())
        .unwrap_or(otherwise)
}

/// Arguments of a run of the scenario without its events, for N simulated seconds.
fn arguments(duration_s: f64) -> Vec<String> {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/severe-leakage.toml");
    let mut arguments = vec![scenario.to_string_lossy().into_owned()];
    let duration = format!("run.duration_s={duration_s:.1}");
    for set in [&duration, "faults=[]", "requirements=[]", "metrics=[]"] {
        arguments.extend(["--set".into(), set.into()]);
    }
    arguments
}

fn step_us(summary: &Value) -> f64 {
    let number = |name: &str| summary[name].as_f64().expect("a number");
    assert_eq!(summary["verdict"], "pass", "{summary}");
    1e6 * number("wall_time_s") / number("steps")
}

struct Bench {
    programs: Programs,
    rounds: usize,
    run_s: f64,
    work: bare::Work,
}

/// A way to wait in a cell, and us a step of its runs.
struct Way {
    name: String,
    /// Simulated seconds of a run, or trips.
    length: f64,
    step_us: Vec<f64>,
}

impl Way {
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
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let ran: Vec<Value> = std::thread::scope(|scope| {
            let runs = (0..cell.sessions).map(|_| scope.spawn(|| self.programs.run(&arguments)));
            let runs: Vec<_> = runs.collect();
            runs.into_iter()
                .map(|run| run.join().expect("a run"))
                .collect()
        });
        digests.extend(
            ran.iter()
                .map(|run| format!("{length_s} {}", run["digest"])),
        );
        ran.iter().map(step_us).sum::<f64>() / ran.len() as f64
    }

    fn measure(&self, cell: &Cell) {
        // Digests are compared among runs of one length.
        let mut digests = BTreeSet::new();
        let mut ways: Vec<Way> = Vec::new();
        let mut most_s = f64::INFINITY;
        for strategy in STRATEGIES.into_iter().chain([RECORDED]) {
            let probed_us = self.run(cell, strategy, 0.2, &mut digests);
            // A slow strategy gets fewer steps, so that the bench ends.
            let length_s = |run_s: f64| (run_s / (1e-6 * probed_us * RATE_HZ)).clamp(0.2, 200.0);
            if strategy == STRATEGIES[0] {
                most_s = length_s(self.run_s);
            }
            ways.push(Way {
                name: strategy.into(),
                length: if length_s(LONGEST * self.run_s) < most_s {
                    length_s(LONGEST * self.run_s)
                } else {
                    most_s
                },
                step_us: Vec::new(),
            });
        }
        let mut bare = [Bare::Socket, Bare::Futex].map(|bare| {
            let probed_us = bare.measure(self.work, 2000, cell);
            let way = Way {
                name: bare.name().into(),
                length: (1e6 * self.run_s / probed_us).clamp(2000.0, 2e6),
                step_us: Vec::new(),
            };
            (bare, way)
        });
        let bystanders = Bystanders::watch();
        for _ in 0..self.rounds {
            for way in &mut ways {
                let us = self.run(cell, &way.name, way.length, &mut digests);
                way.step_us.push(us);
            }
            for (bare, way) in &mut bare {
                let us = bare.measure(self.work, way.length as u64, cell);
                way.step_us.push(us);
            }
        }
        let lengths: BTreeSet<&str> = digests.iter().filter_map(|d| d.split(' ').next()).collect();
        assert_eq!(lengths.len(), digests.len(), "the runs differ: {digests:?}");
        report(cell, &ways, &bare.map(|(_, way)| way), bystanders.share());
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
            way.name.clone(),
            json!({ "step_us": way.median(), "spread": way.spread() }),
        )
    });
    let ways: serde_json::Map<String, Value> = ways.collect();
    println!(
        "{}\n",
        json!({ "bench": "waiting", "cell": cell.name, "ways": ways, "ratio": ratio, "verdict": verdict })
    );
}
