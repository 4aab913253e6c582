//! Content of a written file, as read by the `mcap` crate.

use std::path::PathBuf;

use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use shared_types::record::{FaultEnded, Timing};
use shared_types::table::Field;
use tempfile::TempDir;

use super::*;

const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

fn layout() -> RecordLayout {
    let field = |name: &str| Field::signal(name, "rad", "x");
    RecordLayout {
        truth: vec![field("a_rad"), field("b_rad")],
        measured: vec![field("a_rad")],
        command_signals: 1,
        ..RecordLayout::default()
    }
}

/// Returns the words of a step: some change, some do not, and one occurs twice.
fn words(step: u64) -> Vec<u64> {
    let mut words = vec![0; layout().words()];
    let start = layout().values_start();
    words[0] = step;
    words[start] = (0.1 * step as f64).sqrt().to_bits();
    words[start + 2] = words[start];
    let timing = words.len() - Timing::WORDS;
    words[timing] = 1000 * step;
    words[timing + 4] = 77_000 + 13 * step;
    words
}

fn event(id: u32) -> Event {
    Event::FaultEnded(FaultEnded {
        id,
        effect: 0,
        step: id.into(),
        cleared: false,
    })
}

struct File {
    _folder: TempDir,
    path: PathBuf,
}

/// Writes records in chunks of a hundred, with an event before each fiftieth.
fn recorded_file(compression: Compression, records: u64) -> File {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run.mcap");
    let provenance = Provenance {
        facts: BTreeMap::from([("fact".into(), "true".into())]),
        attachments: vec![Attachment {
            name: "scenario.toml",
            media_type: "text/plain",
            text: "content".into(),
        }],
    };
    let layout = layout();
    let mut recording =
        Recording::create(&path, compression, &layout, &provenance, None).expect("creates");
    for step in 0..records {
        if step % 50 == 0 {
            recording
                .event(&event(step as u32), None, step)
                .expect("writes");
        }
        let words = words(step);
        recording
            .record(&words, &layout.view(&words))
            .expect("writes");
        recording.close_if(step % 100 == 99).expect("writes");
    }
    let result = BTreeMap::from([("outcome".into(), "completed".into())]);
    recording.finish(result).expect("finishes");
    File {
        _folder: folder,
        path,
    }
}

/// Returns topic, time and content of each message in a complete or truncated file.
fn messages(bytes: &[u8]) -> Vec<(String, u64, Vec<u8>)> {
    let whatever_the_end = mcap::read::Options::IgnoreEndMagic.into();
    let stream = mcap::MessageStream::new_with_options(bytes, whatever_the_end);
    stream
        .expect("an MCAP file")
        .map_while(Result::ok)
        .map(|m| (m.channel.topic.clone(), m.log_time, m.data.into_owned()))
        .collect()
}

fn expected(records: u64) -> Vec<(String, u64, Vec<u8>)> {
    let mut messages = Vec::new();
    for step in 0..records {
        if step % 50 == 0 {
            let message = event::message(&event(step as u32)).expect("a message");
            let last_ns = 1000 * step.saturating_sub(1);
            messages.push(("/events".into(), last_ns, message));
        }
        let words = words(step).into_iter().flat_map(u64::to_le_bytes);
        let data = [0, 1, 0, 0].into_iter().chain(words).collect();
        messages.push(("/record".into(), 1000 * step, data));
    }
    messages
}

#[test]
fn every_compression_preserves_all_messages_in_order() {
    for compression in COMPRESSIONS {
        let file = recorded_file(compression, 1234);
        let bytes = std::fs::read(&file.path).expect("a file");
        assert!(messages(&bytes) == expected(1234), "{compression:?}");
    }
}

#[test]
fn the_summary_locates_all_records() {
    for compression in COMPRESSIONS {
        let file = recorded_file(compression, 1234);
        let bytes = std::fs::read(&file.path).expect("a file");
        let summary = mcap::Summary::read(&bytes).expect("whole").expect("there");
        let statistics = summary.stats.as_ref().expect("statistics");
        let counts = &statistics.channel_message_counts;
        assert_eq!(counts, &BTreeMap::from([(1, 1234), (2, 25)]));
        assert_eq!(statistics.message_count, 1259);
        assert_eq!(
            (statistics.message_start_time, statistics.message_end_time),
            (0, 1_233_000)
        );
        assert_eq!((statistics.schema_count, statistics.channel_count), (2, 2));
        assert_eq!(
            (statistics.attachment_count, statistics.metadata_count),
            (1, 2)
        );
        assert_eq!(
            (statistics.chunk_count, summary.chunk_indexes.len()),
            (13, 13)
        );
        let mut count = 0;
        for chunk in &summary.chunk_indexes {
            for (channel, entries) in summary.read_message_indexes(&bytes, chunk).expect("read") {
                for entry in entries {
                    let message = summary.seek_message(&bytes, chunk, &entry).expect("there");
                    assert_eq!(message.log_time, entry.log_time);
                    assert_eq!(message.channel.topic, channel.topic);
                    count += 1;
                }
            }
        }
        assert_eq!(count, 1259);
        let names = summary.metadata_indexes.iter().map(|index| {
            let metadata = mcap::read::metadata(&bytes, index).expect("metadata");
            (metadata.name, metadata.metadata.len())
        });
        assert!(names.eq([("hil.run".into(), 1), ("hil.result".into(), 1)]));
        let file = &summary.attachment_indexes[0];
        let attachment = mcap::read::attachment(&bytes, file).expect("an attachment");
        assert_eq!(attachment.data.as_ref(), b"content");
    }
}

