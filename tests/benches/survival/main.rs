//! Bench `survival`: which law survives which fault?
//!
//! `cargo bench -p tests --bench survival` runs the paper's severe leakage for each law with one more
//! fault of each kind from 10 s on and prints the table of `docs/survival.md`: the largest tracking
//! error from then to the end, or when the plant left its range of validity.

#[path = "../../shared/every_fault.rs"]
mod every_fault;
#[path = "../shared/programs.rs"]
mod programs;

use std::path::Path;

use serde_json::Value;

use every_fault::{LAWS, faults, with_fault};
use programs::Programs;

/// Time at which the other fault begins, in s.
const BEGIN_S: f64 = 10.0;

fn main() {
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench survival`");
        return;
    }
    let programs = Programs::built();
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scenario = tests.join("../scenarios/severe-leakage.toml");
    let scenario = std::fs::read_to_string(scenario).expect("the scenario");
    println!("| fault | {} |", LAWS.join(" | "));
    println!("|---{}|", "|---".repeat(LAWS.len()));
    print_row(&programs, "none", &measured(&scenario));
    for fault in faults() {
        let text = measured(&with_fault(&scenario, &fault, BEGIN_S));
        print_row(&programs, &fault.kind, &text);
    }
}

/// The scenario with the metric of the table.
fn measured(scenario: &str) -> String {
    format!(
        "{scenario}\n[[metrics]]\nname = \"error_rad\"\nexpression = \"max_abs(tracking_error_rad)\"\nwindows_s = [[{BEGIN_S}, 20]]\n"
    )
}

fn print_row(programs: &Programs, name: &str, scenario: &str) {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("faulted.toml");
    std::fs::write(&path, scenario).expect("the folder can be written");
    let path = path.to_str().expect("plain text");
    let cells = LAWS.map(|law| {
        let law = format!("controller.law={law}");
        cell(&programs.run(&[path, "--no-record", "--set", &law]))
    });
    println!("| {name} | {} |", cells.join(" | "));
}

/// Describes what became of a run.
fn cell(summary: &Value) -> String {
    let time_s = summary["sim_time_s"].as_f64().expect("a number");
    match summary["verdict"].as_str() {
        Some("pass" | "fail") => {
            let metrics = summary["metrics"].as_array().expect("a list");
            let error = metrics.iter().find(|metric| metric["name"] == "error_rad");
            let error_rad = error.and_then(|metric| metric["value"].as_f64());
            format!("{:.3} mrad", 1e3 * error_rad.expect("a number"))
        }
        _ => {
            let reason = summary["reason"].as_str().unwrap_or_default();
            assert!(reason.contains("diverged"), "{reason}");
            format!("diverged after {:.4} s", time_s - BEGIN_S)
        }
    }
}
