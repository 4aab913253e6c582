//! Bit errors in a recording without an end are detected, or all possibly affected data is marked.
//!
//! File content is read by the `mcap` crate, to which marks are unknown.

use std::collections::{BTreeMap, BTreeSet};

use hil_recording::compression::Compression;
use hil_recording::reader::{RECORDING, RunReader};

use super::tests::{COMPRESSIONS, Original, messages};
use super::*;

/// Bit flips in compressed bytes per compression in the regular test; the ignored test has more.
const FLIPS: usize = 60;
const ALL_FLIPS: usize = 1000;

/// Facts, signals and messages in a file.
#[derive(Debug, PartialEq)]
struct Content {
    facts: BTreeMap<String, String>,
    signals: Vec<(String, String)>,
    messages: Vec<(String, u64, Vec<u8>)>,
    /// Number of records covered by checksums; `None` for all.
    vouched: Option<usize>,
}

impl Content {
    fn by(path: &Path) -> Self {
        let mut reader = RunReader::open(path).expect("opens");
        while reader.advance().expect("reads") {}
        assert!(reader.is_whole());
        let own = |(name, fact): (&str, &str)| (name.to_owned(), fact.to_owned());
        let mut facts: BTreeMap<String, String> = reader.facts().map(own).collect();
        let vouched = facts.remove("vouched_records");
        assert_eq!(vouched.is_some(), facts.remove("unvouched").is_some());
        let columns = reader.columns().iter();
        Self {
            facts,
            signals: columns
                .map(|one| (one.name.clone(), one.unit.clone()))
                .collect(),
            messages: messages(path),
            vouched: vouched.map(|text| text.parse().expect("a number")),
        }
    }

    fn records(&self) -> impl Iterator<Item = &(String, u64, Vec<u8>)> {
        (self.messages.iter()).filter(|(topic, ..)| topic == "/record")
    }

    /// Asserts that all unmarked content equals the original.
    fn assert_true(&self, original: &Self, about: &str) {
        let Some(vouched) = self.vouched else {
            assert_eq!(self.facts, original.facts, "{about}");
            assert_eq!(self.signals, original.signals, "{about}");
            assert!(original.messages.starts_with(&self.messages), "{about}");
            return;
        };
        if vouched > 0 {
            assert_eq!(self.facts, original.facts, "{about}");
            assert_eq!(self.signals, original.signals, "{about}");
        }
        assert!(vouched <= self.records().count(), "{about}");
        let same = original.records().zip(self.records()).take(vouched);
        assert!(same.into_iter().all(|(a, b)| a == b), "{about}");
    }
}

/// Numbers of recoveries of files with a flipped bit, by result.
#[derive(Debug, Default, PartialEq)]
struct Tally {
    refused: usize,
    marked: usize,
    /// Number of recoveries whose result equals that without the flip.
    unmarked: usize,
}

/// Flips a bit in each of these places of a file and recovers the file.
fn flipped(original: &Original, bytes: &[u8], places: &BTreeSet<(usize, u8)>) -> Tally {
    let sound = Content::by(&original.folder.join(RECORDING));
    let elsewhere = original.folder.join("elsewhere.mcap");
    let mut became = Tally::default();
    for (place, bit) in places {
        let mut wrong = bytes.to_vec();
        wrong[*place] ^= 1 << bit;
        let path = original.with(&wrong);
        let about = format!("byte {place} of {}, bit {bit}", bytes.len());
        let Ok(recovered) = recovered(&path, None) else {
            let is_there = std::fs::read(&path).expect("read") == wrong;
            assert!(is_there, "{about}: refused, and changed nevertheless");
            if super::recovered(&path, Some(&elsewhere)).is_ok() {
                Content::by(&elsewhere).assert_true(&sound, &about);
                std::fs::remove_file(&elsewhere).expect("removed");
            }
            became.refused += 1;
            continue;
        };
        assert_eq!(recovered.state, State::BrokenOff, "{about}");
        let content = Content::by(&path);
        content.assert_true(&sound, &about);
        match content.vouched {
            Some(_) => became.marked += 1,
            None => became.unmarked += 1,
        }
    }
    became
}

/// Selects pseudo-random places in ranges of bytes by a seed (xorshift).
fn places(ranges: &[(usize, usize)], count: usize, seed: u64) -> BTreeSet<(usize, u8)> {
    let mut state = seed;
    let mut random = |bound: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % bound
    };
    let total: usize = ranges.iter().map(|(from, to)| to - from).sum();
    let mut places = BTreeSet::new();
    while places.len() < count.min(8 * total) {
        let mut at = random(total);
        let place = ranges.iter().find_map(|(from, to)| {
            let length = to - from;
            (at < length).then_some(from + at).or_else(|| {
                at -= length;
                None
            })
        });
        places.insert((place.expect("in one of them"), random(8) as u8));
    }
    places
}

/// Returns the byte ranges of the compressed chunks of a file.
fn packed(original: &Original) -> Vec<(usize, usize)> {
    let summary = mcap::Summary::read(&original.bytes).expect("whole");
    let chunks = summary.expect("there").chunk_indexes;
    let place = |chunk: &mcap::records::ChunkIndex| {
        let from = chunk.compressed_data_offset().expect("in the file") as usize;
        (from, from + chunk.compressed_size as usize)
    };
    chunks.iter().map(place).collect()
}

fn in_packed_bytes(count: usize) {
    for (seed, compression) in (1..).zip(COMPRESSIONS) {
        let original = Original::new(compression);
        let bytes = &original.bytes[..original.end_of_chunks()];
        let places = places(&packed(&original), count, seed);
        let became = flipped(&original, bytes, &places);
        println!("{compression:?}: {} flips, {became:?}", places.len());
        assert_eq!(became.unmarked, 0, "{compression:?}: {became:?}");
    }
}

