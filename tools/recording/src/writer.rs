//! Writer of a recording: an MCAP file that other programs can open, written during the run.
//!
//! Topic `/record` carries one message per step: the record in CDR, which is 4 bytes of encapsulation followed by the
//! exact words from shared memory, with a `ros2msg` schema derived from the tables. Topic `/events` carries every
//! event in the same way. `log_time` is the simulated time, `publish_time` the monotonic clock. Chunks are closed
//! after a limited time, which bounds the loss if the process is killed.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::Path;
use std::time::Duration;

use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use rustix::fs::FlockOperation;
use shared_types::record::{
    Event, FaultAccepted, FaultBegun, FaultEnded, RECORD_VERSION, RecordLayout, RecordView,
};
use shared_types::time::{Rate, Step};

use super::chunk::Chunk;
use super::excerpt::{Choice, Excerpt, Head};
use super::mcap_file::McapFile;
use super::{event, schema};
use crate::compression::Compression;
use crate::reserve::Reserve;

/// Longest time that a chunk stays open.
const CHUNK_TIME: Duration = Duration::from_millis(100);
/// Size at which a chunk is closed, in bytes. Even with the message that exceeds this size, the chunk stays far below
/// the 4 MiB of an LZ4 block.
pub(super) const CHUNK_BYTES: usize = 1 << 20;
/// Metadata record with facts about a run; there may be several.
pub(super) const FACTS: &str = "hil.run";
/// Metadata record with facts that are known after a run.
pub(crate) const RESULT: &str = "hil.result";
/// Disk space reserved for the end, in bytes: a chunk, and the summary entries of all chunks.
const RESERVE_BYTES: u64 = 4 << 20;
/// Number of channels: records and events.
pub(super) const CHANNELS: u16 = 2;

/// Text file attached to a recording.
#[derive(Clone, Debug)]
pub struct Attachment {
    /// File name.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub text: String,
}

/// Facts about a run and attached files.
#[derive(Clone, Debug, Default)]
pub struct Provenance {
    /// Facts known before the run, by name.
    pub facts: BTreeMap<String, String>,
    /// Attached files.
    pub attachments: Vec<Attachment>,
}

/// Part of a run to record.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Selection of signals and steps.
    pub choice: &'a Choice,
    /// Rate of the run.
    pub rate: Rate,
    /// Step of the last record.
    pub last: Step,
}

/// Recording open for writing.
pub struct Recording {
    file: McapFile,
    records: u16,
    events: u16,
    chunk: Chunk,
    /// Selection of rows, if not all are recorded.
    excerpt: Option<Excerpt>,
    /// Number of records in the chunks.
    written: u64,
    /// Number of records in closed chunks.
    safe: u64,
    /// Disk space reserved for the end.
    reserve: Reserve,
    last_time_ns: u64,
    sequence: u32,
}

