//! Bench `exchange`: how long does it take to send a sample and receive its command?
//!
//! `cargo bench -p tests --bench exchange` measures in one run, in turns, so that ratios hold even
//! on a machine that is not idle:
//!
//! - the raw limit: two threads that copy the same payloads through shared atomics;
//! - three bare iceoryx2 patterns between two processes;
//! - the project's link between two processes, with frames sealed, summed and checked.
//!
//! The plant's side reads the clock before it sends and when the answer is there, so that each trip
//! contains one reading of the clock. All wait alike, as the project's processes do. There is no
//! time limit on any number. `HIL_BENCH_QUICK=1` only tries whether it works.

#[path = "../shared/effort.rs"]
mod effort;
#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/round_trips/mod.rs"]
mod round_trips;

use serde_json::json;

use self::effort::{rounds, shortened};
use self::measure::{Bystanders, cores, machine, median};
use self::round_trips::{COMMAND_BYTES, Exchange, Place, Round, SAMPLE_BYTES, waits};

/// Trips of a round, with both ends on cores of their own and with both on one.
const TRIPS: u64 = 100_000;
const TRIPS_ON_ONE_CORE: u64 = 10_000;

fn main() {
    if round_trips::answered() {
        return;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench exchange`");
        return;
    }
    println!("machine: {}", machine());
    println!(
        "payload: {SAMPLE_BYTES} bytes there (frame of 32 signals), {COMMAND_BYTES} bytes back \
         (frame of 16)\n"
    );
    let cores = cores();
    match Place::apart(&cores) {
        Some(place) => compare(place, shortened(TRIPS)),
        None => println!("only one core: no numbers for two\n"),
    }
    compare(Place::together(&cores), shortened(TRIPS_ON_ONE_CORE));
}

/// Measures all exchanges in turns and prints them.
fn compare(place: Place<'_>, trips: u64) {
    let bystanders = Bystanders::watch();
    let mut done: Vec<(Exchange, Vec<Round>)> = Exchange::ALL.map(|e| (e, Vec::new())).into();
    for _ in 0..rounds() {
        for (exchange, rounds) in &mut done {
            rounds.push(round_trips::measure(*exchange, place, trips));
        }
    }
    let others = bystanders.share();
    let ratio = |to: Exchange, rounds: &[Round]| {
        let (_, base) = (done.iter().find(|(it, _)| *it == to)).expect("every one was measured");
        median(
            rounds
                .iter()
                .zip(base)
                .map(|(own, base)| own.p50 / base.p50),
        )
    };

    println!(
        "{place}, {}, {} rounds of {trips} trips, other programs took {:.0} % of the machine",
        waits(place),
        rounds(),
        100.0 * others
    );
    println!(
        "{:<36} {:>9} {:>9} {:>8} {:>14}",
        "exchange", "p50 [ns]", "p99 [ns]", "to raw", "to blackboard"
    );
    let mut lines = Vec::new();
    for (exchange, rounds) in &done {
        let p50 = median(rounds.iter().map(|round| round.p50));
        let p99 = median(rounds.iter().map(|round| round.p99));
        let to_raw = ratio(Exchange::Raw, rounds);
        let to_blackboard = ratio(Exchange::Blackboard, rounds);
        let name = exchange.name();
        println!("{name:<36} {p50:>9.0} {p99:>9.0} {to_raw:>8.2} {to_blackboard:>14.2}");
        lines.push(json!({
            "exchange": name,
            "p50_ns": p50,
            "p99_ns": p99,
            "p50_to_raw": to_raw,
            "p50_to_blackboard": to_blackboard,
        }));
    }
    let line = json!({
        "bench": "exchange",
        "machine": machine(),
        "place": place.to_string(),
        "wait": waits(place),
        "rounds": rounds(),
        "trips": trips,
        "others_share": others,
        "exchanges": lines,
    });
    println!("{line}\n");
}
