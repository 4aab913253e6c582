//! The recording: an MCAP file that other programs open, written as the run goes.
//!
//! Topic `/record` carries one message a step: the CDR form of the record, which is 4 bytes of
//! encapsulation and the very words that crossed shared memory, with a `ros2msg` schema made from the
//! tables. Topic `/events` carries every event as JSON. `log_time` is simulated time,
//! `publish_time` the monotonic clock. Chunks are closed on a time budget, so that what a killed
//! process loses is bounded in time.

mod chunk;
mod lz4;
mod mcap_file;
mod schema;

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::Duration;

use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use shared_types::record::{Event, RECORD_VERSION, RecordLayout, RecordView};

use crate::cli::run::Compression;
use chunk::Chunk;
use mcap_file::McapFile;
pub(crate) use schema::RULER;

/// Longest time that a chunk stays open.
const CHUNK_TIME: Duration = Duration::from_millis(100);
/// A chunk of so many bytes is closed. With the message that makes it full it stays far below the
/// 4 MiB of an LZ4 block.
const CHUNK_BYTES: usize = 1 << 20;
/// The facts of a run; there may be several lists of them, one after another.
const FACTS: &str = "hil.run";
/// Channels: records and events.
const CHANNELS: u16 = 2;

/// A text file that travels in the recording.
#[derive(Clone, Debug)]
pub struct Enclosure {
    /// File name.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub text: String,
}

/// What a recording says of its run.
#[derive(Clone, Debug, Default)]
pub struct Provenance {
    /// Facts known before the run, by name.
    pub facts: BTreeMap<String, String>,
    /// Files.
    pub enclosures: Vec<Enclosure>,
}

/// A recording being written.
pub struct Recording {
    file: McapFile,
    records: u16,
    events: u16,
    chunk: Chunk,
    last_time_ns: u64,
    sequence: u32,
}

impl Recording {
    /// Creates the file and writes down what is known before the first record.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(
        path: &Path,
        compression: Compression,
        layout: &RecordLayout,
        provenance: &Provenance,
    ) -> io::Result<Self> {
        let library = concat!("hil ", env!("CARGO_PKG_VERSION"));
        let mut file = McapFile::create(path, "ros2", library)?;
        file.metadata(Metadata {
            name: FACTS.into(),
            metadata: provenance.facts.clone(),
        })?;
        for enclosure in &provenance.enclosures {
            let header = AttachmentHeader {
                log_time: 0,
                create_time: 0,
                name: enclosure.name.into(),
                media_type: enclosure.media_type.into(),
            };
            file.attachment(header, enclosure.text.as_bytes())?;
        }
        let schema = schema::record(layout);
        let schema = file.schema("hil_msgs/msg/Record", "ros2msg", schema.as_bytes())?;
        let version = BTreeMap::from([("version".into(), RECORD_VERSION.to_string())]);
        let records = file.channel(schema, "/record", "cdr", version)?;
        let schema = file.schema("hil.Event", "jsonschema", schema::EVENT.as_bytes())?;
        let events = file.channel(schema, "/events", "json", BTreeMap::new())?;
        Ok(Self {
            file,
            records,
            events,
            chunk: Chunk::new(compression, CHANNELS)?,
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
        let header = MessageHeader {
            channel_id: self.records,
            sequence: view.step as u32,
            log_time: view.timing.time_ns,
            publish_time: view.timing.published_ns,
        };
        self.chunk.record(&header, words);
        self.close_if(self.chunk.bytes() >= CHUNK_BYTES)
    }

    /// Writes an event.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn event(&mut self, event: &Event, time_ns: Option<u64>, now_ns: u64) -> io::Result<()> {
        self.sequence += 1;
        let header = MessageHeader {
            channel_id: self.events,
            sequence: self.sequence,
            log_time: time_ns.unwrap_or(self.last_time_ns),
            publish_time: now_ns,
        };
        self.chunk.message(&header, &serde_json::to_vec(event)?);
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
        }
        Ok(())
    }

    /// Writes down what is known after the run and closes the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self, result: BTreeMap<String, String>) -> io::Result<()> {
        self.file.chunk(&mut self.chunk)?;
        self.file.metadata(Metadata {
            name: "hil.result".into(),
            metadata: result,
        })?;
        self.file.finish()
    }
}

#[cfg(test)]
mod tests;
