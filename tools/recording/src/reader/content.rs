//! Reader of the records of an MCAP file, including those in its chunks.
//!
//! Used by the [run reader](super), and by `hil recover` to copy the records. Reads files in any state: a truncated
//! file is read up to the truncation, even inside its last chunk, and no memory is allocated for an impossible length.
//! Every checksum is verified. The module is independent of runs.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;

use binrw::BinReaderExt;
use mcap::McapError;
use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::form;
use crate::{mark, unpack};

/// Longest valid record of a file, packed or unpacked, in bytes; a larger size is damage.
pub(super) const LONGEST_RECORD: usize = 1 << 28;
/// Size of the opcode and length before each record, in bytes.
pub(super) const HEAD_BYTES: usize = 9;
/// Byte that replaces lost data after a power failure.
const ZEROS: u8 = 0;
const NOT_AS_LONG: &str = "the length of a chunk differs from that in its header";

/// Kind of end of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileEnd {
    /// Completed by its writer.
    Whole,
    /// Truncated by a killed writer or an incomplete copy; valid up to this byte.
    Torn(u64),
}

/// Error of reading a file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ContentError {
    #[error("{0}")]
    Io(#[from] io::Error),
    /// Damage other than a missing end.
    #[error("byte {at}: {what}")]
    Damaged { at: u64, what: String },
}

/// Reader of the records of a file.
pub(crate) struct Content {
    file: File,
    linear: LinearReader,
    /// Number of bytes read from the file.
    read: u64,
    /// Size of the file when it was last checked, in bytes.
    length: u64,
    /// Offset of the next record outside of chunks.
    position: u64,
    end: Option<FileEnd>,
    /// Checksum of all bytes so far; `None` after the data section, where it ends.
    sum: Option<crc32fast::Hasher>,
    /// Offset of the first mark that did not match, if reading continues nevertheless.
    wrong_mark: Option<u64>,
    is_patient: bool,
    /// Current record outside of chunks.
    outside: Vec<u8>,
    /// Unpacked records of the current chunk, and the offset of the next one.
    chunk: Vec<u8>,
    next: usize,
    compression: String,
    current: Current,
}

/// Location of the current record.
enum Current {
    Outside,
    InChunk(Range<usize>),
}

impl Content {
    /// Creates a reader of a file.
    pub(crate) fn of(file: File) -> io::Result<Self> {
        // Chunks are unpacked here, so that complete and truncated ones use the same code.
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_record_length_limit(LONGEST_RECORD)
            .with_validate_summary_section_crc(true);
        let mut sum = crc32fast::Hasher::new();
        sum.update(mcap::MAGIC);
        Ok(Self {
            length: file.metadata()?.len(),
            file,
            linear: LinearReader::new_with_options(options),
            read: 0,
            position: mcap::MAGIC.len() as u64,
            end: None,
            sum: Some(sum),
            wrong_mark: None,
            is_patient: false,
            outside: Vec::new(),
            chunk: Vec::new(),
            next: 0,
            compression: String::new(),
            current: Current::Outside,
        })
    }

    /// Continues after a mark that does not match, which then becomes an error at the end.
    pub(crate) const fn be_patient(&mut self) {
        self.is_patient = true;
    }

