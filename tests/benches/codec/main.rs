//! Bench `codec`: what does a frame of a port cost?
//!
//! `cargo bench -p tests --bench codec` prints the time to pack and unpack a frame of 22 signals with a counter and a
//! checksum, as raw numbers, as bit fields of both byte orders, and as a line of JSON, and that of a step of a bus in
//! simulation on two networks over one. There is no limit on any number.
//! `HIL_BENCH_QUICK=1` only tries whether it works.

mod networks;

use std::hint::black_box;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use hil_codec::pack::Packer;
use hil_codec::receive::Receiver;
use hil_codec::row::Row;
use hil_config::port::{Carries, Port};
use serde_json::json;
use shared_types::quality::SignalSet;

use self::networks::Networks;

/// Number of signals in each frame.
const SIGNALS: usize = 22;
/// Turns, of which the fastest counts: each measures all kinds of frames.
const TURNS: usize = 9;

fn main() -> ExitCode {
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench codec`");
        return ExitCode::SUCCESS;
    }
    let is_quick = std::env::var_os("HIL_BENCH_QUICK").is_some();
    let rounds = if is_quick { 1000 } else { 200_000 };
    let kinds = [
        (
            "f64, crc-32/iso-hdlc",
            numbers("f64", 1.0, "crc-32/iso-hdlc"),
        ),
        (
            "i16 with scale, crc-16/ibm-3740",
            numbers("i16", 0.01, "crc-16/ibm-3740"),
        ),
        ("i16 with scale, xor-8", numbers("i16", 0.01, "xor-8")),
        ("bit fields of 13 bits, no checksum", bits()),
        ("line of JSON", json()),
    ];
    let mut best = [[f64::INFINITY; 2]; 5];
    for _ in 0..TURNS {
        for (times, (_, text)) in best.iter_mut().zip(&kinds) {
            for (least, time) in times.iter_mut().zip(measure(text, rounds)) {
                *least = if time < *least { time } else { *least };
            }
        }
    }
    println!(
        "{:36} {:>6} {:>10} {:>10}",
        "frame of 22 signals", "bytes", "pack", "unpack"
    );
    for ((name, text), [pack_ns, unpack_ns]) in kinds.iter().zip(best) {
        let bytes = bound(text).0.longest();
        println!("{name:36} {bytes:6} {pack_ns:7.0} ns {unpack_ns:7.0} ns");
    }
    let [mut one, mut two] = [1, 2].map(Networks::new);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..TURNS {
        for (least, networks) in best.iter_mut().zip([&mut one, &mut two]) {
            let time = networks.step_ns(rounds);
            *least = if time < *least { time } else { *least };
        }
    }
    let [one_ns, two_ns] = best;
    let ratio = two_ns / one_ns;
    println!(
        "\na step of a bus: {one_ns:.0} ns on one network, {two_ns:.0} ns on two, ratio {ratio:.2}"
    );
    let networks = json!([{ "networks": "A and B", "step_ns": two_ns, "alone_ns": one_ns, "to_alone": ratio }]);
    println!("{}", json!({ "bench": "codec", "networks": networks }));
    ExitCode::SUCCESS
}

/// Returns the frame of raw numbers of a type.
fn numbers(kind: &str, scale: f64, algorithm: &str) -> String {
    let fields = (0..SIGNALS).map(|index| {
        format!("{{ signal = \"measured.s{index}\", type = \"{kind}\", scale = {scale:?} }}")
    });
    let width = match algorithm {
        "crc-32/iso-hdlc" => "u32",
        "crc-16/ibm-3740" => "u16",
        _ => "u8",
    };
    let tail = [
        "{ kind = \"counter\", type = \"u8\" }".to_owned(),
        format!("{{ kind = \"checksum\", type = \"{width}\", algorithm = \"{algorithm}\" }}"),
    ];
    frame("", fields.chain(tail))
}

/// Returns the frame of bit fields across bytes, half of them big-endian.
fn bits() -> String {
    let fields = (0..SIGNALS).map(|index| {
        let order = if index < SIGNALS / 2 { "little" } else { "big" };
        let byte = if index == SIGNALS / 2 { "byte = 18, " } else { "" };
        format!("{{ signal = \"measured.s{index}\", type = \"i13\", {byte}scale = 0.1, order = \"{order}\" }}")
    });
    frame("", fields)
}

/// Returns the line of JSON.
fn json() -> String {
    let fields = (0..SIGNALS)
        .map(|index| format!("{{ signal = \"measured.s{index}\", path = \"values.s{index}\" }}"));
    frame("format = \"json\"\n", fields)
}

fn frame(keys: &str, fields: impl Iterator<Item = String>) -> String {
    let fields: Vec<String> = fields.collect();
    format!(
        "port = 1\n[[frames]]\nname = \"a\"\ncarries = \"sample\"\n{keys}fields = [\n{}\n]\n",
        fields.join(",\n")
    )
}

fn bound(text: &str) -> (Packer, Receiver, Row) {
    let port = Port::parse(text, Path::new("bench.port.toml"), None);
    let port = port.unwrap_or_else(|problems| panic!("{problems}"));
    let (table, frame) = (port.table(Carries::Sample), &port.frames[0].frame);
    let packer = Packer::new(frame, &table).expect("a sound frame");
    let receiver = Receiver::new(std::slice::from_ref(frame), &table).expect("a sound frame");
    (packer, receiver, Row::new(table.len()))
}

/// Measures packing and unpacking in ns a frame.
fn measure(text: &str, rounds: u32) -> [f64; 2] {
    let (mut packer, mut receiver, mut row) = bound(text);
    let mut values: Vec<f64> = (0..SIGNALS)
        .map(|index| index as f64 * 3.7 - 40.0)
        .collect();
    let valid = SignalSet::EMPTY;
    // One period of frames, whose counters follow each other in the next round too.
    let frames: Vec<Vec<u8>> = (0..256)
        .map(|_| packer.pack(&values, &valid).to_vec())
        .collect();
    let begin = Instant::now();
    for round in 0..rounds {
        values[round as usize % SIGNALS] += 0.01;
        black_box(packer.pack(black_box(&values), &valid));
    }
    let pack_ns = begin.elapsed().as_nanos() as f64 / f64::from(rounds);
    let begin = Instant::now();
    for round in 0..rounds {
        let bytes = &frames[round as usize % frames.len()];
        let (_, result) = receiver.receive(None, black_box(bytes), &mut row);
        assert!(result.is_ok(), "{result:?}");
    }
    black_box(&row);
    let unpack_ns = begin.elapsed().as_nanos() as f64 / f64::from(rounds);
    [pack_ns, unpack_ns]
}
