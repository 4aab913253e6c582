//! The plant's step and each law's step alone, in one thread.

use serde_json::json;

use crate::ROUNDS;
use crate::experiment::{Experiment, Rows};
use crate::measure::{Bystanders, machine, median};

/// Measures plant, stimuli and laws in turns and prints them.
pub(crate) fn compare() {
    let experiments: Vec<(Experiment, Rows)> = (["pid", "nrsc", "ftsc"].iter())
        .map(|law| {
            let experiment = Experiment::new(law);
            let rows = experiment.rows();
            (experiment, rows)
        })
        .collect();
    let bystanders = Bystanders::watch();
    let mut done: Vec<(String, Vec<f64>)> = Vec::new();
    let mut note = |name: String, ns: f64| match done.iter_mut().find(|(n, _)| *n == name) {
        Some((_, values)) => values.push(ns),
        None => done.push((name, vec![ns])),
    };
    for _ in 0..ROUNDS {
        let (last, rows) = experiments.last().expect("there are laws");
        note("plant drhas, 4 substeps".into(), last.plant_ns(rows));
        note("stimuli".into(), last.stimuli_ns());
        for (experiment, rows) in &experiments {
            let name = format!("law {}", experiment.law_name());
            note(name, experiment.law_ns(rows));
        }
        note("all of it with ftsc".into(), last.closed().0);
    }
    let others = bystanders.share();

    println!(
        "one step alone, medians of {ROUNDS} runs of 200000 steps, other programs took {:.0} % of the machine",
        100.0 * others
    );
    let mut lines = Vec::new();
    for (name, values) in done {
        let step_ns = median(values);
        println!("{name:<29} {step_ns:>8.0} ns");
        lines.push(json!({ "part": name, "step_ns": step_ns }));
    }
    let line = json!({
        "bench": "loop/steps",
        "machine": machine(),
        "rounds": ROUNDS,
        "others_share": others,
        "parts": lines,
    });
    println!("{line}\n");
}
