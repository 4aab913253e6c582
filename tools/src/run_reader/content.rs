//! The records of an MCAP file, one by one, those in its chunks unpacked.
//!
//! Used by the [run reader](super), and by `hil recover` to copy them. Goes through a file of any
//! state: one that broke off is read up to the tear, also inside its last chunk, and a length that
//! cannot be is never memory to ask for. Knows nothing of runs.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;

use binrw::BinReaderExt;
use mcap::McapError;
use mcap::records::{ChunkHeader, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::recording::unpack;

/// Longest record of a file, packed or not: a size beyond that is damage.
const LONGEST_RECORD: usize = 1 << 28;
/// Opcode and length in front of each record.
const HEAD_BYTES: usize = 9;
/// What a power failure leaves where data were to be.
const ZEROS: u8 = 0;

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// As its writer finished it.
    Whole,
    /// Its writer was killed, or a copy was cut: whole up to this byte.
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
    /// Where the record outside of chunks begins that comes next.
    position: u64,
    end: Option<End>,
    /// A record outside of chunks.
    outside: Vec<u8>,
    /// The unpacked records of the chunk in work, and where the next of them begins.
    chunk: Vec<u8>,
    next: usize,
    compression: String,
    current: Current,
}

/// Where the current record is.
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
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true);
        Ok(Self {
            length: file.metadata()?.len(),
            file,
            linear: LinearReader::new_with_options(options),
            read: 0,
            position: mcap::MAGIC.len() as u64,
            end: None,
            outside: Vec::new(),
            chunk: Vec::new(),
            next: 0,
            compression: String::new(),
            current: Current::Outside,
        })
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
                return Ok(None);
            }
            let at = self.position;
            let damaged = |what: String| ContentError::Damaged { at, what };
            let wanted = match self.linear.next_event() {
                None => {
                    self.end = Some(End::Whole);
                    continue;
                }
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => wanted,
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    self.position += (HEAD_BYTES + data.len()) as u64;
                    match opcode {
                        op::CHUNK => {
                            let (header, packed) = chunk_of(data).map_err(damaged)?;
                            self.compression.clone_from(&header.compression);
                            self.chunk.clear();
                            self.next = 0;
                            unpack_whole(&header, packed, &mut self.chunk).map_err(damaged)?;
                            continue;
                        }
                        ZEROS => {
                            self.position = at;
                            self.end = Some(End::Torn(at));
                            continue;
                        }
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
                Some(Err(McapError::BadDataCrc { .. } | McapError::BadSummaryCrc { .. })) => {
                    let what = "its check sum does not fit, bits in it have changed";
                    return Err(damaged(what.into()));
                }
                Some(Err(error)) => return Err(damaged(error.to_string())),
            };
            self.fetch(wanted)?;
        }
    }

    /// The content of the current record.
    pub(crate) fn data(&self) -> &[u8] {
        match &self.current {
            Current::Outside => &self.outside,
            Current::InChunk(range) => &self.chunk[range.clone()],
        }
    }

    /// How the chunk in work was packed.
    pub(crate) fn compression(&self) -> &str {
        &self.compression
    }

    /// Where the next record outside of chunks begins.
    pub(crate) const fn position(&self) -> u64 {
        self.position
    }

    /// How the file ends; known at the end.
    pub(crate) const fn end(&self) -> Option<End> {
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
        self.end = Some(End::Torn(self.position.min(self.length)));
        self.chunk.clear();
        self.next = 0;
        self.file.seek(SeekFrom::Start(self.position))?;
        self.outside.clear();
        let limit = (HEAD_BYTES + LONGEST_RECORD) as u64;
        (&mut self.file)
            .take(limit)
            .read_to_end(&mut self.outside)?;
        let rest = self.outside.get(HEAD_BYTES..).unwrap_or_default();
        if self.outside.first() == Some(&op::CHUNK)
            && let Ok((header, packed)) = chunk_of(rest)
        {
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

/// The head of a chunk and its packed records, as many as there are.
fn chunk_of(data: &[u8]) -> Result<(ChunkHeader, &[u8]), String> {
    let mut cursor = Cursor::new(data);
    let header: ChunkHeader = (cursor.read_le()).map_err(|_| "a chunk without head".to_owned())?;
    let packed = data.get(cursor.position() as usize..).unwrap_or_default();
    let size = header.compressed_size;
    let packed = match usize::try_from(size) {
        Ok(size) if size <= packed.len() => &packed[..size],
        _ => packed,
    };
    Ok((header, packed))
}

/// Unpacks a chunk that is all there.
fn unpack_whole(header: &ChunkHeader, packed: &[u8], into: &mut Vec<u8>) -> Result<(), String> {
    let (size, limit) = (header.uncompressed_size, LONGEST_RECORD);
    if size > limit as u64 {
        return Err(format!("a chunk of {size} bytes; at most {limit} can be"));
    }
    if packed.len() as u64 != header.compressed_size {
        return Err("a chunk that is not as long as it says".into());
    }
    unpack::whole(&header.compression, packed, size as usize, into)?;
    let (saved, found) = (header.uncompressed_crc, || crc32fast::hash(into));
    if saved != 0 && saved != found() {
        return Err("the check sum of a chunk is wrong".into());
    }
    Ok(())
}
