//! Bench `exchange`: what does it cost to send a sample and have its command back?
//!
//! `cargo bench -p tests --bench exchange` measures in one run, in turns, so that ratios hold even
//! on a machine that is not idle:
//!
//! - the raw limit: two threads that copy the same payloads through shared atomics;
//! - three bare iceoryx2 patterns between two processes;
//! - the project's link between two processes, with frames sealed, summed and checked.
//!
//! The plant's side reads the clock before it sends and when the answer is there, so that each trip
//! contains one reading of the clock. All wait alike, with the project's `Waiter`: 64 polls, then
//! yield after each, on one core yield at once. There is no time limit on any number.

#[path = "../measure.rs"]
mod measure;
mod patterns;
mod peer;
mod raw;

use serde_json::json;

use self::measure::{Bystanders, cores, machine, median};
use self::peer::Where;

/// Rounds, of which medians are taken.
const ROUNDS: usize = 5;
/// Trips of a round, with both ends on cores of their own and with both on one.
const TRIPS: usize = 100_000;
const TRIPS_ON_ONE_CORE: usize = 10_000;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exchange {
    Raw,
    Blackboard,
    PublishSubscribe,
    RequestResponse,
    Link,
}

impl Exchange {
    const ALL: [Self; 5] = [
        Self::Raw,
        Self::Blackboard,
        Self::PublishSubscribe,
        Self::RequestResponse,
        Self::Link,
    ];

    const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw shared memory, two threads",
            Self::Blackboard => "iceoryx2 blackboard",
            Self::PublishSubscribe => "iceoryx2 publish-subscribe",
            Self::RequestResponse => "iceoryx2 request-response",
            Self::Link => "the project's link (on blackboard)",
        }
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|exchange| exchange.name() == name)
    }
}

/// Percentiles of one round in ns.
#[derive(Clone, Copy)]
struct Round {
    p50: f64,
    p99: f64,
}

impl Round {
    fn of(mut trips_ns: Vec<u64>) -> Self {
        trips_ns.sort_unstable();
        let at = |share: f64| trips_ns[(share * (trips_ns.len() - 1) as f64) as usize] as f64;
        Self {
            p50: at(0.5),
            p99: at(0.99),
        }
    }
}

fn main() {
    if peer::answered() {
        return;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench exchange`");
        return;
    }
    println!("machine: {}", machine());
    println!(
        "payload: {} bytes there (frame of 32 signals), {} bytes back (frame of 16)\n",
        8 * patterns::SAMPLE_WORDS,
        8 * patterns::COMMAND_WORDS
    );
    let cores = cores();
    if let [first, second, ..] = cores[..] {
        compare(Where::new(&cores, first, second), TRIPS);
    } else {
        println!("only one core: no numbers for two\n");
    }
    compare(Where::new(&cores, cores[0], cores[0]), TRIPS_ON_ONE_CORE);
}

/// Measures all exchanges in turns and prints them.
fn compare(place: Where, trips: usize) {
    let bystanders = Bystanders::watch();
    let mut rounds: Vec<(Exchange, Vec<Round>)> = Exchange::ALL.map(|e| (e, Vec::new())).into();
    for _ in 0..ROUNDS {
        for (exchange, done) in &mut rounds {
            done.push(Round::of(peer::measure(*exchange, place, trips)));
        }
    }
    let others = bystanders.share();
    let p50_of = |exchange: Exchange| {
        let (_, done) = &rounds[Exchange::ALL.iter().position(|e| *e == exchange)?];
        Some(done.iter().map(|round| round.p50).collect::<Vec<f64>>())
    };
    let ratio = |to: Exchange, done: &[Round]| {
        let base = p50_of(to).expect("every exchange was measured");
        median(done.iter().zip(base).map(|(round, base)| round.p50 / base))
    };

    println!(
        "{place}, {ROUNDS} rounds of {trips} trips, other programs took {:.0} % of the machine",
        100.0 * others
    );
    println!(
        "{:<36} {:>9} {:>9} {:>8} {:>14}",
        "exchange", "p50 [ns]", "p99 [ns]", "to raw", "to blackboard"
    );
    let mut lines = Vec::new();
    for (exchange, done) in &rounds {
        let p50 = median(done.iter().map(|round| round.p50));
        let p99 = median(done.iter().map(|round| round.p99));
        let to_raw = ratio(Exchange::Raw, done);
        let to_blackboard = ratio(Exchange::Blackboard, done);
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
        "cores": place.cores(),
        "wait": place.wait(),
        "rounds": ROUNDS,
        "trips": trips,
        "others_share": others,
        "exchanges": lines,
    });
    println!("{line}\n");
}