#[test]
fn no_flipped_bit_in_a_chunk_goes_unmarked() {
    in_packed_bytes(FLIPS);
}

#[test]
#[ignore = "takes minutes; run it after a change of the format or of recovery"]
fn none_of_a_thousand_flipped_bits_in_a_chunk_goes_unmarked() {
    in_packed_bytes(ALL_FLIPS);
}

#[test]
fn no_flipped_bit_makes_a_recovered_file_claim_false_content() {
    for (seed, compression) in (1..).zip(COMPRESSIONS) {
        let original = Original::new(compression);
        let end = original.end_of_chunks();
        // Complete, and with a truncated chunk at its end.
        for end in [end, packed(&original)[2].1 - 300] {
            let bytes = &original.bytes[..end];
            let became = flipped(&original, bytes, &places(&[(0, end)], 3 * FLIPS, seed));
            println!("{compression:?}, {end} bytes: {became:?}");
        }
    }
}

/// Returns the file as written by versions without marks and chunk checksums, up to the end of its chunks.
fn older(original: &Original) -> Vec<u8> {
    let mut rest = &original.bytes[mcap::MAGIC.len()..original.end_of_chunks()];
    let mut older = mcap::MAGIC.to_vec();
    while let Some((head, behind)) = rest.split_at_checked(9) {
        let length = u64::from_le_bytes(head[1..].try_into().expect("8 bytes")) as usize;
        let mut content = behind[..length].to_vec();
        if head[0] == mcap::records::op::CHUNK {
            // Two times and a size precede it.
            content[24..28].fill(0);
        }
        if head[0] < 0x80 {
            older.extend_from_slice(head);
            older.extend_from_slice(&content);
        }
        rest = &behind[length..];
    }
    older
}

/// Recovers a recording; returns the result, its text form and the content of the new file.
fn describe(path: &Path) -> (Recovered, String, Content) {
    let recovered = recovered(path, None).expect("recovered");
    let text = recovered.describe();
    let content = Content::by(path);
    let vouched = content.vouched.map(|vouched| vouched as u64);
    assert_eq!(
        vouched.unwrap_or(recovered.records),
        recovered.vouched_records
    );
    assert_eq!(vouched.is_some(), recovered.unvouched.is_some());
    (recovered, text, content)
}

#[test]
fn a_file_of_an_older_version_is_recovered_and_entirely_marked() {
    for compression in COMPRESSIONS {
        let original = Original::new(compression);
        let path = original.with(&older(&original));
        let mut reader = RunReader::open(&path).expect("it stays readable");
        while reader.advance().expect("it stays readable") {}
        let caveat = reader.caveat().expect("it broke off");
        let nothing = "no checksum covers its records or its facts about the run";
        assert!(caveat.contains(nothing), "{caveat}");
        let (recovered, text, content) = describe(&path);
        assert_eq!((recovered.records, recovered.vouched_records), (60, 0));
        assert!(text.contains(nothing), "{text}");
        assert!(recovered.reason.expect("a reason").contains(nothing));
        assert_eq!(content.vouched, Some(0));
        // Readers of the new file see the note too.
        let mut reader = RunReader::open(&path).expect("opens");
        while reader.advance().expect("reads") {}
        let caveat = reader.caveat().expect("told");
        assert!(
            caveat.contains("was recovered") && caveat.contains(nothing),
            "{caveat}"
        );
    }
}

#[test]
fn records_of_a_torn_chunk_stay_marked_after_a_second_truncation() {
    for compression in [Compression::None, Compression::Lz4] {
        let original = Original::new(compression);
        let torn = packed(&original)[2];
        let path = original.with(&original.bytes[..usize::midpoint(torn.0, torn.1)]);
        let (recovered, text, _) = describe(&path);
        assert!(
            recovered.records > 40,
            "{compression:?}: {}",
            recovered.records
        );
        assert_eq!(recovered.vouched_records, 40, "{compression:?}");
        let first = "checksums cover only its first 40 records";
        assert!(text.contains(first), "{text}");
        // The new checksums cover the records that the old ones did not.
        let again = std::fs::read(&path).expect("read");
        let path = original.with(&again[..again.len() - 1000]);
        let (recovered, text, _) = describe(&path);
        assert_eq!(recovered.vouched_records, 40, "{compression:?}");
        assert!(text.contains(first), "{text}");
    }
}

#[test]
fn checksums_cover_a_file_up_to_its_truncation_after_one() {
    for compression in COMPRESSIONS {
        let original = Original::new(compression);
        let mark = 21;
        for (cut, vouched) in [(mark, None), (mark - 1, Some(40)), (0, Some(40))] {
            let path = original.with(&original.bytes[..original.end_of_chunks() + cut]);
            let (recovered, _, content) = describe(&path);
            assert_eq!(
                (recovered.records, content.vouched),
                (60, vouched),
                "{compression:?}"
            );
        }
    }
}

#[test]
fn a_length_beyond_the_end_counts_as_damage_if_records_follow() {
    for compression in COMPRESSIONS {
        let original = Original::new(compression);
        let (first, _) = original.chunks()[0];
        // The length of the message index after the first chunk.
        let mut bytes = original.bytes[..original.end_of_chunks()].to_vec();
        bytes[first + 3] ^= 1;
        let path = original.with(&bytes);
        let refused = recovered(&path, None).expect_err("refused").to_string();
        assert!(
            refused.contains("the length of a record is wrong"),
            "{refused}"
        );
        assert!(std::fs::read(&path).expect("read") == bytes);
    }
}
