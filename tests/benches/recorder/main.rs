//! Bench `recorder`: how does the recorder's thread spend its time?
//!
//! `cargo bench -p tests --bench recorder` records 4 s of two actuators, one of which leaks, once and plays its
//! records again and again, one part of the recorder after another, in one thread. Printed is the
//! processor time of that thread in ns a record: on a machine without a core to spare it is what
//! recording adds to a step. There is no limit on any number.

#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/programs.rs"]
#[expect(dead_code, reason = "its runs leave their files here")]
mod programs;
mod tape;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc;

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_facts::results::latency::legs::Latency;
use hil_recording::compression::Compression;
use hil_recording::excerpt::Choice;
use hil_recording::writer::{Provenance, Recording};
use hil_run::recorder::{Recorder, RecordingPlan};
use hil_session::session::Session;
use hil_session::stream::{IceoryxSink, IceoryxSource};
use rustix::time::{ClockId, clock_gettime};
use serde_json::json;
use shared_types::digest::Digest;
use shared_types::stream::{Backpressure, RecordSink, RecordSource, in_process};
use shared_types::time::Step;
use shared_types::zerocopy::IntoBytes;
use tempfile::TempDir;

use tape::{Replay, Tape};

/// Rounds; the results are medians over them.
const ROUNDS: usize = 5;
/// Number of records in a stream at once.
const BATCH: usize = 500;
const COMPRESSIONS: [(&str, Compression); 3] = [
    ("none", Compression::None),
    ("lz4", Compression::Lz4),
    ("zstd", Compression::Zstd),
];

fn main() -> std::process::ExitCode {
    // `cargo test --all-targets` starts benches too, without this argument.
    if std::env::args().any(|argument| argument == "--bench") {
        println!("machine: {}\n", measure::machine());
        compare();
    } else {
        println!("run me with `cargo bench -p tests --bench recorder`");
    }
    std::process::ExitCode::SUCCESS
}

/// The recorded scenario.
fn scenario_file() -> PathBuf {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.join("scenarios/leakage.toml")
}

/// Returns the processor time of this thread in ns.
fn cpu_ns() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    1e9 * time.tv_sec as f64 + time.tv_nsec as f64
}

fn tape() -> Tape {
    let settings = ["run.duration_s=4".to_owned()];
    let folder = TempDir::new().expect("a folder");
    let run = folder.path().join("run");
    let scenario = scenario_file();
    let scenario = scenario.to_str().expect("a path in UTF-8");
    programs::Programs::built().run_in(&run, &[scenario, "--set", &settings[0]]);
    Tape::read(&run, &settings)
}

fn compare() {
    let tape = Arc::new(tape());
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("run.mcap");
    let bystanders = measure::Bystanders::watch();
    let mut parts: Vec<(String, Vec<f64>)> = Vec::new();
    let mut note = |name: String, ns: f64| {
        let ns = ns / tape.records().len() as f64;
        match parts.iter_mut().find(|(part, _)| *part == name) {
            Some((_, values)) => values.push(ns),
            None => parts.push((name, vec![ns])),
        }
    };
    let mut bytes = Vec::new();
    let session = Session::create(None).expect("a session");
    for _ in 0..ROUNDS {
        note("drain, shared memory".into(), drain_iceoryx_ns(&tape));
        note("drain, in process".into(), {
            let (mut sink, mut source) = in_process::pair();
            drain_ns(&tape, &mut sink, &mut source)
        });
        note("digest".into(), digest_ns(&tape));
        note("sums of chunks".into(), sums_ns(&tape));
        note("metrics".into(), metrics_ns(&tape));
        note("histograms".into(), histograms_ns(&tape));
        bytes.clear();
        for (name, compression) in COMPRESSIONS {
            let made_ns = recording_ns(&tape, compression, Path::new("/dev/null"));
            let written_ns = recording_ns(&tape, compression, &file);
            let size = std::fs::metadata(&file).expect("a file").len();
            bytes.push((name, size as f64 / tape.records().len() as f64));
            note(format!("{name}: messages and chunks"), made_ns);
            note(format!("{name}: writing"), written_ns - made_ns);
        }
        note("thread, not recorded".into(), thread_ns(&tape, None));
        for (name, compression) in COMPRESSIONS {
            let plan = RecordingPlan {
                path: file.clone(),
                compression,
                choice: Choice::default(),
                provenance: Provenance::default(),
                session: session.info().clone(),
            };
            note(format!("thread, {name}"), thread_ns(&tape, Some(plan)));
        }
    }
    let others = bystanders.share();
    println!(
        "processor time a record, medians of {ROUNDS} rounds of {} records of {} words, other programs took {:.0} % of the machine",
        tape.records().len(),
        tape.layout.words(),
        100.0 * others
    );
    let mut lines = Vec::new();
    for (name, values) in parts {
        let ns = measure::median(values);
        println!("{name:<29} {ns:>8.0} ns");
        lines.push(json!({ "part": name, "ns": ns }));
    }
    for (name, size) in &bytes {
        println!("{name:<29} {size:>8.0} bytes");
    }
    let line = json!({
        "bench": "recorder",
        "machine": measure::machine(),
        "rounds": ROUNDS,
        "others_share": others,
        "parts": lines,
        "bytes": bytes,
    });
    println!("{line}\n");
}

