//! Runs with a single core for plant, controller and recorder, as under `taskset -c 0`.

use hil_session::realtime::pin;
use serde_json::json;

use crate::effort::rounds;
use crate::experiment::scenario_file;
use crate::measure::{Bystanders, cores, machine, median};
use crate::null::{self, Names};
use crate::programs::Programs;
use crate::round_trips::{Place, SIGNALS};

/// Measures these runs in turns and prints the time of a step.
pub(crate) fn compare(programs: &Programs, names: &Names) {
    let cores = cores();
    let place = Place::together(&cores);
    let scenario = scenario_file();
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let paper = |arguments: &[&str]| {
        let summary = programs.run(&[&[scenario], arguments].concat());
        let number = |name: &str| summary[name].as_f64().expect("a number");
        1e9 * number("wall_time_s") / number("steps")
    };
    let nothing = |arguments: &[&str]| null::run(programs, names, SIGNALS, arguments)[2];
    let null = format!("null plant and law, {SIGNALS} signals");
    let mut done = [
        (format!("{null}, not recorded"), Vec::new()),
        (format!("{null}, lz4"), Vec::new()),
        ("paper's scenario, FTSC, not recorded".into(), Vec::new()),
        ("paper's scenario, FTSC, lz4".into(), Vec::new()),
    ];
    let bystanders = Bystanders::watch();
    pin(cores[0] as u32).expect("a core that this process may run on");
    for _ in 0..rounds() {
        done[0].1.push(nothing(&["--no-record"]));
        done[1].1.push(nothing(&[]));
        done[2].1.push(paper(&["--no-record"]));
        done[3].1.push(paper(&[]));
    }
    place.leave();
    let others = bystanders.share();

    println!(
        "all on one core, medians of {} runs, other programs took {:.0} % of the machine",
        rounds(),
        100.0 * others
    );
    let mut lines = Vec::new();
    for (run, values) in done {
        let step_ns = median(values);
        println!("{run:<40} {:>8.2} us a step", 1e-3 * step_ns);
        lines.push(json!({ "run": run, "step_ns": step_ns }));
    }
    let line = json!({
        "bench": "loop/one-core",
        "machine": machine(),
        "place": place.to_string(),
        "rounds": rounds(),
        "others_share": others,
        "runs": lines,
    });
    println!("{line}\n");
}
