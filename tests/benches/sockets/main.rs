//! Bench `sockets`: how much faster is shared memory than what a user would pick instead?
//!
//! `cargo bench -p tests --bench sockets` sends samples and commands as large as the link's frames
//! between two processes, over the link and over sockets:
//!
//! - **spinning**: the link and every socket are polled without a pause, so that only what carries
//!   the payload differs;
//! - **blocking**: the sockets sleep in the kernel until something comes, as PX4, ArduPilot, ZeroMQ
//!   and DDS do. Those add framing, queues and threads to a socket, so these rows are the floor of
//!   what their users get. The link has no wait in the kernel and is compared as it spins.
//!
//! One ratio alone would mislead: the second is mostly the price of waking another core, the first is
//! without it. They are always printed together. A third table has both sides on one core, where
//! nobody can spin. All is measured in turns; no number has a limit. `HIL_BENCH_QUICK=1` only tries
//! whether it works.

#[path = "../shared/effort.rs"]
mod effort;
#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/round_trips/mod.rs"]
mod round_trips;

use serde_json::{Value, json};

use self::effort::{rounds, shortened};
use self::measure::{Bystanders, cores, machine, median};
use self::round_trips::{COMMAND_BYTES, Exchange, Place, Round, SAMPLE_BYTES, Wait};

/// Trips of a round that spins, and of one that gives the core away at each.
const TRIPS: u64 = 100_000;
const TRIPS_AWAY: u64 = 20_000;

const SOCKETS: [Exchange; 4] = [
    Exchange::UnixStream,
    Exchange::UnixDatagram,
    Exchange::Udp,
    Exchange::Tcp,
];

/// Way to cross, and its times in each round.
struct Row {
    exchange: Exchange,
    wait: Wait,
    done: Vec<Round>,
}

impl Row {
    const fn new(exchange: Exchange, wait: Wait) -> Self {
        Self {
            exchange,
            wait,
            done: Vec::new(),
        }
    }

    fn p50_ns(&self) -> f64 {
        median(self.done.iter().map(|round| round.p50))
    }

    fn p99_ns(&self) -> f64 {
        median(self.done.iter().map(|round| round.p99))
    }

    /// Returns the ratio of this row's time to the other row's.
    fn ratio_to(&self, other: &Self) -> f64 {
        let pairs = self.done.iter().zip(&other.done);
        median(pairs.map(|(own, other)| own.p50 / other.p50))
    }
}

fn main() {
    if round_trips::answered() {
        return;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench sockets`");
        return;
    }
    println!("machine: {}", machine());
    println!("payload: {SAMPLE_BYTES} bytes there, {COMMAND_BYTES} bytes back\n");
    let cores = cores();
    match Place::apart(&cores) {
        Some(place) => compare(place),
        None => println!("only one core: no numbers for two\n"),
    }
    compare(Place::together(&cores));
}

/// Measures all in turns and prints them with both ratios.
fn compare(place: Place<'_>) {
    let bystanders = Bystanders::watch();
    let mut rows = vec![
        Row::new(Exchange::Raw, Wait::Spin),
        Row::new(Exchange::Link, Wait::Spin),
    ];
    for wait in [Wait::Spin, Wait::Block] {
        rows.extend(SOCKETS.map(|socket| Row::new(socket, wait)));
    }
    for _ in 0..rounds() {
        for row in &mut rows {
            let trips = match row.wait {
                Wait::Spin if !place.is_shared() => TRIPS,
                _ => TRIPS_AWAY,
            };
            let round = round_trips::measure(row.exchange, row.wait, place, shortened(trips));
            row.done.push(round);
        }
    }
    let others = bystanders.share();

    println!(
        "{place}, medians of {} rounds, other programs took {:.0} % of the machine",
        rounds(),
        100.0 * others
    );
    println!(
        "{:<36} {:<22} {:>10} {:>10} {:>9}",
        "exchange", "wait", "p50 [ns]", "p99 [ns]", "to link"
    );
    let link = &rows[1];
    let mut lines = Vec::new();
    for row in &rows {
        let (name, wait) = (row.exchange.name(), row.wait.at(place));
        let (p50, p99, to_link) = (row.p50_ns(), row.p99_ns(), row.ratio_to(link));
        println!("{name:<36} {wait:<22} {p50:>10.0} {p99:>10.0} {to_link:>9.2}");
        lines.push(json!({
            "exchange": name,
            "wait": wait,
            "p50_ns": p50,
            "p99_ns": p99,
            "p50_to_link": to_link,
        }));
    }
    let [polled, blocking] = [Wait::Spin, Wait::Block].map(|wait| best(&rows, wait));
    println!(
        "the link is {:.2} times as fast as the best socket that is polled as it is ({}) and {:.1} \
         times as fast as\nthe best blocking one ({}), the floor of what PX4, ArduPilot, ZeroMQ and \
         DDS users get",
        polled.ratio_to(link),
        polled.exchange.name(),
        blocking.ratio_to(link),
        blocking.exchange.name(),
    );
    let ratio = |row: &Row| -> Value {
        json!({ "socket": row.exchange.name(), "p50_to_link": row.ratio_to(link) })
    };
    let line = json!({
        "bench": "sockets",
        "machine": machine(),
        "place": place.to_string(),
        "payload_bytes": [SAMPLE_BYTES, COMMAND_BYTES],
        "rounds": rounds(),
        "others_share": others,
        "exchanges": lines,
        "best_polled": ratio(polled),
        "best_blocking": ratio(blocking),
    });
    println!("{line}\n");
}

/// The fastest socket that waits so.
fn best(rows: &[Row], wait: Wait) -> &Row {
    let sockets = rows
        .iter()
        .filter(|row| row.wait == wait && SOCKETS.contains(&row.exchange));
    let best = sockets.min_by(|a, b| a.p50_ns().total_cmp(&b.p50_ns()));
    best.expect("there are sockets")
}
