//! Robustness of all readers against a recording with a wrong byte or a truncated end: the recording is refused or read
//! as far as possible, without panics, hangs or allocations beyond the size of the file.

use std::path::Path;

use hil_benchmark::recorded;
use hil_recording::compression::Compression;
use hil_recording::reader::{RECORDING, RunReader, digest_of_first};
use hil_recording::writer::Attachment;

use crate::arguments::tolerance::Tolerances;
use crate::compare::compare;
use crate::fixture::{Content, chunked, layout, record, recorded, taken};
use crate::repetition::RecordedScenario;

/// Creates a file of each compression, with several chunks.
fn files() -> [(Compression, Vec<u8>); 3] {
    let contents = (0..24).flat_map(|step| {
        let event = (step % 8 == 4).then(|| Content::Event(taken(step)));
        let record = record(step, step as f64, -0.5);
        event.into_iter().chain([Content::Record(record)])
    });
    let contents: Vec<Content> = contents.collect();
    [Compression::None, Compression::Lz4, Compression::Zstd].map(|compression| {
        let note = Attachment {
            name: "note.txt",
            media_type: "text/plain",
            text: "a text".into(),
        };
        let folder = chunked(&layout(), &contents, vec![note], compression, 8);
        let bytes = std::fs::read(folder.join(RECORDING)).expect("read");
        (compression, bytes)
    })
}

/// Passes a file to every reader of recordings; returns `true` if the file is read to its end as complete.
fn read(path: &Path) -> bool {
    // Any result is fine, but no panic.
    let _ = compare(path, path, &[], &Tolerances::default());
    let _ = RecordedScenario::read(path).and_then(|run| run.scenario());
    let _ = recorded::case(path, 0);
    let _ = digest_of_first(path, 3);
    let Ok(mut reader) = RunReader::open(path) else {
        return false;
    };
    loop {
        match reader.advance() {
            Ok(true) => assert!(reader.records() <= 24, "more than were written"),
            Ok(false) => return reader.is_whole(),
            Err(error) => {
                let message = error.to_string();
                assert!(message.contains(&path.display().to_string()), "{message}");
                return false;
            }
        }
    }
}

#[test]
fn a_truncated_recording_never_passes_as_complete() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RECORDING);
    for (compression, bytes) in files() {
        for length in (0..bytes.len()).step_by(53) {
            std::fs::write(&path, &bytes[..length]).expect("written");
            assert!(!read(&path), "{compression:?}: {length} bytes");
        }
        std::fs::write(&path, &bytes).expect("written");
        assert!(read(&path), "{compression:?}");
    }
}

#[test]
fn a_recording_with_a_flipped_bit_never_passes_as_complete() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RECORDING);
    for (compression, bytes) in files() {
        for place in (0..bytes.len()).step_by(11) {
            // A low bit and the highest one, which makes lengths huge.
            let bit = [0, 7, 3, 5][place % 4];
            let mut wrong = bytes.clone();
            wrong[place] ^= 1 << bit;
            std::fs::write(&path, &wrong).expect("written");
            assert!(!read(&path), "{compression:?}: byte {place}, bit {bit}");
        }
    }
}

#[test]
fn a_damaged_attachment_is_reported_as_damage() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RECORDING);
    for (compression, mut bytes) in files() {
        let place = bytes.windows(6).position(|bytes| bytes == b"a text");
        bytes[place.expect("an attachment")] ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        let message = RunReader::open(&path).err().expect("refused").to_string();
        let all = [
            "is damaged at byte ",
            "before its first record: ",
            "copy it again",
        ];
        assert!(
            all.iter().all(|one| message.contains(one)),
            "{compression:?}: {message}"
        );
    }
}

#[test]
fn a_recording_with_trailing_bytes_never_passes_as_complete() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RECORDING);
    for (compression, bytes) in files() {
        for more in [&bytes[..], &bytes[..1], &[0; 4096]] {
            std::fs::write(&path, [&bytes, more].concat()).expect("written");
            assert!(!read(&path), "{compression:?}: {} bytes more", more.len());
        }
    }
}

#[test]
fn an_impossible_length_allocates_no_memory() {
    let contents: Vec<Content> = (0..10)
        .map(|step| Content::Record(record(step, 0.0, 0.0)))
        .collect();
    let folder = recorded(&layout(), &contents, vec![]);
    let path = folder.join(RECORDING);
    let bytes = std::fs::read(&path).expect("read");
    let summary = mcap::Summary::read(&bytes).expect("whole").expect("there");
    let chunk = summary.chunk_indexes[0].chunk_start_offset as usize;
    // The length of the chunk; its unpacked size; the length of the name of its compression; its packed size.
    for place in [chunk + 1, chunk + 25, chunk + 37, chunk + 44] {
        for length in [1_u64 << 27, 1 << 40, u64::MAX] {
            let mut wrong = bytes.clone();
            wrong[place..place + 8].copy_from_slice(&length.to_le_bytes());
            std::fs::write(&path, &wrong).expect("written");
            assert!(!read(&path), "byte {place}: {length}");
        }
    }
}
