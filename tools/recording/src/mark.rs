//! A mark: a record that vouches for every byte of the file before it.
//!
//! Written by [`McapFile`](super::mcap_file::McapFile) before the first chunk and behind each, checked by
//! the [content](crate::reader::content) of a file. The format has a sum for the content of a chunk
//! and one at the end of the file; a file that broke off would have none for what stands between its
//! chunks: facts, names, units, places. Opcodes from 0x80 on are the format's room for other programs'
//! records, and its readers pass them over.

use std::ops::Range;

/// Far in bits from any record of the format, and from the zeros of a lost block.
pub(crate) const OPCODE: u8 = 0xb5;
/// Length of a mark's content: the place of the mark and the sum of what stands before it, 12 bytes.
const BYTES: u8 = 12;
const HEAD: [u8; 9] = [OPCODE, BYTES, 0, 0, 0, 0, 0, 0, 0];
const PLACE: Range<usize> = HEAD.len()..HEAD.len() + size_of::<u64>();

/// The mark that stands at this byte, behind bytes with this CRC 32.
pub(super) fn mark(at: u64, crc: u32) -> Vec<u8> {
    [&HEAD[..], &at.to_le_bytes(), &crc.to_le_bytes()].concat()
}

/// Returns true if this is the content of the mark that must stand there.
pub(crate) fn fits(content: &[u8], at: u64, crc: u32) -> bool {
    mark(at, crc)[HEAD.len()..] == *content
}

/// Returns true if a whole mark stands among bytes that begin at this place of a file, but not at
/// their begin.
pub(crate) fn is_among(bytes: &[u8], begin: u64) -> bool {
    let whole = HEAD.len() + usize::from(BYTES);
    let mut places = bytes.windows(whole).enumerate().skip(1);
    places.any(|(index, bytes)| {
        bytes.starts_with(&HEAD) && bytes[PLACE] == (begin + index as u64).to_le_bytes()
    })
}
