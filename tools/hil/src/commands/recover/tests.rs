//! Recordings truncated at every byte, and their recoveries.

use std::path::PathBuf;

use hil_recording::reader::{RECORDING, RunReader};
use shared_types::record::Event;

use hil_recording::compression::Compression;

use super::*;
use crate::fixture::{Content, Folder, chunked, layout, record, taken};

const RECORDS: u64 = 60;
pub(super) const COMPRESSIONS: [Compression; 3] =
    [Compression::None, Compression::Lz4, Compression::Zstd];

/// Recording of a run with a fault at step 7, in chunks of twenty records.
pub(super) struct Original {
    pub(super) folder: Folder,
    pub(super) bytes: Vec<u8>,
}

impl Original {
    pub(super) fn new(compression: Compression) -> Self {
        let contents = (0..RECORDS).flat_map(|step| {
            let event = (step == 7).then(|| Content::Event(taken(7)));
            event.into_iter().chain([Content::Record(words(step))])
        });
        let contents: Vec<Content> = contents.collect();
        let folder = chunked(&layout(), &contents, vec![], compression, 20);
        let bytes = std::fs::read(folder.join(RECORDING)).expect("read");
        Self { folder, bytes }
    }

    /// Returns the path of a file with these bytes.
    pub(super) fn with(&self, bytes: &[u8]) -> PathBuf {
        let path = self.folder.join("broken.mcap");
        std::fs::write(&path, bytes).expect("written");
        path
    }

    /// Returns the offset of the end of the last chunk with its message indexes.
    pub(super) fn end_of_chunks(&self) -> usize {
        let summary = mcap::Summary::read(&self.bytes).expect("whole");
        let chunks = summary.expect("there").chunk_indexes;
        let last = chunks.last().expect("chunks");
        (last.chunk_start_offset + last.chunk_length + last.message_index_length) as usize
    }

    /// Returns the end of each chunk and the number of records up to it.
    pub(super) fn chunks(&self) -> Vec<(usize, u64)> {
        let summary = mcap::Summary::read(&self.bytes).expect("whole");
        let chunks = summary.expect("there").chunk_indexes;
        let ends = chunks
            .iter()
            .map(|chunk| (chunk.chunk_start_offset + chunk.chunk_length) as usize);
        ends.zip([20, 40, 60]).collect()
    }
}

fn words(step: u64) -> Vec<u64> {
    record(step, libm::sin(step as f64), 0.5 * step as f64)
}

/// Computes the digest by its definition: seven words of each record, with the fault before the record of its step,
/// or after the last one.
fn digest(records: u64, messages: usize) -> String {
    let mut hasher = blake3::Hasher::new();
    let has_fault = messages as u64 > records;
    for step in 0..=records {
        if step == 7 && has_fault {
            let text = "7 bias measured.x_m x_m bias=0 step";
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        }
        if step == records {
            break;
        }
        for word in &words(step)[..7] {
            hasher.update(&word.to_le_bytes());
        }
    }
    hasher.finalize().to_hex().to_string()
}

/// Returns all messages of a file, read by an independent library.
pub(super) fn messages(path: &Path) -> Vec<(String, u64, Vec<u8>)> {
    let bytes = std::fs::read(path).expect("read");
    let stream = mcap::MessageStream::new(&bytes).expect("a whole file");
    let messages = stream.map(|message| message.expect("whole"));
    messages
        .map(|m| (m.channel.topic.clone(), m.log_time, m.data.into_owned()))
        .collect()
}

#[test]
fn every_record_before_the_truncation_is_kept() {
    for compression in COMPRESSIONS {
        let original = Original::new(compression);
        let all = messages(&original.folder.join(RECORDING));
        let chunks = original.chunks();
        let begin = mcap::Summary::read(&original.bytes)
            .expect("whole")
            .expect("there")
            .chunk_indexes[0]
            .chunk_start_offset as usize;
        for cut in (begin + 200..original.bytes.len()).step_by(53) {
            let path = original.with(&original.bytes[..cut]);
            let sure = chunks.iter().rfind(|(end, _)| *end <= cut);
            let sure = sure.map_or(0, |(_, records)| *records);
            let about = format!("{compression:?} cut at {cut}");
            let recovered = match recovered(&path, None) {
                Ok(recovered) => recovered,
                // A zstd block is readable only if it is complete.
                Err(_) if sure == 0 => continue,
                Err(error) => panic!("{about}: {error}"),
            };
            assert_eq!(recovered.state, State::BrokenOff, "{about}");
            assert!(recovered.records >= sure, "{about}");
            let kept_messages = messages(&path);
            assert!(all.starts_with(&kept_messages), "{about}");
            assert!(kept_messages.len() as u64 >= recovered.records, "{about}");
            let digest = digest(recovered.records, kept_messages.len());
            assert_eq!(recovered.digest.as_ref(), Some(&digest), "{about}");
            let mut reader = RunReader::open(&path).expect("opens");
            while reader.advance().expect("reads") {}
            assert!(reader.is_whole(), "{about}");
            let outcome = reader.result("outcome");
            let reason = reader.result("reason").unwrap_or_default();
            if recovered.reason.is_some() {
                assert_eq!(outcome, Some("failed"), "{about}");
                assert!(reason.starts_with("recovered: "), "{about}: {reason}");
                assert_eq!(reader.result("digest"), Some(&*digest), "{about}");
            } else {
                // Truncated after the recorder's end message.
                assert_eq!(outcome, Some("completed"), "{about}");
                assert_eq!(recovered.records, RECORDS, "{about}");
            }
            let again = super::recovered(&path, None).expect("whole");
            assert_eq!((again.state, again.file), (State::Whole, None), "{about}");
        }
    }
}

