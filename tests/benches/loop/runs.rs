//! Whole runs by `hil run`, as a user starts them.

use serde_json::{Value, json};

use crate::effort::rounds;
use crate::experiment::scenario_file;
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;

/// Way to run the scenario, and its figures.
struct Way {
    name: &'static str,
    arguments: &'static [&'static str],
    done: Vec<Value>,
}

impl Way {
    const fn new(name: &'static str, arguments: &'static [&'static str]) -> Self {
        Self {
            name,
            arguments,
            done: Vec::new(),
        }
    }

    /// Returns the median of a number in the summary.
    fn median_of(&self, pointer: &str) -> f64 {
        let values = self.done.iter();
        median(values.map(|summary| {
            summary
                .pointer(pointer)
                .and_then(Value::as_f64)
                .unwrap_or(0.0)
        }))
    }
}

/// Runs the paper's scenario in every way and prints the speeds.
pub(crate) fn compare(programs: &Programs) {
    let scenario = scenario_file();
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let mut ways = [
        Way::new("two processes, lz4", &["--compression", "lz4"]),
        Way::new("two processes, uncompressed", &["--compression", "none"]),
        Way::new("two processes, not recorded", &["--no-record"]),
        Way::new("in-process, lz4", &["--link", "in-process"]),
        Way::new(
            "in-process, not recorded",
            &["--link", "in-process", "--no-record"],
        ),
    ];
    let bystanders = Bystanders::watch();
    for _ in 0..rounds() {
        for way in &mut ways {
            let mut arguments = vec![scenario];
            arguments.extend(way.arguments);
            way.done.push(programs.run(&arguments));
        }
    }
    let others = bystanders.share();

    println!(
        "whole runs of severe-leakage.toml (FTSC, 20 s at 10 kHz), medians of {}, \
         other programs took {:.0} % of the machine",
        rounds(),
        100.0 * others
    );
    println!(
        "{:<29} {:>11} {:>10} {:>16} {:>16} {:>11} {:>10}",
        "", "x real time", "us a step", "round trip p50", "round trip p99", "plant p50", "law p50"
    );
    let mut lines = Vec::new();
    for way in &ways {
        let factor = way.median_of("/realtime_factor");
        let steps = way.median_of("/steps");
        let step_us = 1e6 * way.median_of("/wall_time_s") / steps;
        let [p50, p99, plant, law] = [
            "/latency_ns/round_trip/p50",
            "/latency_ns/round_trip/p99",
            "/latency_ns/plant/p50",
            "/latency_ns/controller/p50",
        ]
        .map(|pointer| way.median_of(pointer));
        let name = way.name;
        println!(
            "{name:<29} {factor:>11.1} {step_us:>10.2} {p50:>13.0} ns {p99:>13.0} ns \
             {plant:>8.0} ns {law:>7.0} ns"
        );
        lines.push(json!({
            "way": name,
            "realtime_factor": factor,
            "step_us": step_us,
            "round_trip_p50_ns": p50,
            "round_trip_p99_ns": p99,
            "plant_p50_ns": plant,
            "law_p50_ns": law,
        }));
    }
    let digests: Vec<&Value> = (ways.iter().flat_map(|way| &way.done))
        .map(|summary| &summary["digest"])
        .collect();
    assert!(
        digests.iter().all(|digest| *digest == digests[0]),
        "the runs differ: {digests:?}"
    );
    let line = json!({
        "bench": "loop/runs",
        "machine": machine(),
        "rounds": rounds(),
        "others_share": others,
        "digest": digests[0],
        "ways": lines,
    });
    println!("{line}\n");
}
