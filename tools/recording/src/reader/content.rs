//! The records of an MCAP file, one by one, those in its chunks unpacked.
//!
//! Used by the [run reader](super), and by `hil recover` to copy them. Goes through a file of any
//! state: one that broke off is read up to the tear, also inside its last chunk, and a length that
//! cannot be is never memory to ask for. Every check sum that it comes by is looked at. Knows nothing of
//! runs.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;

use binrw::BinReaderExt;
use mcap::McapError;
use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::form;
use crate::{mark, unpack};

/// Longest record of a file, packed or not: a size beyond that is damage.
const LONGEST_RECORD: usize = 1 << 28;
/// Opcode and length in front of each record.
const HEAD_BYTES: usize = 9;
/// Byte that a power failure leaves where data were to be.
const ZEROS: u8 = 0;
const NOT_AS_LONG: &str = "a chunk that is not as long as it says";

/// End of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileEnd {
    /// Finished by its writer.
    Whole,
    /// Torn, by a killed writer or a copy that was cut: whole up to this byte.
    Torn(u64),
}

/// A file cannot be read any further.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ContentError {
    #[error("{0}")]
    Io(#[from] io::Error),
    /// Not the end of a file but something in it is wrong.
    #[error("byte {at}: {what}")]
    Damaged { at: u64, what: String },
}

/// The records of a file.
pub(crate) struct Content {
    file: File,
    linear: LinearReader,
    /// Bytes that were asked of the file.
    read: u64,
    /// Bytes of the file when it was last looked at.
    length: u64,
    /// Begin of the next record outside of chunks.
    position: u64,
    end: Option<FileEnd>,
    /// Of all bytes so far; `None` behind the data section, which ends with it.
    sum: Option<crc32fast::Hasher>,
    /// The first mark that did not fit, if the file is read on nevertheless.
    wrong_mark: Option<u64>,
    is_patient: bool,
    /// A record outside of chunks.
    outside: Vec<u8>,
    /// The unpacked records of the chunk in work, and where the next of them begins.
    chunk: Vec<u8>,
    next: usize,
    compression: String,
    current: Current,
}

/// Place of the current record.
enum Current {
    Outside,
    InChunk(Range<usize>),
}

impl Content {
    /// Begins to read a file.
    pub(crate) fn of(file: File) -> io::Result<Self> {
        // Chunks are unpacked here: a whole one and a torn one by the same code.
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

    /// The same for who wants what comes after a wrong mark too: that is told at the end then.
    pub(crate) const fn be_patient(&mut self) {
        self.is_patient = true;
    }

    /// Goes to the next record: its opcode, or `None` at the end.
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
            let wanted = match self.linear.next_event() {
                None => {
                    let length = self.file.metadata()?.len();
                    let behind = length.saturating_sub(at + mcap::MAGIC.len() as u64);
                    if behind > 0 {
                        return Err(damaged(format!("{behind} bytes follow where it ends")));
                    }
                    self.end = Some(FileEnd::Whole);
                    continue;
                }
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => wanted,
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
                            self.chunk.clear();
                            self.next = 0;
                            unpack_whole(&header, packed, &mut self.chunk).map_err(damaged)?;
                            continue;
                        }
                        op::DATA_END => {}
                        // The summary says again what was before it.
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
                    return Err(damaged("it does not begin as an MCAP file does".into()));
                }
                Some(Err(McapError::BadSummaryCrc { .. })) => return Err(wrong_sum(at)),
                Some(Err(error)) => return Err(damaged(error.to_string())),
            };
            self.fetch(wanted)?;
        }
    }

    /// The current record, if it is one that a run is read from.
    ///
    /// # Errors
    /// If it is not as its type says.
    pub(crate) fn record(&self, opcode: u8) -> Result<Record<'_>, String> {
        form::parse(opcode, self.data())
    }

    /// The content of the current record.
    fn data(&self) -> &[u8] {
        match &self.current {
            Current::Outside => &self.outside,
            Current::InChunk(range) => &self.chunk[range.clone()],
        }
    }

    /// Returns the compression of the chunk in work.
    pub(crate) fn compression(&self) -> &str {
        &self.compression
    }

    /// Returns the beginning of the next record outside of chunks.
    pub(crate) const fn position(&self) -> u64 {
        self.position
    }

    /// Returns the end of the file, whole or torn; known at the end of reading.
    pub(crate) const fn end(&self) -> Option<FileEnd> {
        self.end
    }

    /// Bytes of the file.
    pub(crate) const fn length(&self) -> u64 {
        self.length
    }

    /// Gives the reader more of the file, or what there is.
    fn fetch(&mut self, wanted: usize) -> Result<(), ContentError> {
        if self.read + wanted as u64 > self.length {
            // It may have grown: the recording of a live run can be read.
            self.length = self.file.metadata()?.len();
        }
        if self.read + wanted as u64 > self.length && self.length >= self.read {
            return self.tear();
        }
        // More than is wanted: a record at a time would be a system call each.
        let room = self.linear.insert(wanted.max(1 << 16));
        let read = self.file.read(room)?;
        self.linear.notify_read(read);
        self.read += read as u64;
        Ok(())
    }

    /// The file ends here, in the middle of a record. If that is a chunk, unpacks what there is of it.
    fn tear(&mut self) -> Result<(), ContentError> {
        let at = self.position.min(self.length);
        self.chunk.clear();
        self.next = 0;
        self.file.seek(SeekFrom::Start(at))?;
        self.outside.clear();
        // No more than there was a moment ago: a live recording grows.
        let limit = (self.length - at).min((HEAD_BYTES + LONGEST_RECORD) as u64);
        (&mut self.file)
            .take(limit)
            .read_to_end(&mut self.outside)?;
        if mark::is_among(&self.outside, at) {
            let what = "a length is wrong: there are whole records behind".into();
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

    /// Goes to the next record of the chunk; `None` if it has no whole one any more.
    fn advance_in_chunk(&mut self) -> Result<Option<u8>, ContentError> {
        let rest = &self.chunk[self.next..];
        if let Some((head, rest)) = rest.split_at_checked(HEAD_BYTES)
            && let [opcode, length @ ..] = head
            && let Ok(length) = <[u8; 8]>::try_from(length)
            && let length = u64::from_le_bytes(length)
            && length <= rest.len() as u64
            // By the format there is nothing else in a chunk.
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
                what: "the records of a chunk do not fill it".into(),
            }),
        }
    }
}

