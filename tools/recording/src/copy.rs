//! Copies the readable part of a recording into a new one.
//!
//! Used by `hil recover`. Facts, attachments, schemas and messages are copied in their order; chunks, indexes and
//! checksums are rebuilt, because those of a truncated file cannot be relied on.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;

use mcap::records::{MessageHeader, Metadata, Record};
use shared_types::record::Event;

use super::chunk::Chunk;
use super::event;
use super::mcap_file::McapFile;
use super::schema::{ENCAPSULATION, EVENT_TOPIC, RECORD_TOPIC};
use super::writer::{CHANNELS, CHUNK_BYTES, FACTS, RESULT};
use crate::compression::Compression;
use crate::reader::content::Content;
use crate::reader::{UNVOUCHED, Unvouched, VOUCHED};

/// Parameters of copying the readable part of a recording.
#[derive(Debug)]
pub struct Rescue<'a> {
    /// Number of readable messages.
    pub messages: u64,
    /// Set if the original is damaged. Its result is then not copied, so that the copy cannot pass for the complete
    /// run.
    pub is_doubtful: bool,
    /// Part of the original without a checksum.
    pub unvouched: Option<&'a Unvouched>,
    /// Result of the run, used if the original has none.
    pub result: BTreeMap<String, String>,
}

impl Rescue<'_> {
    /// Copies the messages of a file into an empty one, while `goes_on` returns `true`.
    ///
    /// # Errors
    /// If a file cannot be read or written, the original has fewer messages than before, or `goes_on` returned
    /// `false` ([`io::ErrorKind::Interrupted`]).
    pub fn copy(self, original: File, into: File, goes_on: impl Fn() -> bool) -> io::Result<()> {
        let mut copy = Copy::into(into, &self)?;
        let mut content = Content::of(original)?;
        content.be_patient();
        let mut messages = 0;
        while let Ok(Some(opcode)) = content.advance() {
            let Ok(record) = content.record(opcode) else {
                break; // read so far before
            };
            if messages == self.messages && matches!(record, Record::Message { .. }) {
                break;
            }
            let compression = match content.compression() {
                "lz4" => Compression::Lz4,
                "zstd" => Compression::Zstd,
                _ => Compression::None,
            };
            messages += u64::from(copy.take(record, compression)?);
            if !goes_on() {
                return Err(io::ErrorKind::Interrupted.into());
            }
        }
        if messages != self.messages {
            return Err(io::Error::other("the file changed while it was read"));
        }
        copy.finish(self.result)
    }
}

/// Recording being written.
struct Copy {
    file: McapFile,
    chunk: Option<Chunk>,
    /// New schema IDs, by the IDs of the original.
    schemas: BTreeMap<u16, u16>,
    /// New channel IDs, with the encoding of events for channels that carry no records.
    channels: BTreeMap<u16, (u16, Option<String>)>,
    /// Words of the current record.
    words: Vec<u64>,
    result: Option<Metadata>,
    is_doubtful: bool,
}

impl Copy {
    /// Starts an empty file.
    fn into(file: File, rescue: &Rescue<'_>) -> io::Result<Self> {
        let library = concat!("hil ", env!("CARGO_PKG_VERSION"));
        let mut file = McapFile::create(file, "ros2", library)?;
        if let Some(unvouched) = rescue.unvouched {
            // Stored at the beginning, so that it survives if the copy is truncated, too.
            file.metadata(Metadata {
                name: FACTS.into(),
                metadata: BTreeMap::from([
                    (VOUCHED.into(), unvouched.records.to_string()),
                    (UNVOUCHED.into(), unvouched.text.clone()),
                ]),
            })?;
        }
        Ok(Self {
            file,
            chunk: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            words: Vec::new(),
            result: None,
            is_doubtful: rescue.is_doubtful,
        })
    }

    /// Copies a record of the original, packing messages with this compression. Returns `true` if the record is a
    /// message of the run.
    fn take(&mut self, record: Record<'_>, compression: Compression) -> io::Result<bool> {
        match record {
            // The summary of a file repeats schemas and channels.
            Record::Schema { header, .. } if self.schemas.contains_key(&header.id) => {}
            Record::Channel(channel) if self.channels.contains_key(&channel.id) => {}
            Record::Schema { header, data } => {
                let number = self.file.schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, number);
            }
            Record::Channel(channel) if [RECORD_TOPIC, EVENT_TOPIC].contains(&&*channel.topic) => {
                let schema = self.schemas.get(&channel.schema_id).copied();
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                let schema = schema.unwrap_or_default();
                let number = (self.file).channel(schema, topic, encoding, channel.metadata)?;
                if number > CHANNELS {
                    return Err(io::Error::other("a channel is defined twice"));
                }
                let events = (topic == EVENT_TOPIC).then_some(channel.message_encoding);
                self.channels.insert(channel.id, (number, events));
            }
            Record::Metadata(metadata) if metadata.name == RESULT => {
                self.result = Some(metadata).filter(|_| !self.is_doubtful);
            }
            Record::Metadata(mut metadata) => {
                // Already written with its current value.
                metadata.metadata.remove(VOUCHED);
                metadata.metadata.remove(UNVOUCHED);
                if !metadata.metadata.is_empty() {
                    self.file.metadata(metadata)?;
                }
            }
            Record::Attachment { header, data, .. } => self.file.attachment(header, &data)?,
            Record::Message { header, data } => return self.message(header, &data, compression),
            _ => {}
        }
        Ok(false)
    }

    fn message(
        &mut self,
        header: MessageHeader,
        data: &[u8],
        compression: Compression,
    ) -> io::Result<bool> {
        let Some((channel_id, events)) = self.channels.get(&header.channel_id) else {
            return Ok(false);
        };
        let (channel_id, is_record) = (*channel_id, events.is_none());
        if self.is_doubtful
            && let Some(encoding) = events
            && matches!(event::read(encoding, data), Ok(Event::End(_)))
        {
            return Ok(true);
        }
        let header = MessageHeader {
            channel_id,
            ..header
        };
        if self.chunk.is_none() {
            self.file.mark()?;
            self.chunk = Some(Chunk::new(compression, CHANNELS)?);
        }
        let Some(chunk) = &mut self.chunk else {
            return Ok(false);
        };
        match data.strip_prefix(&ENCAPSULATION) {
            Some(words) if is_record => {
                let words = words.as_chunks().0.iter();
                self.words.clear();
                (self.words).extend(words.map(|word| u64::from_le_bytes(*word)));
                chunk.record(&header, &self.words);
            }
            _ => chunk.message(&header, data),
        }
        if chunk.bytes() >= CHUNK_BYTES {
            self.file.chunk(chunk)?;
        }
        Ok(true)
    }

    /// Ends the file with the result of the original, or with `result` if the original has none.
    fn finish(mut self, result: BTreeMap<String, String>) -> io::Result<()> {
        if let Some(chunk) = &mut self.chunk {
            self.file.chunk(chunk)?;
        }
        let new = || Metadata {
            name: RESULT.into(),
            metadata: result,
        };
        let result = self.result.take();
        self.file.finish(result.unwrap_or_else(new))
    }
}
