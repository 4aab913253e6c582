//! Costs of the fault layer: alone with no fault, and whole runs with ten signal faults.

use std::fmt::Write as _;
use std::hint::black_box;

use hil_session::clock::monotonic_ns;
use plant_process::faults::{FaultBuilder, FaultLayer, kinds};
use serde_json::Value;
use shared_types::describe::Settings;
use shared_types::frame::VALIDITY_WORDS;
use shared_types::record::RecordLayout;
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use crate::effort::rounds;
use crate::experiment::scenario_file;
use crate::measure::median;
use crate::programs::Programs;

/// Steps of the layer alone.
const STEPS: u64 = 1_000_000;

/// Prints both tables.
pub(crate) fn compare(programs: &Programs) {
    let scenario = scenario_file();
    let scenario = scenario.to_str().expect("plain text");
    let folder = tempfile::TempDir::new().expect("a folder");
    let faulted = folder.path().join("ten.toml");
    let text = std::fs::read_to_string(scenario).expect("the scenario");
    std::fs::write(&faulted, text + &ten_biases()).expect("the folder can be written");
    let faulted = faulted.to_str().expect("plain text");
    let (mut none, mut ten, mut alone) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..rounds() {
        alone.push(idle_ns());
        none.push(step_ns(&programs.run(&[scenario])));
        ten.push(step_ns(&programs.run(&[faulted])));
    }
    let (none, ten, alone) = (median(none), median(ten), median(alone));
    println!("fault layer of the paper's plant, medians of {}", rounds());
    println!(
        "  the layer alone without a fault      {alone:7.1} ns, {:.2} % of a step of two processes",
        100.0 * alone / none
    );
    println!("  a step of two processes              {none:7.0} ns");
    println!(
        "  the same with ten signal faults      {ten:7.0} ns, {:+.1} %\n",
        100.0 * (ten / none - 1.0)
    );
}

/// Ten faults without any effect that the plant would notice, on all measured signals from the start.
fn ten_biases() -> String {
    let mut text = String::new();
    let plants = plant_process::models::all();
    let plant = plants
        .iter()
        .find(|plant| plant.description.name == "drhas");
    let measured = &plant.expect("built in").description.measured;
    assert_eq!(measured.len(), 10);
    for field in measured {
        let _ = write!(
            text,
            "\n[[faults]]\nkind = \"bias\"\nat_s = 0\n[[faults.effects]]\ntarget = \"measured.{}\"\nbias = 1e-15\n",
            field.name
        );
    }
    text
}

/// Wall time of a step.
fn step_ns(summary: &Value) -> f64 {
    let number = |name: &str| summary[name].as_f64().expect("a number");
    1e9 * number("wall_time_s") / number("steps")
}

/// Time of all calls of the fault layer in one step.
fn idle_ns() -> f64 {
    let plants = plant_process::models::all();
    let plant = plants
        .iter()
        .find(|plant| plant.description.name == "drhas");
    let plant = &plant.expect("built in").description;
    let mut parameters = Settings::default();
    for field in &plant.parameters {
        parameters.set(&field.name, field.default.unwrap_or(0.0));
    }
    let reference = vec![Field::signal("surface_angle_rad", "rad", "x"); 6];
    let seeded = (Rate::new(10_000.0).expect("legal"), 1);
    let builder = FaultBuilder::new(plant, &reference, &kinds::all(), &parameters, seeded, &[]);
    let builder = builder.expect("every parameter is there");
    let mut layer = FaultLayer::new(&builder, &[]).expect("no fault");
    layer
        .open(&builder, &RecordLayout::default())
        .expect("no fault");
    let (sensed, stimulus) = ([0.1; 10], [0.2; 6]);
    let (mut row, mut invalid) = ([0.0; 16], [0; VALIDITY_WORDS]);
    let (command, mut applied) = ([0.3; 2], [0.0; 2]);
    let begin_ns = monotonic_ns();
    for step in 0..STEPS {
        let step = Step(black_box(step));
        black_box(layer.advance(step, None));
        black_box(layer.sample(step, (&sensed, &stimulus), &mut row, &mut invalid));
        black_box(layer.timing(step));
        black_box(layer.command(
            step,
            (0, 0),
            (&command, &mut [0; VALIDITY_WORDS]),
            &mut applied,
        ));
        black_box((&row, &applied, layer.has_events()));
    }
    (monotonic_ns() - begin_ns) as f64 / STEPS as f64
}