fn wrong_sum(at: u64) -> ContentError {
    let what = "its check sum does not fit, bits in it have changed".into();
    ContentError::Damaged { at, what }
}

/// Adds a record to the sum of all before it; whether that is the one that the record says.
fn add_up(
    sum: &mut Option<crc32fast::Hasher>,
    opcode: u8,
    data: &[u8],
    at: u64,
) -> Result<bool, String> {
    let Some(hasher) = sum else {
        return match opcode {
            mark::OPCODE => Err("a mark behind the end".into()),
            _ => Ok(true),
        };
    };
    let found = || hasher.clone().finalize();
    let mut fits = true;
    match opcode {
        mark::OPCODE => fits = mark::fits(data, at, found()),
        op::DATA_END => {
            // The library has parsed it. 0 is none.
            let saved = data
                .first_chunk()
                .map_or(0, |saved| u32::from_le_bytes(*saved));
            fits = saved == 0 || saved == found();
            *sum = None;
            return Ok(fits);
        }
        op::FOOTER => return Err("it ends without the sum of its records".into()),
        _ => {}
    }
    hasher.update(&[opcode]);
    hasher.update(&(data.len() as u64).to_le_bytes());
    hasher.update(data);
    Ok(fits)
}

/// The head of a chunk and its packed records, as many as there are.
fn chunk_of(data: &[u8]) -> Result<(ChunkHeader, &[u8]), &'static str> {
    let without = "a chunk without head";
    let (head, packed) = data.split_at(form::chunk_head(data).ok_or(without)?);
    let header = Cursor::new(head).read_le().map_err(|_| without)?;
    Ok((header, packed))
}

/// Unpacks a chunk that is all there.
fn unpack_whole(header: &ChunkHeader, packed: &[u8], into: &mut Vec<u8>) -> Result<(), String> {
    let (size, limit) = (header.uncompressed_size, LONGEST_RECORD);
    if size > limit as u64 {
        return Err(format!("a chunk of {size} bytes; at most {limit} can be"));
    }
    if packed.len() as u64 != header.compressed_size {
        return Err(NOT_AS_LONG.into());
    }
    unpack::whole(&header.compression, packed, size as usize, into)?;
    let (saved, found) = (header.uncompressed_crc, || crc32fast::hash(into));
    if saved != 0 && saved != found() {
        return Err("the check sum of a chunk is wrong".into());
    }
    Ok(())
}
