//! Bench `c_twin`: how much longer does a run take than an equivalent program in plain C?
//!
//! `cargo bench -p tests --bench c_twin` compiles `severe_leakage.c`, the paper's scenario with the
//! same plant, integrator, stimulus, fault and law, by the system's C compiler, at `-O3` and at
//! `-O3 -march=native`. It first makes sure that both programs compute the same thing: final state
//! and metrics agree but for the last digits of `sin` and `exp`, in which C libraries differ. Then
//! it measures in turns: the C programs, `hil run` in one process and in two, not recorded and recorded, and
//! plant, stimulus and law alone in one thread. Without a C compiler it says so and ends.

#[path = "../shared/experiment.rs"]
mod experiment;
#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/programs.rs"]
mod programs;

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};
use tempfile::TempDir;

use experiment::{Experiment, scenario_file};
use measure::{Bystanders, machine, median};
use programs::Programs;

/// Rounds; the results are medians over them.
const ROUNDS: usize = 5;

/// Largest relative difference between the results of both programs.
const ROUNDING: f64 = 1e-9;

/// Ways to compile the C program; the first is the one that counts.
const OPTIONS: [&[&str]; 2] = [&["-O3"], &["-O3", "-march=native"]];

/// Runs of `hil`; the first corresponds to the C program.
const RUNS: [(&str, &[&str]); 3] = [
    ("in one process", &["--link", "in-process", "--no-record"]),
    ("in two processes", &["--no-record"]),
    ("in two processes, recorded with lz4", &[]),
];

fn main() {
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench c_twin`");
        return;
    }
    if Command::new("cc").arg("--version").output().is_err() {
        println!("there is no C compiler `cc` here: nothing to compare with");
        return;
    }
    println!("machine: {}\n", machine());
    let folder = TempDir::new().expect("a folder");
    let twins = OPTIONS.map(|options| compiled(folder.path(), options));
    let programs = Programs::built();
    let experiment = Experiment::new("ftsc");
    assert_same(
        &run_twin(&twins[0]),
        &run_hil(&programs, RUNS[0].1),
        &experiment,
    );
    compare(&twins, &programs, &experiment);
}

/// The C program, compiled.
fn compiled(folder: &Path, options: &[&str]) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/c/severe_leakage.c");
    let program = folder.join(format!("severe_leakage{}", options.concat()));
    let status = Command::new("cc")
        .args(options)
        .arg("-std=c11")
        .arg(&source)
        .arg("-o")
        .arg(&program)
        .arg("-lm")
        .status();
    assert!(status.expect("cc").success(), "{source:?} does not compile");
    program
}

/// Runs the C program and returns what it prints.
fn run_twin(program: &Path) -> Value {
    let output = Command::new(program).output().expect("the C program");
    serde_json::from_slice(&output.stdout).expect("a line of JSON")
}

/// Returns the summary of the same scenario.
fn run_hil(programs: &Programs, arguments: &[&str]) -> Value {
    let scenario = scenario_file();
    let scenario = scenario.to_str().expect("a path in UTF-8");
    programs.run(&[&[scenario], arguments].concat())
}

/// Checks that both programs compute the same results.
///
/// # Panics
/// If they do not.
fn assert_same(twin: &Value, summary: &Value, experiment: &Experiment) {
    let mut largest = 0.0;
    let mut compare = |what: &str, c: f64, rust: f64, size: f64| {
        let off = (c - rust).abs() / size;
        assert!(off <= ROUNDING, "{what}: {c} in C, {rust} in Rust");
        if off > largest {
            largest = off;
        }
    };
    for name in ["max_abs_tracking_error_rad", "max_abs_force_fight_n"] {
        let metrics = summary["metrics"].as_array().expect("a list");
        let ours: Vec<f64> = (metrics.iter())
            .filter(|metric| metric["name"] == name)
            .map(|metric| metric["value"].as_f64().expect("a number"))
            .collect();
        let theirs = numbers(&twin[name]);
        assert_eq!(ours.len(), theirs.len(), "windows of {name}");
        for (c, rust) in theirs.into_iter().zip(ours) {
            compare(name, c, rust, rust.abs());
        }
    }
    let (_, end) = experiment.closed();
    let theirs = numbers(&twin["measured"]);
    assert_eq!(end.len(), theirs.len(), "measured signals");
    for (i, (c, rust)) in theirs.into_iter().zip(end).enumerate() {
        // The run ends where positions pass through zero: their size is that of their motion.
        let size = if rust.abs() < 1e-3 { 1e-2 } else { rust.abs() };
        compare(&format!("measured signal {i} in the end"), c, rust, size);
    }
    println!("C and Rust compute the same: largest relative difference {largest:.1e}\n");
}

fn numbers(list: &Value) -> Vec<f64> {
    let list = list.as_array().expect("a list");
    (list.iter())
        .map(|value| value.as_f64().expect("a number"))
        .collect()
}

/// Measures all variants in turns and prints them.
fn compare(twins: &[PathBuf], programs: &Programs, experiment: &Experiment) {
    let rows = experiment.rows();
    let mut done: Vec<(String, Vec<f64>)> = Vec::new();
    let mut note = |name: String, ns: f64| match done.iter_mut().find(|(n, _)| *n == name) {
        Some((_, values)) => values.push(ns),
        None => done.push((name, vec![ns])),
    };
    let mut steps = 0.0;
    let bystanders = Bystanders::watch();
    for _ in 0..ROUNDS {
        let runs = RUNS.map(|(_, arguments)| run_hil(programs, arguments));
        steps = runs[0]["steps"].as_f64().expect("a number");
        let step_ns = |run: &Value| 1e9 * run["wall_time_s"].as_f64().expect("a number") / steps;
        for (twin, options) in twins.iter().zip(OPTIONS) {
            note(format!("C {}", options.join(" ")), step_ns(&run_twin(twin)));
        }
        for ((name, _), summary) in RUNS.iter().zip(&runs) {
            note(format!("hil run {name}"), step_ns(summary));
        }
        note("all in one thread".into(), experiment.closed().0);
        note("  plant alone".into(), experiment.plant_ns(&rows));
        note("  stimulus alone".into(), experiment.stimuli_ns());
        let law = format!("  law {} alone", experiment.law_name());
        note(law, experiment.law_ns(&rows));
    }
    let others = bystanders.share();

    println!(
        "a step of severe-leakage.toml, medians of {ROUNDS} runs of {steps} steps in turns, \
         other programs took {:.0} % of the machine",
        100.0 * others
    );
    println!("{:<40} {:>8} {:>8}", "", "ns", "to C");
    let mut c_ns = None;
    let mut lines = Vec::new();
    for (name, values) in done {
        let step_ns = median(values);
        let to_c = step_ns / *c_ns.get_or_insert(step_ns);
        println!("{name:<40} {step_ns:>8.0} {to_c:>8.2}");
        lines.push(json!({ "part": name.trim(), "step_ns": step_ns, "to_c": to_c }));
    }
    let line = json!({
        "bench": "c_twin",
        "machine": machine(),
        "rounds": ROUNDS,
        "others_share": others,
        "parts": lines,
    });
    println!("{line}\n");
}
