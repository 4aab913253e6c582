//! Arbitrary bytes through every reader: like fuzzing, but on a stable compiler and reproducible.
//!
//! The properties are those of the fuzz targets (`tests/fuzz/src/targets`). They run here over the committed
//! corpus, over mutations of it, and over inputs of a size that fuzzing does not reach.

use std::fs;
use std::panic::catch_unwind;
use std::path::PathBuf;

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

use crate::support::programs::workspace;

#[expect(unreachable_pub, reason = "the fuzz package has them as a library")]
#[path = "../fuzz/src/targets/mod.rs"]
mod targets;

pub(crate) mod damages;
mod records;
mod seeds;

use targets::Target;

/// Number of mutated inputs per target.
const CASES: u32 = 300;
/// Words that replace a number in a mutated input.
const ODD: [&str; 16] = [
    "nan",
    "inf",
    "-inf",
    "1e300",
    "-1e308",
    "1e999",
    "5e-324",
    "-0.0",
    "-1",
    "0",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "-9223372036854775808",
    "4294967296",
    "\"\\u001b[2J\"",
];

/// Returns the target of a name.
fn target(name: &str) -> &'static Target {
    let target = targets::ALL.iter().find(|target| target.name == name);
    target.expect("a target")
}

/// Returns the committed inputs of a target.
fn corpus(target: &Target) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = workspace().join("tests/fuzz/corpus").join(target.name);
    let entries = fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("read").path()).collect();
    paths.sort();
    let read = |path: PathBuf| (path.clone(), fs::read(path).expect("read"));
    paths.into_iter().map(read).collect()
}

/// Mutation of an input; positions are fractions of its length.
#[derive(Clone, Debug)]
enum Change {
    Flip(f64, u8),
    Insert(f64, Vec<u8>),
    Cut(f64, f64),
    Repeat(f64, f64, u8),
    /// Replaces a number by an odd one.
    Number(f64, usize),
}

fn change() -> impl Strategy<Value = Change> {
    let place = || 0.0..1.0;
    prop_oneof![
        (place(), 0..8_u8).prop_map(|(at, bit)| Change::Flip(at, bit)),
        (place(), prop::collection::vec(any::<u8>(), 1..9))
            .prop_map(|(at, b)| Change::Insert(at, b)),
        (place(), place()).prop_map(|(from, to)| Change::Cut(from, to)),
        (place(), place(), 1..4_u8).prop_map(|(from, to, n)| Change::Repeat(from, to, n)),
        (place(), 0..ODD.len()).prop_map(|(at, odd)| Change::Number(at, odd)),
    ]
}

/// Applies a mutation to an input.
fn changed(mut bytes: Vec<u8>, change: &Change) -> Vec<u8> {
    let place = |share: f64| (share * bytes.len() as f64) as usize;
    let range = |from: f64, to: f64| {
        let (from, to) = (place(from), place(to));
        if from < to { from..to } else { to..from }
    };
    match change {
        Change::Flip(at, bit) => {
            let at = place(*at);
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << bit;
            }
        }
        Change::Insert(at, inserted) => {
            let at = place(*at);
            bytes.splice(at..at, inserted.iter().copied());
        }
        Change::Cut(from, to) => {
            bytes.drain(range(*from, *to));
        }
        Change::Repeat(from, to, times) => {
            let range = range(*from, *to);
            let piece = bytes[range.clone()].repeat(usize::from(*times));
            bytes.splice(range.end..range.end, piece);
        }
        Change::Number(at, odd) => {
            let from = place(*at);
            let digit = bytes[from..].iter().position(u8::is_ascii_digit);
            let Some(begin) = digit.map(|digit| from + digit) else {
                return bytes;
            };
            let belongs = |byte: &u8| byte.is_ascii_alphanumeric() || b".+-".contains(byte);
            let length = bytes[begin..]
                .iter()
                .take_while(|byte| belongs(byte))
                .count();
            bytes.splice(begin..begin + length, ODD[*odd].bytes());
        }
    }
    bytes
}

#[test]
fn every_file_of_the_corpus_is_accepted_or_refused_by_name() {
    for target in &targets::ALL {
        let corpus = corpus(target);
        assert!(!corpus.is_empty(), "{} has no corpus", target.name);
        for (path, bytes) in corpus {
            let run = catch_unwind(|| (target.run)(&bytes));
            assert!(run.is_ok(), "{}: see above", path.display());
        }
    }
}

#[test]
fn mutations_of_the_corpus_are_accepted_or_refused_by_name() {
    for target in &targets::ALL {
        let corpus: Vec<Vec<u8>> = corpus(target).into_iter().map(|(_, bytes)| bytes).collect();
        let input = (0..corpus.len(), prop::collection::vec(change(), 1..6));
        let config = Config {
            cases: CASES,
            // Deterministic cases: nothing to persist.
            failure_persistence: None,
            ..Config::default()
        };
        let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
        let run = TestRunner::new_with_rng(config, random).run(&input, |(seed, changes)| {
            (target.run)(&changes.iter().fold(corpus[seed].clone(), changed));
            Ok(())
        });
        run.unwrap_or_else(|error| panic!("{}: {error}", target.name));
    }
}

#[test]
fn inputs_of_any_size_are_accepted_or_refused_by_name() {
    let scenario = |rest: &str| format!("schema = 1\nname = \"x\"\n{rest}");
    let long = "x".repeat(10 << 20);
    #[rustfmt::skip] // a table
    let inputs: [(&str, String); 19] = [
        ("expression", "(".repeat(100_000)),
        ("expression", format!("{}1{}", "(".repeat(100_000), ")".repeat(100_000))),
        ("expression", format!("{}1", "-".repeat(100_000))),
        ("expression", format!("{}a < 1", "not ".repeat(100_000))),
        ("expression", format!("a < 1{}", " implies a < 1".repeat(20_000))),
        ("expression", format!("a{}", " + a".repeat(200_000))),
        ("expression", format!("a < 1{}", " and a < 1".repeat(100_000))),
        ("expression", long.clone()),
        ("scenario", scenario(&format!("description = \"{long}\""))),
        ("scenario", scenario(&format!("{long} = 1"))),
        ("scenario", scenario(&"[[faults]]\n".repeat(1_000_000))),
        ("scenario", scenario(&format!("faults = [{}]", "{},".repeat(1_000_000)))),
        ("scenario", scenario(&format!("run = {{{}}}", (0..100_000).map(|n| format!("k{n}=1,")).collect::<String>()))),
        ("scenario", scenario(&format!("a = {}", "[".repeat(100_000)))),
        ("scenario", scenario(&format!("{}b = 1", "b.".repeat(100_000)))),
        ("scenario", scenario(&format!("[{}b]", "b.".repeat(100_000)))),
        ("scenario", scenario(&format!("#--set {}b=1", "b.".repeat(100_000)))),
        ("scenario", scenario(&format!("#--set a={}", "[".repeat(100_000)))),
        ("fault", "[[faults]]\nkind = \"stuck\"\n".repeat(20_000)),
    ];
    for (name, input) in inputs {
        let target = target(name);
        let begin: String = input.chars().take(60).collect();
        println!("{name}: {begin:?}, {} bytes", input.len());
        (target.run)(input.as_bytes());
    }
}
