//! Costs of a step that computes nothing: by signals, by observers, and against the limits of the
//! machine.
//!
//! Observers attach to the record stream and take all of it, in threads of this process that look
//! every millisecond; the recorder does the same and also writes it down, makes the digest and holds
//! the plant back rather than lose a record.

use serde_json::json;

use crate::effort::{rounds, shortened};
use crate::measure::{Bystanders, cores, machine, median};
use crate::null::{self, Figures, Names, SIZES};
use crate::programs::Programs;
use crate::round_trips::{self, Exchange, Place, Round, SIGNALS, waits};

/// Round trips in a round of a bare exchange.
const TRIPS: u64 = 100_000;

/// Observers of the records of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Observed {
    By(usize),
    Recorder,
}

impl Observed {
    const ALL: [Self; 5] = [
        Self::By(0),
        Self::By(1),
        Self::By(2),
        Self::By(4),
        Self::Recorder,
    ];

    const fn name(self) -> &'static str {
        match self {
            Self::By(0) => "nobody",
            Self::By(1) => "1 observer",
            Self::By(2) => "2 observers",
            Self::By(_) => "4 observers",
            Self::Recorder => "the recorder, lz4",
        }
    }
}

/// Kind of run and its figures in each round.
struct Row {
    signals: usize,
    observed: Observed,
    done: Vec<Figures>,
}

/// Measures all variants in turns and prints them.
pub(crate) fn compare(programs: &Programs, names: &Names) {
    let cores = cores();
    let place = Place::apart(&cores).unwrap_or_else(|| Place::together(&cores));
    let bystanders = Bystanders::watch();
    let mut rows: Vec<Row> = (SIZES.iter())
        .flat_map(|&signals| {
            Observed::ALL.map(|observed| Row {
                signals,
                observed,
                done: Vec::new(),
            })
        })
        .collect();
    let (mut raw, mut bare) = (Vec::new(), Vec::new());
    for _ in 0..rounds() {
        for row in &mut rows {
            if row.signals == SIGNALS && row.observed == Observed::By(0) {
                let trips = shortened(TRIPS);
                let measure = |exchange| round_trips::measure(exchange, place, trips);
                raw.push(measure(Exchange::Raw));
                bare.push(measure(Exchange::Blackboard));
            }
            row.done.push(match row.observed {
                Observed::By(observers) => null::watched(names, row.signals, observers),
                Observed::Recorder => null::run(programs, names, row.signals, &[]),
            });
        }
    }
    let others = bystanders.share();

    println!(
        "null plant and controller, two processes, medians of {} runs, other programs took {:.0} % \
         of the machine",
        rounds(),
        100.0 * others
    );
    println!(
        "{:>7}  {:<18} {:>15} {:>15} {:>12}",
        "signals", "observed by", "round trip p50", "round trip p99", "whole step"
    );
    let mut lines = Vec::new();
    for row in &rows {
        let (signals, observed) = (row.signals, row.observed.name());
        let [p50, p99, step] = [0, 1, 2].map(|i| median(row.done.iter().map(|f| f[i])));
        println!("{signals:>7}  {observed:<18} {p50:>12.0} ns {p99:>12.0} ns {step:>9.0} ns");
        lines.push(json!({
            "signals": signals,
            "observed_by": observed,
            "round_trip_p50_ns": p50,
            "round_trip_p99_ns": p99,
            "step_ns": step,
        }));
    }
    let alone = |row: &&Row| row.signals == SIGNALS && row.observed == Observed::By(0);
    let alone = &rows.iter().find(alone).expect("it was measured").done;
    let ratio = |figure: usize, to: &[Round], of: fn(&Round) -> f64| {
        median((alone.iter().zip(to)).map(|(figures, round)| figures[figure] / of(round)))
    };
    let p50_to_bare = ratio(0, &bare, |round| round.p50);
    let p50_to_raw = ratio(0, &raw, |round| round.p50);
    let p99_to_raw = ratio(1, &raw, |round| round.p99);
    for (exchange, rounds) in [(Exchange::Raw, &raw), (Exchange::Blackboard, &bare)] {
        let p50 = median(rounds.iter().map(|round| round.p50));
        let p99 = median(rounds.iter().map(|round| round.p99));
        let name = exchange.name();
        println!("{SIGNALS:>7}  {name:<30} {p50:>0.0} ns at p50, {p99:.0} ns at p99");
    }
    println!(
        "{SIGNALS} signals and nobody observes, to the bare exchanges ({place}, {}): p50 {p50_to_bare:.2} \
         times the blackboard's and\n{p50_to_raw:.2} times the raw one, p99 {p99_to_raw:.2} times the raw one",
        waits(place)
    );
    let line = json!({
        "bench": "loop/costs",
        "machine": machine(),
        "rounds": rounds(),
        "others_share": others,
        "runs": lines,
        "p50_to_blackboard": p50_to_bare,
        "p50_to_raw": p50_to_raw,
        "p99_to_raw": p99_to_raw,
    });
    println!("{line}\n");
}
