//! Records of a file as the library parses them, after a look at every length in them.
//!
//! Used by the [content](super::content) of a file. The library asks for the memory that a text says it
//! has, 4 GiB at most, and takes the check sum of an attachment for there; of a damaged file neither is
//! true. Only records that a run is read from are parsed at all. Format: <https://mcap.dev/spec>.

use mcap::records::{Record, op};

/// A part of a record.
#[derive(Clone, Copy)]
enum Part {
    Bytes(usize),
    /// A text, or anything with a length of four bytes in front.
    Text,
    /// Pairs of texts, with a length of four bytes in front of all.
    Map,
    /// Bytes with a length of eight in front.
    Long,
}

use Part::{Bytes, Long, Map, Text};

const SCHEMA: &[Part] = &[Bytes(2), Text, Text, Text];
const CHANNEL: &[Part] = &[Bytes(4), Text, Text, Map];
const MESSAGE: &[Part] = &[Bytes(22)];
const ATTACHMENT: &[Part] = &[Bytes(16), Text, Text, Long, Bytes(4)];
const METADATA: &[Part] = &[Text, Map];
/// The record up to its packed bytes.
const CHUNK: &[Part] = &[Bytes(28), Text, Bytes(8)];

/// Parses a record of a run; any other is one of no known type.
///
/// # Errors
/// If it is not of its type's form.
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
    mcap::parse_record(opcode, content).map_err(|error| error.to_string())
}

/// Returns the length of a chunk's head, if the head is there as a whole.
pub(super) fn chunk_head(content: &[u8]) -> Option<usize> {
    length(CHUNK, content)
}

/// Returns the length of content of this form; `None` if the content is cut off.
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

/// Takes bytes with their length in front.
fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = u32::from_le_bytes(rest.split_off(..4)?.try_into().ok()?);
    rest.split_off(..length as usize)
}
