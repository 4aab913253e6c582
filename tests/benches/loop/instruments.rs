//! Costs of instruments: eight sensors of all stages, and what a run without any costs since there are instruments.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::experiment::scenario_file;
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;

/// Sensors.
const SENSORS: usize = 8;
/// Most that they may cost in a step.
const MOST_NS: f64 = 700.0;
/// Program of a commit before there were instruments, to compare with.
const BEFORE: &str = "HIL_BENCH_BEFORE";

/// All keys of a sensor, none of which moves the plant from where it is.
const KEYS: &str = "scale = 1.0
bias = 1e-12
bias_sigma = 1e-12
bias_tau_s = 100
bias_walk = 1e-12
noise_density = 1e-12
lag_hz = 2000
lag_damping = 0.7
noise_sigma = 1e-12
rate_hz = 5000
phase_steps = 1
delay_s = 0.0002
bits = 24
range = [-1e9, 1e9]
";

/// Prints both comparisons.
pub(crate) fn compare(programs: &Programs) {
    let folder = tempfile::TempDir::new().expect("a folder");
    let bare = scenario_file();
    let text = std::fs::read_to_string(&bare).expect("the scenario");
    let instruments = folder.path().join("instruments.toml");
    std::fs::write(&instruments, text + &sensors()).expect("the folder can be written");
    let pairs = if std::env::var_os("HIL_BENCH_QUICK").is_some() {
        1
    } else {
        20
    };
    let step = |programs: &Programs, file: &Path| {
        let file = file.to_str().expect("plain text");
        let arguments = [
            "--link",
            "in-process",
            "--no-record",
            "--set",
            "controller.law=hold",
        ];
        step_ns(&programs.run(&[&[file], &arguments[..]].concat()))
    };
    let bystanders = Bystanders::watch();
    let costs: Vec<[f64; 2]> = (0..pairs)
        .map(|_| [step(programs, &bare), step(programs, &instruments)])
        .collect();
    let [none_ns, all_ns] = [0, 1].map(|at| median(costs.iter().map(|pair| pair[at])));
    let more_ns = median(costs.iter().map(|[none, all]| all - none));
    println!(
        "{SENSORS} sensors of all stages in one process, medians of {pairs} pairs, other programs took {:.0} % of the machine",
        100.0 * bystanders.share()
    );
    println!("  a step without instruments  {none_ns:7.0} ns");
    println!("  with {SENSORS} sensors              {all_ns:7.0} ns");
    println!("  more in a pair              {more_ns:7.0} ns, at most {MOST_NS}");
    let mut line = json!({
        "bench": "loop/instruments",
        "machine": machine(),
        "pairs": pairs,
        "none_ns": none_ns,
        "sensors_ns": all_ns,
        "more_ns": more_ns,
    });
    if let Some(before) = std::env::var_os(BEFORE) {
        let before = Programs {
            hil: PathBuf::from(before),
        };
        let mut ratios: Vec<f64> = (0..pairs)
            .map(|_| step(programs, &bare) / step(&before, &bare))
            .collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let (least, most) = (ratios[0], ratios[ratios.len() - 1]);
        let ratio = median(ratios);
        println!("  without instruments, to {BEFORE}  {ratio:.3} ({least:.3} to {most:.3})");
        line["to_before"] = json!({"median": ratio, "least": least, "most": most});
    }
    println!("{line}\n");
}

/// The sensors of the first measured signals, each coupled with another.
fn sensors() -> String {
    let plants = plant_process::models::all();
    let plant = plants
        .iter()
        .find(|plant| plant.description.name == "drhas");
    let measured = &plant.expect("built in").description.measured;
    let mut text = String::new();
    for (field, other) in measured.iter().zip(&measured[1..]).take(SENSORS) {
        let (signal, other) = (&field.name, &other.name);
        let _ = write!(
            text,
            "\n[[sensors]]\nsignal = \"{signal}\"\ncross = {{ {other} = 1e-12 }}\n{KEYS}"
        );
    }
    text
}

/// Wall time of a step.
fn step_ns(summary: &Value) -> f64 {
    let number = |name: &str| summary[name].as_f64().expect("a number");
    1e9 * number("wall_time_s") / number("steps")
}
