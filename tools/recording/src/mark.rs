//! A mark: a record with a checksum of every preceding byte of the file.
//!
//! [`McapFile`](super::mcap_file::McapFile) writes one before the first chunk and after each chunk; the
//! [content](crate::reader::content) reader verifies them. The format has a checksum for the content of a chunk and
//! another at the end of the file; in a truncated file, nothing would protect the bytes between chunks: facts, names,
//! units, offsets. The format reserves opcodes from 0x80 on for private records, which other readers skip.

use std::ops::Range;

/// Opcode that differs in many bits from those of the format, and from the zeros of a lost block.
pub(crate) const OPCODE: u8 = 0xb5;
/// Length of a mark's content: its offset and the checksum of the preceding bytes, 12 bytes.
const BYTES: u8 = 12;
const HEAD: [u8; 9] = [OPCODE, BYTES, 0, 0, 0, 0, 0, 0, 0];
const PLACE: Range<usize> = HEAD.len()..HEAD.len() + size_of::<u64>();

/// Builds the mark for this offset and the CRC 32 of the bytes before it.
pub(super) fn mark(at: u64, crc: u32) -> Vec<u8> {
    [&HEAD[..], &at.to_le_bytes(), &crc.to_le_bytes()].concat()
}

/// Returns `true` if the content is that of the mark expected at this offset.
pub(crate) fn fits(content: &[u8], at: u64, crc: u32) -> bool {
    mark(at, crc)[HEAD.len()..] == *content
}

/// Returns `true` if bytes that begin at this offset of a file contain a complete mark after their first byte.
pub(crate) fn is_among(bytes: &[u8], begin: u64) -> bool {
    let whole = HEAD.len() + usize::from(BYTES);
    let mut places = bytes.windows(whole).enumerate().skip(1);
    places.any(|(index, bytes)| {
        bytes.starts_with(&HEAD) && bytes[PLACE] == (begin + index as u64).to_le_bytes()
    })
}
