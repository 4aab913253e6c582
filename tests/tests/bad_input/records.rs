//! Records of a recording that are shorter than their stated length, of every type and length, outside of chunks
//! and inside: each is accepted or refused with the file's name, without allocating more memory than its size.

use allocation_counter::measure;
use mcap::records::op;

use super::targets::recording;

/// Lengths that no record has.
const HUGE: [u64; 4] = [1 << 27, 1 << 32, 1 << 63, u64::MAX];
/// Maximum number of bytes that a reader may allocate for a file of some hundred bytes.
const MOST_BYTES: u64 = 32 << 20;

/// Encodes a text or a byte list with its length.
fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

fn map(key: &str, value: &str) -> Vec<u8> {
    let pair = [text(key), text(value)].concat();
    [&(pair.len() as u32).to_le_bytes()[..], &pair].concat()
}

fn record(opcode: u8, length: u64, content: &[u8]) -> Vec<u8> {
    [&[opcode][..], &length.to_le_bytes(), content].concat()
}

fn chunk(content: &[u8]) -> Vec<u8> {
    let size = (content.len() as u64).to_le_bytes();
    [&[0; 16][..], &size, &[0; 4], &text(""), &size, content].concat()
}

/// Returns the content of a valid record of every type, by the format, and the positions of its lengths.
fn contents() -> Vec<(&'static str, u8, Vec<u8>)> {
    let bytes = |count: usize| vec![0; count];
    let schema =
        "uint64 step\nhil_msgs/msg/Truth truth\n===\nMSG: hil_msgs/msg/Truth\nfloat64 x_m # [m]\n";
    let attachment = [
        bytes(16),
        text("a.txt"),
        text("text/plain"),
        bytes(8),
        bytes(4),
    ]
    .concat();
    vec![
        ("header", op::HEADER, [text("ros2"), text("hil")].concat()),
        ("footer", op::FOOTER, bytes(20)),
        (
            "schema",
            op::SCHEMA,
            [vec![1, 0], text("Record"), text("ros2msg"), text(schema)].concat(),
        ),
        (
            "channel",
            op::CHANNEL,
            [
                vec![1, 0, 1, 0],
                text("/events"),
                text("cdr"),
                map("version", "4"),
            ]
            .concat(),
        ),
        (
            "message",
            op::MESSAGE,
            [vec![1, 0], bytes(20), bytes(20)].concat(),
        ),
        (
            "chunk",
            op::CHUNK,
            chunk(&record(op::MESSAGE, 30, &bytes(30))),
        ),
        (
            "message index",
            op::MESSAGE_INDEX,
            [vec![1, 0, 16, 0, 0, 0], bytes(16)].concat(),
        ),
        (
            "chunk index",
            op::CHUNK_INDEX,
            [
                bytes(32),
                vec![10, 0, 0, 0],
                bytes(10),
                bytes(8),
                text("lz4"),
                bytes(16),
            ]
            .concat(),
        ),
        ("attachment", op::ATTACHMENT, attachment),
        (
            "attachment index",
            op::ATTACHMENT_INDEX,
            [bytes(40), text("a.txt"), text("text/plain")].concat(),
        ),
        (
            "statistics",
            op::STATISTICS,
            [bytes(42), vec![10, 0, 0, 0], bytes(10)].concat(),
        ),
        (
            "metadata",
            op::METADATA,
            [text("hil.run"), map("rate_hz", "1000")].concat(),
        ),
        (
            "metadata index",
            op::METADATA_INDEX,
            [bytes(16), text("hil.run")].concat(),
        ),
        ("summary offset", op::SUMMARY_OFFSET, bytes(17)),
        ("data end", op::DATA_END, bytes(4)),
        ("private", 0xb5, bytes(12)),
        ("none", 0, bytes(20)),
    ]
}

/// Builds a file that begins like a recording, followed by these bytes.
fn file(bytes: &[u8]) -> Vec<u8> {
    let mut file = mcap::MAGIC.to_vec();
    let all = contents();
    for name in ["header", "schema", "metadata"] {
        let (_, opcode, content) = all.iter().find(|one| one.0 == name).expect("there");
        file.extend(record(*opcode, content.len() as u64, content));
    }
    // The channel of records, so that the following is read as data of a run.
    let channel = [
        vec![9, 0, 1, 0],
        text("/record"),
        text("cdr"),
        map("version", "4"),
    ]
    .concat();
    file.extend(record(op::CHANNEL, channel.len() as u64, &channel));
    file.extend(bytes);
    file
}

/// Passes a file through every reader.
fn read(about: &str, bytes: &[u8]) {
    println!("{about}");
    assert_modest(about, || recording::run(bytes));
}

/// Fails if a reader allocates more than it may for a small file.
pub(super) fn assert_modest(about: &str, read: impl FnOnce()) {
    let most = measure(read).bytes_max;
    assert!(most < MOST_BYTES, "{about}: {most} bytes of memory");
}

/// Places the record alone in a file, after the beginning of a recording, and in a chunk.
fn everywhere(about: &str, bytes: &[u8]) {
    read(&format!("{about}, first"), &[mcap::MAGIC, bytes].concat());
    read(about, &file(bytes));
    let chunk = chunk(bytes);
    let chunk = record(op::CHUNK, chunk.len() as u64, &chunk);
    read(&format!("{about}, in a chunk"), &file(&chunk));
}

#[test]
fn every_record_truncated_at_any_byte_is_accepted_or_refused_by_name() {
    for (name, opcode, content) in contents() {
        for length in 0..=content.len() {
            let bytes = record(opcode, length as u64, &content[..length]);
            everywhere(&format!("{name} of {length} bytes"), &bytes);
        }
    }
}

#[test]
fn every_record_with_an_impossible_length_is_accepted_or_refused_by_name() {
    for (name, opcode, content) in contents() {
        for huge in HUGE {
            let bytes = record(opcode, huge, &content);
            everywhere(&format!("{name} that says it has {huge} bytes"), &bytes);
            for place in 0..content.len() {
                let mut wrong = content.clone();
                let end = content.len().min(place + 8);
                wrong[place..end].copy_from_slice(&huge.to_le_bytes()[..end - place]);
                let bytes = record(opcode, wrong.len() as u64, &wrong);
                read(&format!("{name}, {huge} at byte {place}"), &file(&bytes));
            }
        }
    }
}

#[test]
fn a_chunk_inside_a_chunk_is_refused() {
    let inner = chunk(&record(op::MESSAGE, 42, &[0; 42]));
    let mut bytes = record(op::CHUNK, inner.len() as u64, &inner);
    for depth in 0..20 {
        let outer = chunk(&bytes);
        bytes = record(op::CHUNK, outer.len() as u64, &outer);
        read(&format!("chunks, {depth} deep"), &file(&bytes));
    }
}
