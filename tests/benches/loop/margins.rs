//! `hil margins` of the teaching plant, in one process and in two.

use std::process::Command;
use std::time::Instant;

use serde_json::{Value, json};

use crate::effort::rounds;
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;

const SCENARIO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/spring-mass.toml");
/// Phase margin in degrees of the exact discrete closed form.
const PHASE_MARGIN_DEG: f64 = 73.968_384;

/// Measures margins at 20 frequencies and those beside crossings, and prints the times.
pub(crate) fn compare(programs: &Programs) {
    let plant = programs.hil.with_file_name("plant-process");
    let plant = plant.to_str().expect("a path in UTF-8");
    let ways: [(&str, &[&str]); 2] = [
        ("one process", &[]),
        ("two processes", &["--plant-bin", plant]),
    ];
    let mut all: [(Vec<f64>, Value); 2] = Default::default();
    let bystanders = Bystanders::watch();
    for _ in 0..rounds() {
        for ((_, arguments), (times, report)) in ways.iter().zip(&mut all) {
            let mut hil = Command::new(&programs.hil);
            hil.args([
                "margins",
                SCENARIO,
                "--json",
                "--frequencies",
                "0.5..400/20",
            ]);
            let began = Instant::now();
            let output = hil.args(*arguments).output().expect("hil");
            times.push(began.elapsed().as_secs_f64());
            *report = serde_json::from_slice(&output.stdout).expect("JSON");
        }
    }
    let others = bystanders.share();
    println!(
        "margins of spring-mass.toml at 20 frequencies and those beside crossings, medians of {}, other programs took {:.0} % of the machine",
        rounds(),
        100.0 * others
    );
    let mut lines = Vec::new();
    for ((name, _), (times, report)) in ways.iter().zip(&all) {
        let input = &report["inputs"][0];
        let count = input["responses"].as_array().map_or(0, Vec::len);
        let margin_deg = input["phase_margin_deg"].as_f64().unwrap_or(f64::NAN);
        let (wall_s, error) = (
            median(times.iter().copied()),
            (margin_deg / PHASE_MARGIN_DEG - 1.0).abs(),
        );
        println!("{name:<14} {wall_s:.2} s, {count} frequencies, phase margin {error:.1e} apart");
        lines.push(json!({"way": name, "wall_s": wall_s, "frequencies": count, "error": error}));
    }
    let line = json!({
        "bench": "loop/margins",
        "machine": machine(),
        "rounds": rounds(),
        "others_share": others,
        "ways": lines,
    });
    println!("{line}\n");
}
