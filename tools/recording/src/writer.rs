//! The recording: an MCAP file that other programs open, written as the run goes.
//!
//! Topic `/record` carries one message a step: the CDR form of the record, which is 4 bytes of
//! encapsulation and the very words that crossed shared memory, with a `ros2msg` schema made from the
//! tables. Topic `/events` carries every event in the same way. `log_time` is simulated time,
//! `publish_time` the monotonic clock. Chunks are closed on a time budget, so that what a killed
//! process loses is bounded in time.

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
/// A chunk of N bytes is closed. With the message that makes it full it stays far below the
/// 4 MiB of an LZ4 block.
pub(super) const CHUNK_BYTES: usize = 1 << 20;
/// The facts of a run; there may be several lists of them, one after another.
pub(super) const FACTS: &str = "hil.run";
/// Facts that are known after a run.
pub(crate) const RESULT: &str = "hil.result";
/// Room that is kept on the disk for the end: a chunk, and what the summary has of each chunk.
const RESERVE_BYTES: u64 = 4 << 20;
/// Channels: records and events.
pub(super) const CHANNELS: u16 = 2;

/// A text file that travels in the recording.
#[derive(Clone, Debug)]
pub struct Attachment {
    /// File name.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub text: String,
}

/// Facts and files of a run that its recording carries.
#[derive(Clone, Debug, Default)]
pub struct Provenance {
    /// Facts known before the run, by name.
    pub facts: BTreeMap<String, String>,
    /// Files.
    pub attachments: Vec<Attachment>,
}

/// A part of a run.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Choice of what is kept.
    pub choice: &'a Choice,
    /// The rate of the run.
    pub rate: Rate,
    /// Last record.
    pub last: Step,
}

/// A recording being written.
pub struct Recording {
    file: McapFile,
    records: u16,
    events: u16,
    chunk: Chunk,
    /// Choice of what is kept, if not all is.
    excerpt: Option<Excerpt>,
    /// Records in the chunks.
    written: u64,
    /// Records in closed chunks.
    safe: u64,
    /// Room for its end on a full disk.
    reserve: Reserve,
    last_time_ns: u64,
    sequence: u32,
}

impl Recording {
    /// Creates the file and writes down what is known before the first record. Without a part all is
    /// kept.
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
        // Who mends recordings leaves this one alone. Where files have no locks nobody can be warned.
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

    /// Writes down more facts of the run.
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

    /// Writes the rows of an excerpt that need not wait any longer; all of them at the end.
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

    /// Records in the file, those of its open chunk included.
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
            // Records stand before what comes after them.
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

    /// Closes the chunk if it was open for long enough.
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

    /// Closes the last chunk, into the room that was kept for it if there is no other.
    ///
    /// # Errors
    /// If the chunk cannot be written. Chunks that were closed before are in the file.
    pub fn close(&mut self) -> io::Result<()> {
        self.reserve.release();
        self.settle(true)?;
        self.close_if(true)
    }

    /// Records in closed chunks, which are in the file whatever happens.
    #[must_use]
    pub const fn safe(&self) -> u64 {
        self.safe
    }

    /// Writes down what is known after the run and ends the file, after the last closed chunk.
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

/// The head of a record's message.
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
