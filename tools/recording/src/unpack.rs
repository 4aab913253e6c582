//! Decompression of the chunks of a recording, including truncated ones.
//!
//! Used by all readers of recordings. The libraries unpack complete chunks, but only the complete blocks of a truncated
//! chunk. The recorder packs a chunk into a single LZ4 block, so that block is decoded here up to its last byte; a
//! complete one is unpacked in place, without the buffers of a stream. The output never exceeds the requested length.

use std::io::{self, Read};

use crate::lz4::{FRAME_END, FRAME_HEAD};

/// Flags of an LZ4 frame: version 1, and the optional parts of its header and blocks.
const VERSION: (u8, u8) = (0xc0, 0x40);
const BLOCK_SUM: u8 = 1 << 4;
const CONTENT_SIZE: u8 = 1 << 3;
const DICTIONARY: u8 = 1;
const MAGIC: [u8; 4] = [0x04, 0x22, 0x4d, 0x18];
/// Bit of a block's size that marks it as uncompressed.
const PLAIN_BLOCK: u32 = 1 << 31;
/// Shortest match of the format, in bytes.
const MIN_MATCH: usize = 4;
/// Largest ratio of content to compressed bytes.
const MOST_TIMES: usize = 255;

/// Unpacks a chunk that must contain exactly `size` bytes, in place of what `into` has; after an error `into` is empty.
///
/// # Errors
/// If the chunk has another size.
pub(crate) fn whole(
    compression: &str,
    packed: &[u8],
    size: usize,
    into: &mut Vec<u8>,
) -> Result<(), String> {
    if compression == "lz4"
        && let Some(block) = only_block(packed)
        // No more memory than the block can fill.
        && size / MOST_TIMES <= block.len()
    {
        into.resize(size, 0);
        let unpacked = i32::try_from(size)
            .map(|size| lz4::block::decompress_to_buffer(block, Some(size), into));
        if matches!(unpacked, Ok(Ok(bytes)) if bytes == size) {
            return Ok(());
        }
    }
    into.clear();
    let unpacked = unpack(compression, packed, size + 1, into);
    let has_size = into.len() == size;
    if unpacked.is_err() || !has_size {
        into.clear();
    }
    unpacked.map_err(|error| format!("a chunk cannot be unpacked: {error}"))?;
    match has_size {
        true => Ok(()),
        false => Err(format!("a chunk does not unpack to its {size} bytes")),
    }
}

/// Returns the block of a frame that the recorder wrote; `None` for any other frame.
fn only_block(frame: &[u8]) -> Option<&[u8]> {
    let (size, block) = frame.strip_prefix(&FRAME_HEAD)?.split_first_chunk()?;
    let block = block.strip_suffix(&FRAME_END)?;
    (block.len() == u32::from_le_bytes(*size) as usize).then_some(block)
}

/// Unpacks the existing part of a truncated chunk.
pub(crate) fn torn(compression: &str, packed: &[u8], limit: usize, into: &mut Vec<u8>) {
    if compression == "lz4" {
        let mut source = packed;
        // The rest is ignored: it is the truncated end.
        let _ = torn_lz4(&mut source, limit, into);
    } else {
        let _ = unpack(compression, packed, limit, into); // as above
    }
}

/// Unpacks at most `limit` bytes; output before an error is preserved.
fn unpack(compression: &str, packed: &[u8], limit: usize, into: &mut Vec<u8>) -> io::Result<()> {
    let limit = limit as u64;
    let read = match compression {
        "" => packed.take(limit).read_to_end(into),
        "lz4" => lz4::Decoder::new(packed)?.take(limit).read_to_end(into),
        "zstd" => zstd::stream::read::Decoder::with_buffer(packed)?
            .take(limit)
            .read_to_end(into),
        other => Err(io::Error::other(format!("unknown compression `{other}`"))),
    };
    read.map(drop)
}

/// Unpacks the blocks of an LZ4 frame; `None` where the frame is truncated or invalid.
fn torn_lz4(source: &mut &[u8], limit: usize, into: &mut Vec<u8>) -> Option<()> {
    let head = source.split_off(..MAGIC.len() + 2)?;
    let flags = head[MAGIC.len()];
    if head[..MAGIC.len()] != MAGIC || flags & VERSION.0 != VERSION.1 {
        return None;
    }
    let optional = [(CONTENT_SIZE, 8), (DICTIONARY, 4)];
    for (flag, bytes) in optional {
        if flags & flag != 0 {
            source.split_off(..bytes)?;
        }
    }
    source.split_off(..1)?; // the sum of the head
    loop {
        let size = u32::from_le_bytes(source.split_off(..4)?.try_into().ok()?);
        let bytes = (size & !PLAIN_BLOCK) as usize;
        let mut block = source.split_off(..bytes.min(source.len()))?;
        if size & PLAIN_BLOCK != 0 {
            let room = limit.saturating_sub(into.len());
            into.extend_from_slice(&block[..block.len().min(room)]);
        } else {
            torn_block(&mut block, limit, into)?;
        }
        if flags & BLOCK_SUM != 0 {
            source.split_off(..4)?;
        }
        if size == 0 {
            return None;
        }
    }
}

/// Unpacks the sequences of an LZ4 block, each consisting of literals and a match, as far as they exist.
fn torn_block(block: &mut &[u8], limit: usize, into: &mut Vec<u8>) -> Option<()> {
    while let Some(token) = block.split_off_first() {
        let literals = length(usize::from(*token >> 4), block)?;
        let room = limit.saturating_sub(into.len());
        let available = literals.min(block.len()).min(room);
        into.extend_from_slice(block.split_off(..available)?);
        if available < literals {
            return None;
        }
        if block.is_empty() {
            return Some(()); // the last sequence has no match
        }
        let back = block.split_off(..2)?;
        let back = usize::from(u16::from_le_bytes([back[0], back[1]]));
        let copied = MIN_MATCH + length(usize::from(*token & 15), block)?;
        let start = into.len().checked_sub(back)?;
        if back == 0 || copied > limit.saturating_sub(into.len()) {
            return None;
        }
        // A match may overlap its own output.
        let mut done = 0;
        while done < copied {
            let part = (copied - done).min(into.len() - start);
            into.extend_from_within(start..start + part);
            done += part;
        }
    }
    Some(())
}

/// Decodes a length of four bits, which continues in more bytes if all bits are set.
fn length(bits: usize, source: &mut &[u8]) -> Option<usize> {
    let mut length = bits;
    if bits == 15 {
        loop {
            let more = *source.split_off_first()?;
            length = length.checked_add(usize::from(more))?;
            if more < u8::MAX {
                break;
            }
        }
    }
    Some(length)
}

#[cfg(test)]
mod tests;