#[test]
fn a_reader_that_verifies_every_check_sum_accepts_the_file() {
    let whole = |bytes: &[u8]| {
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true);
        let mut reader = LinearReader::new_with_options(options);
        let mut rest = bytes;
        while let Some(event) = reader.next_event() {
            match event? {
                LinearReadEvent::ReadRequest(size) => {
                    let count = size.min(rest.len());
                    reader.insert(size)[..count].copy_from_slice(&rest[..count]);
                    reader.notify_read(count);
                    rest = &rest[count..];
                }
                LinearReadEvent::Record { opcode, data } => {
                    mcap::parse_record(opcode, data)?;
                }
            }
        }
        mcap::McapResult::Ok(())
    };
    for compression in COMPRESSIONS {
        let file = recorded_file(compression, 1000);
        let mut bytes = std::fs::read(&file.path).expect("a file");
        whole(&bytes).expect("every sum is right");
        let records = mcap::read::LinearReader::new(&bytes).expect("whole");
        let chunks = records.filter_map(|record| match record.expect("right") {
            mcap::records::Record::Chunk { header, .. } => Some(header.uncompressed_crc),
            _ => None,
        });
        let sums: Vec<u32> = chunks.collect();
        // The value 0 means that there is no checksum.
        assert!(
            sums.len() == 10 && !sums.contains(&0),
            "{compression:?}: {sums:?}"
        );
        let place = bytes.len() / 3;
        bytes[place] ^= 1;
        assert!(
            whole(&bytes).is_err(),
            "{compression:?}: a flipped bit shows"
        );
    }
}

#[test]
fn a_truncated_file_contains_everything_up_to_its_last_complete_chunk() {
    for compression in COMPRESSIONS {
        let file = recorded_file(compression, 500);
        let bytes = std::fs::read(&file.path).expect("a file");
        let summary = mcap::Summary::read(&bytes).expect("whole").expect("there");
        let expected = expected(500);
        let ends = summary.chunk_indexes.iter().map(|chunk| {
            let end = chunk.chunk_start_offset + chunk.chunk_length;
            (end as usize, chunk.message_end_time)
        });
        let ends: Vec<_> = ends.collect();
        for cut in (ends[0].0..bytes.len()).step_by(311) {
            let read = messages(&bytes[..cut]);
            let whole = ends
                .iter()
                .rfind(|(end, _)| *end <= cut)
                .expect("the first");
            let count = expected
                .iter()
                .take_while(|(_, ns, _)| *ns <= whole.1)
                .count();
            // The event before the next record has the time of the previous record.
            assert!(read.len() + 1 >= count, "{compression:?} cut at {cut}");
            assert!(
                read[..] == expected[..read.len()],
                "{compression:?} cut at {cut}"
            );
        }
    }
}

#[test]
fn a_chunk_is_closed_when_it_is_old_or_full() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("run.mcap");
    let layout = layout();
    let compression = Compression::Lz4;
    let recording = Recording::create(&path, compression, &layout, &Provenance::default(), None);
    let mut recording = recording.expect("creates");
    let on_disk = || {
        let bytes = std::fs::read(&path).expect("a file");
        messages(&bytes).len()
    };
    let mut step = 0;
    let mut put = |recording: &mut Recording| {
        let words = words(step);
        recording
            .record(&words, &layout.view(&words))
            .expect("writes");
        step += 1;
    };
    put(&mut recording);
    assert_eq!(on_disk(), 0);
    std::thread::sleep(CHUNK_TIME);
    recording.keep_up().expect("writes");
    assert_eq!(on_disk(), 1);
    let bytes = HEAD_AND_ENCAPSULATION_BYTES + 8 * layout.words();
    for _ in 0..CHUNK_BYTES.div_ceil(bytes) {
        assert_eq!(on_disk(), 1);
        put(&mut recording);
    }
    assert_eq!(on_disk(), 1 + CHUNK_BYTES.div_ceil(bytes));
}

/// Opcode, length, channel, sequence number, two times; CDR encapsulation.
const HEAD_AND_ENCAPSULATION_BYTES: usize = 1 + 8 + 2 + 4 + 8 + 8 + 4;

#[test]
fn a_chunk_can_be_written_again_after_an_error() {
    for compression in COMPRESSIONS {
        let mut chunk = Chunk::new(compression, CHANNELS).expect("a chunk");
        for step in 0..100 {
            let words = words(step);
            let head = Head::of(&layout().view(&words));
            chunk.record(&header(1, head), &words);
        }
        let [first, again] = [(); 2].map(|()| chunk.packed().expect("packed").into_owned());
        assert!(first == again, "{compression:?}");
    }
}

#[test]
fn a_full_disk_gives_a_clear_error() {
    let path = Path::new("/dev/full");
    let provenance = Provenance::default();
    let created = Recording::create(path, Compression::Lz4, &layout(), &provenance, None);
    let error = created.err().expect("no room");
    assert_eq!(error.kind(), io::ErrorKind::StorageFull);
}