fn drain_iceoryx_ns(tape: &Tape) -> f64 {
    let session = Session::create(None).expect("a session");
    let mut sink = IceoryxSink::create(session.info(), Backpressure::Always).expect("a stream");
    let mut source = IceoryxSource::open(session.info(), true).expect("a stream");
    drain_ns(tape, &mut sink, &mut source)
}

fn drain_ns(tape: &Tape, sink: &mut impl RecordSink, source: &mut impl RecordSource) -> f64 {
    sink.open(&tape.layout).expect("opens");
    // The first look gives the first credit.
    source.drain(&mut |item| drop(item)).expect("works");
    let mut taken_ns = 0.0;
    let records: Vec<_> = tape.records().collect();
    for batch in records.chunks(BATCH) {
        assert!(sink.has_room().expect("works"));
        for words in batch {
            sink.record(words).expect("works");
        }
        let begun_ns = cpu_ns();
        let count = source.drain(&mut |item| drop(black_box(item)));
        taken_ns += cpu_ns() - begun_ns;
        assert_eq!(count.expect("works"), batch.len());
    }
    taken_ns
}

fn digest_ns(tape: &Tape) -> f64 {
    let mut digest = Digest::default();
    let begun_ns = cpu_ns();
    for words in tape.records() {
        digest.record(tape.layout.view(words).hashed);
    }
    let taken_ns = cpu_ns() - begun_ns;
    black_box(digest.finish());
    taken_ns
}

/// The checksums of chunks, a cost that every variant with chunks includes.
fn sums_ns(tape: &Tape) -> f64 {
    let mut sum = crc32fast::Hasher::new();
    let begun_ns = cpu_ns();
    for words in tape.records() {
        sum.update(words.as_bytes());
    }
    let taken_ns = cpu_ns() - begun_ns;
    black_box(sum.finalize());
    taken_ns
}

fn metrics_ns(tape: &Tape) -> f64 {
    let columns = Columns::from(&tape.layout);
    let mut evaluation = Evaluation::new(&tape.plan, &columns).expect("the scenario's metrics");
    let begun_ns = cpu_ns();
    for words in tape.records() {
        let view = tape.layout.view(words);
        evaluation.observe(Step(view.step), view.values, []);
    }
    let taken_ns = cpu_ns() - begun_ns;
    black_box(evaluation.results());
    taken_ns
}

fn histograms_ns(tape: &Tape) -> f64 {
    let mut latency = Latency::default();
    let begun_ns = cpu_ns();
    for words in tape.records() {
        let view = tape.layout.view(words);
        latency.take(view.step, &view.timing);
    }
    let taken_ns = cpu_ns() - begun_ns;
    black_box(latency.summary());
    taken_ns
}

/// Messages, chunks and file, without the end of the file.
fn recording_ns(tape: &Tape, compression: Compression, path: &Path) -> f64 {
    let layout = &tape.layout;
    let recording = Recording::create(path, compression, layout, &Provenance::default(), None);
    let mut recording = recording.expect("creates");
    let begun_ns = cpu_ns();
    for words in tape.records() {
        let written = recording.record(words, &layout.view(words));
        written.expect("writes");
    }
    cpu_ns() - begun_ns
}

/// The whole recorder without its stream.
fn thread_ns(tape: &Arc<Tape>, recording: Option<RecordingPlan>) -> f64 {
    let (plan, layout) = (tape.plan.clone(), tape.layout.clone());
    let (tell, told) = mpsc::channel();
    let replay = Replay::new(Arc::clone(tape), tell);
    let recorder = Recorder::start(plan, recording, Vec::new(), None, None, || {
        let mut replay = Some(replay);
        move || Ok(replay.take().map(|replay| (replay, layout.clone())))
    });
    let taken_ns = told.recv().expect("it ends");
    let recorded = recorder.finish().expect("it does not panic");
    assert_eq!(recorded.error, None);
    assert_eq!(recorded.records, tape.records().len() as u64);
    taken_ns
}