    /// Reads the next record; returns its opcode, or `None` at the end.
    pub(crate) fn advance(&mut self) -> Result<Option<u8>, ContentError> {
        loop {
            if self.next < self.chunk.len()
                && let Some(opcode) = self.advance_in_chunk()?
            {
                return Ok(Some(opcode));
            }
            if self.end.is_some() {
                let wrong = self.wrong_mark.take();
                return wrong.map_or(Ok(None), |at| Err(wrong_sum(at)));
            }
            let at = self.position;
            let damaged = |what: String| ContentError::Damaged { at, what };
            let bytes = match self.linear.next_event() {
                None => {
                    let length = self.file.metadata()?.len();
                    let behind = length.saturating_sub(at + mcap::MAGIC.len() as u64);
                    if behind > 0 {
                        return Err(damaged(format!(
                            "{behind} bytes follow the closing magic bytes"
                        )));
                    }
                    self.end = Some(FileEnd::Whole);
                    continue;
                }
                Some(Ok(LinearReadEvent::ReadRequest(bytes))) => bytes,
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    if opcode == ZEROS {
                        self.tear()?;
                        continue;
                    }
                    let fits = add_up(&mut self.sum, opcode, data, at).map_err(damaged)?;
                    if !(fits || self.is_patient && opcode == mark::OPCODE) {
                        return Err(wrong_sum(at));
                    }
                    self.position += (HEAD_BYTES + data.len()) as u64;
                    match opcode {
                        mark::OPCODE if !fits => {
                            self.wrong_mark.get_or_insert(at);
                            continue;
                        }
                        op::CHUNK => {
                            let (header, packed) =
                                chunk_of(data).map_err(|what| damaged(what.into()))?;
                            self.compression.clone_from(&header.compression);
                            self.next = 0;
                            unpack_whole(&header, packed, &mut self.chunk).map_err(damaged)?;
                            continue;
                        }
                        op::DATA_END => {}
                        // The summary repeats earlier records.
                        _ if self.sum.is_none() => continue,
                        _ => {}
                    }
                    self.outside.clear();
                    self.outside.extend_from_slice(data);
                    self.current = Current::Outside;
                    return Ok(Some(opcode));
                }
                Some(Err(McapError::UnexpectedEof)) => {
                    self.tear()?;
                    continue;
                }
                Some(Err(McapError::BadMagic)) if at <= mcap::MAGIC.len() as u64 => {
                    return Err(damaged(
                        "the file does not begin with the magic bytes of MCAP".into(),
                    ));
                }
                Some(Err(McapError::BadSummaryCrc { .. })) => return Err(wrong_sum(at)),
                Some(Err(error)) => return Err(damaged(error.to_string())),
            };
            self.fetch(bytes)?;
        }
    }

    /// Parses the current record, if it belongs to a run.
    ///
    /// # Errors
    /// If the record does not match its type.
    pub(crate) fn record(&self, opcode: u8) -> Result<Record<'_>, String> {
        form::parse(opcode, self.data())
    }

    /// Returns the content of the current record.
    pub(super) fn data(&self) -> &[u8] {
        match &self.current {
            Current::Outside => &self.outside,
            Current::InChunk(range) => &self.chunk[range.clone()],
        }
    }

    /// Returns the compression of the current chunk.
    pub(crate) fn compression(&self) -> &str {
        &self.compression
    }

    /// Returns the offset of the next record outside of chunks.
    pub(crate) const fn position(&self) -> u64 {
        self.position
    }

    /// Returns the kind of end of the file; known at the end of reading.
    pub(crate) const fn end(&self) -> Option<FileEnd> {
        self.end
    }

    /// Returns the size of the file, in bytes.
    pub(crate) const fn length(&self) -> u64 {
        self.length
    }

    /// Supplies the parser with more bytes of the file, or reports its end.
    fn fetch(&mut self, bytes: usize) -> Result<(), ContentError> {
        if self.read + bytes as u64 > self.length {
            // The file may have grown: the recording of a live run can be read.
            self.length = self.file.metadata()?.len();
        }
        if self.read + bytes as u64 > self.length && self.length >= self.read {
            return self.tear();
        }
        // More than requested, because reading record by record would take a system call each.
        let room = self.linear.insert(bytes.max(1 << 16));
        let read = self.file.read(room)?;
        self.linear.notify_read(read);
        self.read += read as u64;
        Ok(())
    }

    /// Handles a file that ends within a record; unpacks the existing part of a chunk.
    fn tear(&mut self) -> Result<(), ContentError> {
        let at = self.position.min(self.length);
        self.chunk.clear();
        self.next = 0;
        self.file.seek(SeekFrom::Start(at))?;
        self.outside.clear();
        // Limited to the current size, because a live recording grows.
        let limit = (self.length - at).min((HEAD_BYTES + LONGEST_RECORD) as u64);
        (&mut self.file)
            .take(limit)
            .read_to_end(&mut self.outside)?;
        if mark::is_among(&self.outside, at) {
            let what = "the length of a record is wrong: complete records follow".into();
            return Err(ContentError::Damaged { at, what });
        }
        self.end = Some(FileEnd::Torn(at));
        let Some((head, rest)) = self.outside.split_at_checked(HEAD_BYTES) else {
            return Ok(());
        };
        if head[0] == op::CHUNK
            && let Ok((header, packed)) = chunk_of(rest)
        {
            let bytes = form::chunk_head(rest).unwrap_or_default() as u64;
            let says = bytes.saturating_add(header.compressed_size);
            if head[1..] != says.to_le_bytes() {
                let what = NOT_AS_LONG.into();
                return Err(ContentError::Damaged { at, what });
            }
            self.compression.clone_from(&header.compression);
            unpack::torn(&header.compression, packed, LONGEST_RECORD, &mut self.chunk);
        }
        Ok(())
    }

    /// Reads the next record of the chunk; `None` if there is no other complete record.
    fn advance_in_chunk(&mut self) -> Result<Option<u8>, ContentError> {
        let rest = &self.chunk[self.next..];
        if let Some((head, rest)) = rest.split_at_checked(HEAD_BYTES)
            && let [opcode, length @ ..] = head
            && let Ok(length) = <[u8; 8]>::try_from(length)
            && let length = u64::from_le_bytes(length)
            && length <= rest.len() as u64
            // The format allows no other records in a chunk.
            && matches!(*opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE)
        {
            let start = self.next + HEAD_BYTES;
            self.next = start + length as usize;
            self.current = Current::InChunk(start..self.next);
            return Ok(Some(*opcode));
        }
        self.next = self.chunk.len();
        match self.end {
            Some(_) => Ok(None),
            None => Err(ContentError::Damaged {
                at: self.position,
                what: "the records of a chunk do not fill it completely".into(),
            }),
        }
    }
}