#[test]
fn records_in_a_torn_chunk_are_recovered_too() {
    for compression in [Compression::None, Compression::Lz4] {
        let original = Original::new(compression);
        let chunks = original.chunks();
        let middle = usize::midpoint(chunks[0].0, chunks[1].0);
        let recovered = recovered(&original.with(&original.bytes[..middle]), None);
        let records = recovered.expect("recovered").records;
        assert!(records > 20 && records < 40, "{compression:?}: {records}");
    }
}

#[test]
fn a_complete_file_is_left_alone() {
    let original = Original::new(Compression::Lz4);
    let path = original.folder.join(RECORDING);
    let elsewhere = original.folder.join("elsewhere.mcap");
    for output in [None, Some(&*elsewhere)] {
        let recovered = recovered(&path, output).expect("whole");
        assert_eq!((recovered.state, recovered.file), (State::Whole, None));
        assert!(std::fs::read(&path).expect("read") == original.bytes);
        assert!(!elsewhere.exists());
    }
}

#[test]
fn a_file_damaged_before_its_end_is_recovered_only_to_another_file() {
    let original = Original::new(Compression::Lz4);
    let mut bytes = original.bytes.clone();
    // The length of a record in the second chunk, or its compressed data.
    let place = original.chunks()[0].0 + 400;
    bytes[place..place + 200].fill(0xff);
    let path = original.with(&bytes);
    let elsewhere = original.folder.join("elsewhere.mcap");
    let refused = recovered(&path, None).expect_err("refused").to_string();
    assert!(refused.contains("is not replaced"), "{refused}");
    assert!(refused.contains("after 20 records"), "{refused}");
    assert!(refused.contains("-o FILE"), "{refused}");
    assert!(std::fs::read(&path).expect("read") == bytes);
    let recovered = recovered(&path, Some(&elsewhere)).expect("recovered");
    assert_eq!((recovered.state, recovered.records), (State::Damaged, 20));
    assert_eq!(recovered.digest, Some(digest(20, 21)));
    assert!(std::fs::read(&path).expect("read") == bytes);
    let refused = super::recovered(&path, Some(&elsewhere)).err();
    let refused = refused.expect("refused").to_string();
    assert!(refused.contains("already exists"), "{refused}");
}

#[test]
fn an_unrecoverable_file_is_left_alone_and_named() {
    let original = Original::new(Compression::Lz4);
    for (bytes, why) in [
        (&original.bytes[..0], "before its first record"),
        (&original.bytes[..5], "before its first record"),
        (
            &b"not a recording, whatever its name is"[..],
            "does not begin with the magic bytes of MCAP",
        ),
        (&original.bytes[..400], "before its first record"),
    ] {
        let path = original.with(bytes);
        let error = recovered(&path, None).expect_err("refused").to_string();
        let path_text = path.display().to_string();
        assert!(error.contains(&path_text) && error.contains(why), "{error}");
        assert!(std::fs::read(&path).expect("read") == bytes);
    }
}

#[test]
fn zeros_after_the_last_record_count_as_truncation() {
    // Left by a power failure: the length was on disk, but not yet the content.
    let original = Original::new(Compression::Zstd);
    let (end, records) = original.chunks()[1];
    let mut bytes = original.bytes[..end].to_vec();
    bytes.resize(end + 5000, 0);
    let recovered = recovered(&original.with(&bytes), None).expect("recovered");
    assert_eq!(
        (recovered.state, recovered.records),
        (State::BrokenOff, records)
    );
}

#[test]
fn events_between_records_are_kept() {
    let original = Original::new(Compression::None);
    let (end, _) = original.chunks()[0];
    let path = original.with(&original.bytes[..end]);
    recovered(&path, None).expect("recovered");
    let mut reader = RunReader::open(&path).expect("opens");
    let mut events: Vec<(u64, Event)> = Vec::new();
    while reader.advance().expect("reads") {
        let step = reader.step();
        events.extend(reader.events().iter().map(|event| (step, event.clone())));
    }
    assert_eq!(events, [(7, taken(7))]);
}
