//! The recording: an MCAP file that other programs open, written as the run goes.
//!
//! Topic `/record` carries one message a step: the CDR form of the record, which is 4 bytes of
//! encapsulation and the very words that crossed shared memory, with a `ros2msg` schema made from the
//! tables. Topic `/events` carries every event as JSON. `log_time` is simulated time,
//! `publish_time` the monotonic clock. Chunks are closed on a time budget, so that what a killed
//! process loses is bounded in time.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::{Duration, Instant};

use mcap::records::MessageHeader;
use mcap::{Attachment, McapResult, WriteOptions, Writer};
use shared_types::record::{Event, GROUPS, RECORD_VERSION, RecordLayout, RecordView, Timing};
use shared_types::zerocopy::IntoBytes;

use crate::cli::run::Compression;

/// Longest time that a chunk stays open.
const CHUNK_TIME: Duration = Duration::from_millis(100);
/// Largest chunk in bytes.
const CHUNK_BYTES: u64 = 1 << 20;
/// CDR, little-endian, no options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// Line between the parts of a `ros2msg` schema.
pub(crate) const RULER: &str =
    "================================================================================";

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
    writer: Writer<BufWriter<File>>,
    records: u16,
    events: u16,
    message: Vec<u8>,
    chunk_since: Instant,
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
    ) -> McapResult<Self> {
        let compression = match compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        };
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .library(concat!("hil ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .chunk_size(Some(CHUNK_BYTES))
            .create(BufWriter::with_capacity(1 << 16, File::create(path)?))?;
        writer.write_metadata(&mcap::records::Metadata {
            name: "hil.run".into(),
            metadata: provenance.facts.clone(),
        })?;
        for enclosure in &provenance.enclosures {
            writer.attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: enclosure.name.into(),
                media_type: enclosure.media_type.into(),
                data: Cow::Borrowed(enclosure.text.as_bytes()),
            })?;
        }
        let nothing = BTreeMap::new();
        let schema =
            writer.add_schema("hil_msgs/msg/Record", "ros2msg", schema(layout).as_bytes())?;
        let version = BTreeMap::from([("version".into(), RECORD_VERSION.to_string())]);
        let records = writer.add_channel(schema, "/record", "cdr", &version)?;
        let schema = writer.add_schema("hil.Event", "jsonschema", EVENT_SCHEMA.as_bytes())?;
        let events = writer.add_channel(schema, "/events", "json", &nothing)?;
        Ok(Self {
            writer,
            records,
            events,
            message: Vec::new(),
            chunk_since: Instant::now(),
            last_time_ns: 0,
            sequence: 0,
        })
    }

    /// Writes a record.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn record(&mut self, words: &[u64], view: &RecordView<'_>) -> McapResult<()> {
        self.message.clear();
        self.message.extend(ENCAPSULATION);
        self.message.extend(words.as_bytes());
        self.last_time_ns = view.timing.time_ns;
        let header = MessageHeader {
            channel_id: self.records,
            sequence: view.step as u32,
            log_time: view.timing.time_ns,
            publish_time: view.timing.published_ns,
        };
        self.writer.write_to_known_channel(&header, &self.message)
    }

    /// Writes an event.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn event(&mut self, event: &Event, time_ns: Option<u64>, now_ns: u64) -> McapResult<()> {
        self.sequence += 1;
        let header = MessageHeader {
            channel_id: self.events,
            sequence: self.sequence,
            log_time: time_ns.unwrap_or(self.last_time_ns),
            publish_time: now_ns,
        };
        let json = serde_json::to_vec(event).map_err(std::io::Error::from)?;
        self.writer.write_to_known_channel(&header, &json)
    }

    /// Closes the chunk if it was open for long enough.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn keep_up(&mut self) -> McapResult<()> {
        if self.chunk_since.elapsed() >= CHUNK_TIME {
            self.writer.flush()?;
            self.chunk_since = Instant::now();
        }
        Ok(())
    }

    /// Writes down what is known after the run and closes the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self, result: BTreeMap<String, String>) -> McapResult<()> {
        let metadata = mcap::records::Metadata {
            name: "hil.result".into(),
            metadata: result,
        };
        self.writer.write_metadata(&metadata)?;
        self.writer.finish()?;
        self.writer
            .into_inner()
            .into_inner()
            .map_err(std::io::IntoInnerError::into_error)?
            .sync_all()?;
        Ok(())
    }
}

/// The schema of a record: a message of words with one nested message for each group of signals.
/// An empty group has no message, because an empty message takes a byte in CDR.
fn schema(layout: &RecordLayout) -> String {
    let mut text = String::from("uint64 step\n");
    let mut nested = String::new();
    let sample_words = layout.sample_validity_words();
    let command_words = layout.command_validity_words();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "uint64[{sample_words}] sample_invalid");
    let _ = writeln!(text, "uint64[{command_words}] command_invalid");
    for (group, fields) in GROUPS.iter().zip(layout.groups()) {
        if fields.is_empty() {
            continue;
        }
        let (first, rest) = group.split_at(1);
        let message = format!("{}{rest}", first.to_uppercase());
        let _ = writeln!(text, "hil_msgs/{message} {group}");
        let _ = writeln!(nested, "{RULER}\nMSG: hil_msgs/{message}");
        for field in fields {
            let told = field.description.replace('\n', " ");
            // Groups of parameters have a dot, which the names of this language may not.
            let name = field.name.replace('.', "_");
            let _ = writeln!(nested, "float64 {name} # [{}] {told}", field.unit);
        }
    }
    for name in Timing::NAMES {
        let _ = writeln!(text, "uint64 {name}");
    }
    text + &nested
}

/// Events are few and differ in form; the schema says what all have.
const EVENT_SCHEMA: &str = r#"{
  "$schema": "https://json-schema.org/draft/2020-12/schema",
  "title": "hil.Event",
  "type": "object",
  "properties": {
    "event": {
      "enum": ["accepted", "fault", "fault-ended", "end"],
      "description": "accepted: a live fault was accepted; fault: one took hold of a target; fault-ended: it let go; end: the run ended"
    },
    "step": {"type": "integer", "description": "the next step, the first with the fault, the first without it"}
  },
  "required": ["event"]
}"#;

#[cfg(test)]
mod tests {
    use shared_types::table::Field;

    use super::*;

    #[test]
    fn a_schema_has_a_message_for_each_group_that_has_signals() {
        let angle = Field::signal("angle_rad", "rad", "The angle.");
        let layout = RecordLayout {
            truth: vec![angle.clone()],
            command: vec![angle],
            command_signals: 1,
            ..RecordLayout::default()
        };
        let text = schema(&layout);
        let (head, nested) = text.split_once(RULER).expect("nested messages");
        let fields: Vec<&str> = head.lines().take(6).collect();
        assert_eq!(
            fields,
            [
                "uint64 step",
                "uint64[1] sample_invalid",
                "uint64[1] command_invalid",
                "hil_msgs/Truth truth",
                "hil_msgs/Command command",
                "hil_msgs/Applied applied",
            ]
        );
        assert!(nested.contains("MSG: hil_msgs/Truth\nfloat64 angle_rad # [rad] The angle.\n"));
        assert!(!text.contains("Internal"));
    }
}
