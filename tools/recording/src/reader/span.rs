//! Reader of the records of a span of steps: unpacks only the chunks that contain them.
//!
//! Used by views that look closer at a part of a long run. Locates the chunks by the heads of the file's records, so it
//! needs no index and reads truncated files up to their last complete chunk. Every chunk's own checksum is verified;
//! the checksums over the whole file are not, which only a [`RunReader`] can do.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use mcap::records::op;
use shared_types::time::{Rate, Step};

use super::content::{self, HEAD_BYTES, LONGEST_RECORD};
use super::{ReadError, RunReader};
use crate::schema::ENCAPSULATION;

/// Number of bytes of a message between its head and its content.
pub(super) const MESSAGE_BYTES: usize = 22;

/// Location of a chunk in the file.
#[derive(Clone, Copy, Debug)]
struct Location {
    /// Offset of the chunk's content.
    at: u64,
    bytes: usize,
    /// Simulated times of the first and the last message.
    first_ns: u64,
    last_ns: u64,
}

/// Reader of the records of a span of steps.
#[derive(Debug)]
pub struct SpanReader {
    path: PathBuf,
    file: File,
    rate: Rate,
    /// Channel of the records.
    channel: u16,
    /// Number of words of a record.
    words: usize,
    chunks: Vec<Location>,
}

impl SpanReader {
    /// Locates the chunks of a recording.
    ///
    /// # Errors
    /// If the file cannot be read, or has no rate.
    pub fn of(reader: &RunReader) -> Result<Self, ReadError> {
        let rate = reader.rate()?;
        let path = reader.path.clone();
        let located = File::open(&path).and_then(|file| Ok((locate(&file)?, file)));
        let (chunks, file) = located.map_err(|error| ReadError::Io {
            path: path.clone(),
            error,
        })?;
        let of_records = |(_, encoding): &(&u16, &Option<String>)| encoding.is_none();
        let channel = reader.channels.iter().find(of_records);
        Ok(Self {
            path,
            file,
            rate,
            channel: channel.map_or(0, |(id, _)| *id),
            words: reader.columns.len(),
            chunks,
        })
    }

    /// Reads the records of the steps `first` to `last` in order; returns the number of unpacked chunks.
    ///
    /// # Errors
    /// If the file cannot be read, or a chunk is damaged.
    pub fn read(
        &self,
        first: Step,
        last: Step,
        mut take: impl FnMut(&[u64]),
    ) -> Result<usize, ReadError> {
        let (first_ns, last_ns) = (self.rate.nanoseconds(first), self.rate.nanoseconds(last));
        let is_needed = |one: &&Location| one.last_ns >= first_ns && one.first_ns <= last_ns;
        let (mut packed, mut chunk, mut words) = (Vec::new(), Vec::new(), Vec::new());
        let mut count = 0;
        for location in self.chunks.iter().filter(is_needed) {
            count += 1;
            packed.resize(location.bytes, 0);
            let read = self.file.read_exact_at(&mut packed, location.at);
            read.map_err(|error| ReadError::Io {
                path: self.path.clone(),
                error,
            })?;
            content::unpack_chunk(&packed, &mut chunk)
                .map_err(|what| self.damaged(location, what))?;
            let mut rest = &chunk[..];
            while let Some((opcode, message)) = next(&mut rest) {
                let Some(row) = self.row(opcode, message) else {
                    continue;
                };
                words.clear();
                words.extend(row.iter().map(|word| u64::from_le_bytes(*word)));
                if (first.0..=last.0).contains(&words[0]) {
                    take(&words);
                }
            }
        }
        Ok(count)
    }

    /// Returns the words of a record; `None` for any other message.
    fn row<'a>(&self, opcode: u8, message: &'a [u8]) -> Option<&'a [[u8; 8]]> {
        let channel = u16::from_le_bytes(*message.first_chunk()?);
        if opcode != op::MESSAGE || channel != self.channel {
            return None;
        }
        let data = message.get(MESSAGE_BYTES + ENCAPSULATION.len()..)?;
        let (row, _) = data.as_chunks();
        (row.len() == self.words && !row.is_empty()).then_some(row)
    }

    fn damaged(&self, location: &Location, what: String) -> ReadError {
        ReadError::Damaged {
            path: self.path.clone(),
            what,
            at: location.at - HEAD_BYTES as u64,
            length: location.at + location.bytes as u64,
            records: 0,
        }
    }
}

/// Splits off the next record of a chunk.
pub(super) fn next<'a>(rest: &mut &'a [u8]) -> Option<(u8, &'a [u8])> {
    let head = rest.split_off(..HEAD_BYTES)?;
    let length = u64::from_le_bytes(head[1..].try_into().ok()?);
    let message = rest.split_off(..usize::try_from(length).ok()?)?;
    Some((head[0], message))
}

/// Finds the complete chunks of a file.
fn locate(file: &File) -> io::Result<Vec<Location>> {
    let length = file.metadata()?.len();
    let mut chunks = Vec::new();
    let mut at = mcap::MAGIC.len() as u64;
    loop {
        // The head of a record, and the two times with which a chunk begins.
        let mut head = [0; HEAD_BYTES + 16];
        let count = read_up_to(file, &mut head, at)?;
        let Some((opcode, rest)) = head[..count].split_first() else {
            break;
        };
        let Some((bytes, times)) = rest.split_first_chunk() else {
            break;
        };
        let bytes = u64::from_le_bytes(*bytes);
        at += HEAD_BYTES as u64;
        let is_inside = bytes <= LONGEST_RECORD as u64 && at + bytes <= length;
        if !is_inside || matches!(*opcode, op::DATA_END | op::FOOTER) {
            break;
        }
        if *opcode == op::CHUNK
            && let ([first_ns, last_ns], _) = times.as_chunks()
        {
            chunks.push(Location {
                at,
                bytes: bytes as usize,
                first_ns: u64::from_le_bytes(*first_ns),
                last_ns: u64::from_le_bytes(*last_ns),
            });
        }
        at += bytes;
    }
    Ok(chunks)
}

/// Reads as many bytes as the file has, up to the length of the buffer.
fn read_up_to(file: &File, buffer: &mut [u8], at: u64) -> io::Result<usize> {
    let mut count = 0;
    while count < buffer.len() {
        match file.read_at(&mut buffer[count..], at + count as u64) {
            Ok(0) => break,
            Ok(read) => count += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(count)
}