fn wrong_sum(at: u64) -> ContentError {
    let what = "the checksum does not match, so bits have changed".into();
    ContentError::Damaged { at, what }
}

/// Adds a record to the checksum, and verifies the checksum that a record contains.
fn add_up(
    sum: &mut Option<crc32fast::Hasher>,
    opcode: u8,
    data: &[u8],
    at: u64,
) -> Result<bool, String> {
    let Some(hasher) = sum else {
        return match opcode {
            mark::OPCODE => Err("a checksum mark follows the end of the data".into()),
            _ => Ok(true),
        };
    };
    let computed = || hasher.clone().finalize();
    let mut fits = true;
    match opcode {
        mark::OPCODE => fits = mark::fits(data, at, computed()),
        op::DATA_END => {
            // The library has parsed the record. The value 0 means that there is no checksum.
            let saved = data
                .first_chunk()
                .map_or(0, |saved| u32::from_le_bytes(*saved));
            fits = saved == 0 || saved == computed();
            *sum = None;
            return Ok(fits);
        }
        op::FOOTER => return Err("the data ends without the checksum of its records".into()),
        _ => {}
    }
    hasher.update(&[opcode]);
    hasher.update(&(data.len() as u64).to_le_bytes());
    hasher.update(data);
    Ok(fits)
}

/// Splits a chunk into its head and its packed records, as far as they exist.
fn chunk_of(data: &[u8]) -> Result<(ChunkHeader, &[u8]), &'static str> {
    let without = "a chunk without a header";
    let (head, packed) = data.split_at(form::chunk_head(data).ok_or(without)?);
    let header = Cursor::new(head).read_le().map_err(|_| without)?;
    Ok((header, packed))
}

/// Unpacks a complete chunk, given with its head, and verifies its checksum.
pub(super) fn unpack_chunk(data: &[u8], into: &mut Vec<u8>) -> Result<(), String> {
    let (header, packed) = chunk_of(data)?;
    unpack_whole(&header, packed, into)
}

/// Unpacks a complete chunk in place of what `into` has.
fn unpack_whole(header: &ChunkHeader, packed: &[u8], into: &mut Vec<u8>) -> Result<(), String> {
    let (size, limit) = (header.uncompressed_size, LONGEST_RECORD);
    let is_too_long = size > limit as u64;
    if is_too_long || packed.len() as u64 != header.compressed_size {
        into.clear();
        return Err(match is_too_long {
            true => format!("a chunk of {size} bytes, above the limit of {limit}"),
            false => NOT_AS_LONG.into(),
        });
    }
    unpack::whole(&header.compression, packed, size as usize, into)?;
    let (saved, computed) = (header.uncompressed_crc, || crc32fast::hash(into));
    if saved != 0 && saved != computed() {
        return Err("the checksum of a chunk is wrong".into());
    }
    Ok(())
}