impl Recording {
    /// Creates the file and writes everything that is known before the first record. Without a `part` the whole run
    /// is recorded.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(
        path: &Path,
        compression: Compression,
        layout: &RecordLayout,
        provenance: &Provenance,
        part: Option<Part<'_>>,
    ) -> io::Result<Self> {
        let excerpt = part.map(|part| Excerpt::new(layout, part.choice, part.rate, part.last));
        let excerpt = excerpt.transpose().map_err(io::Error::other)?;
        let library = concat!("hil ", env!("CARGO_PKG_VERSION"));
        let file = File::create(path)?;
        // `hil recover` leaves a locked file alone. Without file locks it cannot be warned.
        let _ = rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive);
        let mut file = McapFile::create(file, "ros2", library)?;
        file.metadata(Metadata {
            name: FACTS.into(),
            metadata: provenance.facts.clone(),
        })?;
        for attachment in &provenance.attachments {
            let header = AttachmentHeader {
                log_time: 0,
                create_time: 0,
                name: attachment.name.into(),
                media_type: attachment.media_type.into(),
            };
            file.attachment(header, attachment.text.as_bytes())?;
        }
        let schema = match &excerpt {
            None => schema::record(layout),
            Some(excerpt) => {
                let (sample, command, groups) = excerpt.form();
                schema::of(sample, command, groups)
            }
        };
        let schema = file.schema(schema::RECORD_NAME, schema::LANGUAGE, schema.as_bytes())?;
        let version = BTreeMap::from([("version".into(), RECORD_VERSION.to_string())]);
        let records = file.channel(schema, schema::RECORD_TOPIC, schema::ENCODING, version)?;
        let form = schema::event();
        let schema = file.schema(schema::EVENT_NAME, schema::LANGUAGE, form.as_bytes())?;
        let none = BTreeMap::new();
        let events = file.channel(schema, schema::EVENT_TOPIC, schema::ENCODING, none)?;
        file.mark()?;
        Ok(Self {
            file,
            records,
            events,
            chunk: Chunk::new(compression, CHANNELS)?,
            excerpt,
            written: 0,
            safe: 0,
            reserve: Reserve::of(path.parent().unwrap_or(Path::new("")), RESERVE_BYTES),
            last_time_ns: 0,
            sequence: 0,
        })
    }

    /// Writes more facts about the run.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn facts(&mut self, facts: BTreeMap<String, String>) -> io::Result<()> {
        self.file.metadata(Metadata {
            name: FACTS.into(),
            metadata: facts,
        })
    }

    /// Writes a record.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn record(&mut self, words: &[u64], view: &RecordView<'_>) -> io::Result<()> {
        self.last_time_ns = view.timing.time_ns;
        if let Some(excerpt) = &mut self.excerpt {
            excerpt.take(words, view);
            return self.settle(false);
        }
        self.written += 1;
        self.chunk
            .record(&header(self.records, Head::of(view)), words);
        self.close_if(self.chunk.bytes() >= CHUNK_BYTES)
    }

    /// Writes the excerpt's rows that are ready; at the end also the remaining ones.
    fn settle(&mut self, is_over: bool) -> io::Result<()> {
        while let Some((head, row)) =
            (self.excerpt.as_mut()).and_then(|excerpt| excerpt.next(is_over))
        {
            self.written += 1;
            self.chunk.record(&header(self.records, head), row);
            self.close_if(self.chunk.bytes() >= CHUNK_BYTES)?;
        }
        Ok(())
    }

    /// Returns the number of records in the file, including those of the open chunk.
    #[must_use]
    pub const fn written(&self) -> u64 {
        self.written
    }

    /// Writes an event.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn event(&mut self, event: &Event, time_ns: Option<u64>, now_ns: u64) -> io::Result<()> {
        if let Some(excerpt) = &mut self.excerpt {
            match event {
                Event::Accepted(FaultAccepted { step, .. })
                | Event::Fault(FaultBegun { step, .. })
                | Event::FaultEnded(FaultEnded { step, .. }) => excerpt.fault(*step),
                Event::Controller(_) | Event::Change(_) | Event::Mark(_) | Event::End(_) => {}
            }
            // Records precede later events.
            self.settle(matches!(event, Event::End(_)))?;
        }
        self.sequence += 1;
        let header = MessageHeader {
            channel_id: self.events,
            sequence: self.sequence,
            log_time: time_ns.unwrap_or(self.last_time_ns),
            publish_time: now_ns,
        };
        self.chunk.message(&header, &event::message(event)?);
        self.close_if(self.chunk.bytes() >= CHUNK_BYTES)
    }

    /// Closes the chunk if it has been open long enough.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn keep_up(&mut self) -> io::Result<()> {
        self.close_if(self.chunk.age() >= CHUNK_TIME)
    }

    fn close_if(&mut self, is_due: bool) -> io::Result<()> {
        if is_due {
            self.file.chunk(&mut self.chunk)?;
            self.safe = self.written;
        }
        Ok(())
    }

    /// Closes the last chunk, using the reserved space if the disk is full.
    ///
    /// # Errors
    /// If the chunk cannot be written; previously closed chunks are in the file.
    pub fn close(&mut self) -> io::Result<()> {
        self.reserve.release();
        self.settle(true)?;
        self.close_if(true)
    }

    /// Returns the number of records in closed chunks, which are safely in the file.
    #[must_use]
    pub const fn safe(&self) -> u64 {
        self.safe
    }

    /// Writes the facts that are known after the run and ends the file after the last closed chunk.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn end(self, result: BTreeMap<String, String>) -> io::Result<()> {
        self.file.finish(Metadata {
            name: RESULT.into(),
            metadata: result,
        })
    }

    /// Closes the last chunk and ends the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self, result: BTreeMap<String, String>) -> io::Result<()> {
        self.close()?;
        self.end(result)
    }
}

/// Builds the head of a record's message.
const fn header(channel_id: u16, head: Head) -> MessageHeader {
    MessageHeader {
        channel_id,
        sequence: head.step as u32,
        log_time: head.time_ns,
        publish_time: head.published_ns,
    }
}

#[cfg(test)]
mod tests;
