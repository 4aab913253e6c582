//! Validated parsing of records: all lengths are checked before the library parses a record.
//!
//! Used by the [content](super::content) reader. The library allocates the length that a text claims, up to 4 GiB, and
//! assumes that an attachment has a checksum; damaged files violate both. Only records that belong to a run are parsed.
//! Format: <https://mcap.dev/spec>.

use mcap::records::{MessageHeader, Record, op};

/// Part of a record.
#[derive(Clone, Copy)]
enum Part {
    Bytes(usize),
    /// Text or other data, preceded by a length of four bytes.
    Text,
    /// Pairs of texts, preceded by their total length in four bytes.
    Map,
    /// Bytes, preceded by a length of eight bytes.
    Long,
}

use Part::{Bytes, Long, Map, Text};

const SCHEMA: &[Part] = &[Bytes(2), Text, Text, Text];
const CHANNEL: &[Part] = &[Bytes(4), Text, Text, Map];
const MESSAGE: &[Part] = &[Bytes(22)];
const ATTACHMENT: &[Part] = &[Bytes(16), Text, Text, Long, Bytes(4)];
const METADATA: &[Part] = &[Text, Map];
/// Chunk up to its packed bytes.
const CHUNK: &[Part] = &[Bytes(28), Text, Bytes(8)];

/// Parses a record that belongs to a run; other records become unknown ones.
///
/// # Errors
/// If the record does not have the layout of its type.
pub(super) fn parse(opcode: u8, content: &[u8]) -> Result<Record<'_>, String> {
    let (name, form) = match opcode {
        op::SCHEMA => ("schema", SCHEMA),
        op::CHANNEL => ("channel", CHANNEL),
        op::MESSAGE => ("message", MESSAGE),
        op::ATTACHMENT => ("attachment", ATTACHMENT),
        op::METADATA => ("metadata", METADATA),
        _ => {
            let data = content.into();
            return Ok(Record::Unknown { opcode, data });
        }
    };
    if length(form, content).is_none() {
        let bytes = content.len();
        return Err(format!(
            "a record of {bytes} bytes is too short for its {name}"
        ));
    }
    if opcode == op::MESSAGE {
        // Nearly all records: the library takes several times as long for the same 22 bytes.
        return Ok(message(content));
    }
    mcap::parse_record(opcode, content).map_err(|error| error.to_string())
}

/// Parses a message, which is long enough.
fn message(content: &[u8]) -> Record<'_> {
    let mut rest = content;
    let header = MessageHeader {
        channel_id: u16::from_le_bytes(first(&mut rest)),
        sequence: u32::from_le_bytes(first(&mut rest)),
        log_time: u64::from_le_bytes(first(&mut rest)),
        publish_time: u64::from_le_bytes(first(&mut rest)),
    };
    let data = rest.into();
    Record::Message { header, data }
}

/// Splits off the first bytes, zeros if there are too few.
fn first<const N: usize>(rest: &mut &[u8]) -> [u8; N] {
    let bytes = rest.split_off(..N).and_then(<[u8]>::first_chunk);
    bytes.copied().unwrap_or([0; N])
}

/// Returns the length of a chunk's head, if the head is complete.
pub(super) fn chunk_head(content: &[u8]) -> Option<usize> {
    length(CHUNK, content)
}

/// Returns the length of content with this layout; `None` if the content is truncated.
fn length(form: &[Part], content: &[u8]) -> Option<usize> {
    let mut rest = content;
    for part in form {
        match *part {
            Bytes(count) => drop(rest.split_off(..count)?),
            Text => drop(text(&mut rest)?),
            Map => {
                let mut pairs = text(&mut rest)?;
                while !pairs.is_empty() {
                    text(&mut pairs)?;
                    text(&mut pairs)?;
                }
            }
            Long => {
                let length = u64::from_le_bytes(rest.split_off(..8)?.try_into().ok()?);
                rest.split_off(..usize::try_from(length).ok()?)?;
            }
        }
    }
    Some(content.len() - rest.len())
}

/// Splits off bytes that are preceded by their length.
fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = u32::from_le_bytes(rest.split_off(..4)?.try_into().ok()?);
    rest.split_off(..length as usize)
}
