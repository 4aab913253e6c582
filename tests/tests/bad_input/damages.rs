//! Damages of files, through every reader and, by [`crate::recover`], through every command.

use hil_recording::reader::RunReader;

use super::records::assert_modest;
use super::targets::recording::is_whole;
use super::{corpus, target};

/// Damages of any file, each of another kind.
pub(crate) fn of_any_file(bytes: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let mut flipped = bytes.to_vec();
    let middle = flipped.len() / 2;
    let end = flipped.len().min(middle + 64);
    (flipped[middle..end].iter_mut()).for_each(|byte| *byte = !*byte);
    vec![
        ("nothing", Vec::new()),
        ("the first bytes", bytes[..40.min(bytes.len())].to_vec()),
        ("half", bytes[..middle].to_vec()),
        ("flipped bits", flipped),
        ("text", b"this is no such file\n".to_vec()),
        ("zeros", vec![0; 4096]),
    ]
}

/// Damages at places all over a recording: a truncated end, a flipped bit, surplus bytes, an impossible length.
fn of_a_recording(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut damages = Vec::new();
    let mut add = |what: String, bytes: Vec<u8>| damages.push((what, bytes));
    for length in (0..bytes.len()).step_by(53) {
        add(format!("{length} bytes"), bytes[..length].to_vec());
    }
    for place in (0..bytes.len()).step_by(23) {
        // A low bit and the highest one, which makes lengths huge.
        let bit = [0, 7, 3, 5][place % 4];
        let mut wrong = bytes.to_vec();
        wrong[place] ^= 1 << bit;
        add(format!("byte {place}, bit {bit}"), wrong);
    }
    for more in [bytes, &bytes[..1], &[0; 4096]] {
        add(format!("{} bytes more", more.len()), [bytes, more].concat());
    }
    let summary = mcap::Summary::read(bytes).expect("whole").expect("there");
    let chunk = summary.chunk_indexes[0].chunk_start_offset as usize;
    // The length of the chunk; its unpacked size; the length of the name of its compression; its packed size.
    for place in [chunk + 1, chunk + 25, chunk + 37, chunk + 44] {
        for length in [1_u64 << 27, 1 << 40, u64::MAX] {
            let mut wrong = bytes.to_vec();
            wrong[place..place + 8].copy_from_slice(&length.to_le_bytes());
            add(format!("byte {place}: {length}"), wrong);
        }
    }
    damages
}

/// Returns the recordings of the corpus, of each compression.
fn recordings() -> Vec<(String, Vec<u8>)> {
    let corpus = corpus(target("recording")).into_iter();
    let named = corpus.map(|(path, bytes)| (path.display().to_string(), bytes));
    let recordings: Vec<_> = named.filter(|(name, _)| name.ends_with(".mcap")).collect();
    assert_eq!(recordings.len(), 3);
    recordings
}

#[test]
fn no_damaged_recording_passes_as_complete() {
    for (name, bytes) in recordings() {
        assert!(is_whole(&bytes), "{name}");
        for (damage, bytes) in of_a_recording(&bytes) {
            let mut passes = true;
            assert_modest(&damage, || passes = is_whole(&bytes));
            assert!(!passes, "{name}: {damage}");
        }
    }
}

#[test]
fn a_damaged_attachment_is_reported_as_damage() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    for (name, mut bytes) in recordings() {
        let place = bytes.windows(6).position(|bytes| bytes == b"schema");
        bytes[place.expect("a scenario")] ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        let message = RunReader::open(&path).err().expect("refused").to_string();
        for part in [
            "is damaged at byte ",
            "before its first record: ",
            "copy it again",
        ] {
            assert!(message.contains(part), "{name}: {message}");
        }
    }
}
