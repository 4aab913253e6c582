//! Reader of a recorded run: its records one by one, its events and its attachments.
//!
//! Used by every command that reads a recorded run. The file is read once and no record is retained, so memory does not
//! depend on the length of the run. Signal names come from the file's own schema, so recordings of unknown plants can
//! be read. A file whose writer was killed is read as far as possible.

mod columns;
pub(crate) mod content;
mod error;
mod form;
mod schema;
mod span;
mod validity;
mod vouched;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};
use serde::de::DeserializeOwned;
use shared_types::digest::Digest;
use shared_types::record::Event;
use shared_types::text;
use shared_types::time::Rate;

use crate::clean::clean;
use crate::schema::{ENCAPSULATION, EVENT_TOPIC, RECORD_TOPIC};
use crate::writer::{FACTS, RESULT};
use crate::{event, mark, part_file};
pub use columns::{Buffers, ColumnReader};
pub use content::FileEnd;
use content::{Content, ContentError};
pub use error::ReadError;
pub use schema::Column;
use span::MESSAGE_BYTES;
pub use span::SpanReader;
pub(crate) use vouched::VOUCHED;
pub use vouched::{UNVOUCHED, Unvouched};

/// Name of the recording in the folder of a run.
pub const RECORDING: &str = "run.mcap";
/// Fact that describes the selection of a partial recording.
pub const EXCERPT: &str = "excerpt";
/// Last step of the longest possible run; code that handles steps may rely on it.
const LAST_STEP: u64 = 1 << 40;

/// Reader of a recorded run, from its beginning.
pub struct RunReader {
    path: PathBuf,
    content: Content,
    columns: Vec<Column>,
    descriptions: BTreeMap<String, String>,
    hashed_words: usize,
    /// Channels by ID, with the encoding of events for channels that carry no records.
    channels: BTreeMap<u16, Option<String>>,
    schemas: BTreeMap<u16, String>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    attachments: BTreeMap<String, String>,
    words: Vec<u64>,
    /// Smallest valid step of the next record.
    next_step: u64,
    events: Vec<Event>,
    records: u64,
    digest: Digest,
    is_hashing: bool,
    /// Number of records covered by a later checksum; `None` before the first checksum.
    vouched: Option<u64>,
    /// Set if nothing followed the last checksum.
    is_vouched: bool,
}

/// Item of the file.
enum Next {
    /// Record of a step.
    Record(u64),
    Event(Box<Event>),
    /// Content that was stored or is irrelevant.
    Other,
    End,
}

impl RunReader {
    /// Opens a run, given its folder or its recording.
    ///
    /// # Errors
    /// If there is no recording, or the file is not a recording of a run.
    pub fn open(run: &Path) -> Result<Self, ReadError> {
        let path = if run.is_dir() {
            part_file::sweep(run);
            run.join(RECORDING)
        } else {
            run.to_owned()
        };
        if run.is_dir() && !path.exists() {
            return Err(ReadError::NoRecording(run.to_owned()));
        }
        let content = File::open(&path).and_then(Content::of);
        let content = content.map_err(|error| ReadError::Io {
            path: path.clone(),
            error,
        })?;
        let mut reader = Self {
            path,
            content,
            columns: Vec::new(),
            descriptions: BTreeMap::new(),
            hashed_words: 0,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            metadata: BTreeMap::new(),
            attachments: BTreeMap::new(),
            words: Vec::new(),
            next_step: 0,
            events: Vec::new(),
            records: 0,
            digest: Digest::default(),
            is_hashing: true,
            vouched: None,
            is_vouched: false,
        };
        // All facts known before a run precede its channels.
        while reader.columns.is_empty() {
            if matches!(reader.next()?, Next::End) {
                return Err(match reader.end() {
                    (Some(FileEnd::Whole), _) => {
                        reader.foreign("the file has no channel `/record`")
                    }
                    (_, length) => ReadError::Cut {
                        path: reader.path,
                        length,
                    },
                });
            }
        }
        Ok(reader)
    }

    /// Disables the digest, whose computation takes longer than everything else.
    #[must_use]
    pub fn without_digest(mut self) -> Self {
        self.is_hashing = false;
        self
    }

    /// Continues after a changed bit, which then becomes an error at the end.
    #[must_use]
    pub fn patient(mut self) -> Self {
        self.content.be_patient();
        self
    }

    fn foreign(&self, what: impl Into<String>) -> ReadError {
        ReadError::Foreign {
            path: self.path.clone(),
            what: what.into(),
        }
    }

    /// Returns the path of the recording.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the columns, one per word of a record.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Returns the description of a signal by the name of its column; `None` for words that are not signals.
    #[must_use]
    pub fn description(&self, name: &str) -> Option<&str> {
        self.descriptions.get(name).map(String::as_str)
    }

    /// Returns the index of a word of a record by its name.
    #[must_use]
    pub fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// Returns the number of leading words of a record that the digest covers.
    #[must_use]
    pub const fn hashed_words(&self) -> usize {
        self.hashed_words
    }

    /// Returns a fact that was stored before the run.
    #[must_use]
    pub fn fact(&self, name: &str) -> Option<&str> {
        self.metadata.get(FACTS)?.get(name).map(String::as_str)
    }

    /// Iterates over the facts that were stored before the run.
    pub fn facts(&self) -> impl Iterator<Item = (&str, &str)> {
        let facts = self.metadata.get(FACTS).into_iter().flatten();
        facts.map(|(name, fact)| (name.as_str(), fact.as_str()))
    }

    /// Returns a fact that was stored after the run; available only at the end of the file.
    #[must_use]
    pub fn result(&self, name: &str) -> Option<&str> {
        self.metadata.get(RESULT)?.get(name).map(String::as_str)
    }

    /// Returns the rate of the run.
    ///
    /// # Errors
    /// If the recording does not contain the rate.
    pub fn rate(&self) -> Result<Rate, ReadError> {
        let hz = self.fact("rate_hz").and_then(|hz| hz.parse().ok());
        hz.and_then(Rate::new)
            .ok_or_else(|| self.foreign("the file has no rate"))
    }

    /// Returns an attachment by its name.
    ///
    /// # Errors
    /// If there is no such attachment.
    pub fn attachment(&self, name: &str) -> Result<&str, ReadError> {
        let text = self.attachments.get(name).map(String::as_str);
        text.ok_or_else(|| self.foreign(format!("the file has no attachment `{name}`")))
    }

    /// Parses a JSON attachment.
    ///
    /// # Errors
    /// If there is no such attachment, or it is invalid.
    pub fn attached<T: DeserializeOwned>(&self, name: &str) -> Result<T, ReadError> {
        let text = self.attachment(name)?;
        serde_json::from_str(text).map_err(|error| self.foreign(format!("`{name}`: {error}")))
    }

    /// Reads the next record; returns `false` at the end.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        let is_record = self.advance_to_record()?;
        if is_record {
            self.words.clear();
            self.words.extend(words_of(&self.content));
            if self.is_hashing {
                self.digest.record(&self.words[..self.hashed_words]);
            }
        }
        Ok(is_record)
    }

    /// Reads the next record into a batch, behind the words that it has; returns `false` at the end. The record is
    /// neither the current one nor part of the digest.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn advance_into(&mut self, batch: &mut Vec<u64>) -> Result<bool, ReadError> {
        let is_record = self.advance_to_record()?;
        if is_record {
            batch.extend(words_of(&self.content));
        }
        Ok(is_record)
    }

    /// Reads the events up to the next record, and checks its step; returns `false` at the end.
    fn advance_to_record(&mut self) -> Result<bool, ReadError> {
        self.events.clear();
        loop {
            match self.next()? {
                Next::Other => {}
                Next::End => return Ok(false),
                Next::Event(event) => {
                    if self.is_hashing {
                        self.digest.event(&event);
                    }
                    self.events.push(*event);
                }
                Next::Record(step) => {
                    if step < self.next_step || step > LAST_STEP {
                        let next = self.next_step;
                        return Err(self.damaged(format!(
                            "step {step}, but expected step {next} or a later one"
                        )));
                    }
                    self.next_step = step + 1;
                    self.records += 1;
                    return Ok(true);
                }
            }
        }
    }

    /// Returns the words of the current record.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Returns the step of the last record; 0 before the first one.
    #[must_use]
    pub const fn step(&self) -> u64 {
        self.next_step.saturating_sub(1)
    }

    /// Returns the events between the previous record and this one; at the end, those after the last record.
    #[must_use]
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Returns the number of records so far.
    #[must_use]
    pub const fn records(&self) -> u64 {
        self.records
    }

    /// Returns the digest of the records so far; for an excerpt, the digest of the whole run, which is available at
    /// the end.
    #[must_use]
    pub fn digest(&self) -> String {
        if self.is_excerpt() {
            return self.result("digest").unwrap_or_default().to_owned();
        }
        self.digest.clone().finish()
    }

    /// Returns `true` if the recording contains only a part of the run.
    #[must_use]
    pub fn is_excerpt(&self) -> bool {
        self.fact(EXCERPT).is_some()
    }

    /// Refuses an excerpt.
    ///
    /// # Errors
    /// If the recording is an excerpt; the error describes its selection.
    pub fn refuse_excerpt(&self) -> Result<(), ReadError> {
        match self.fact(EXCERPT) {
            None => Ok(()),
            Some(selection) => Err(ReadError::Excerpt {
                path: self.path.clone(),
                selection: selection.to_owned(),
            }),
        }
    }

    /// Returns `true` if the file was completed by its writer; known at the end.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.content.end() == Some(FileEnd::Whole)
    }

    /// Returns the kind of end, complete or truncated, and the size of the file in bytes; known at the end.
    #[must_use]
    pub fn end(&self) -> (Option<FileEnd>, u64) {
        (self.content.end(), self.content.length())
    }

    /// Returns the offset of the next record outside of chunks.
    #[must_use]
    pub const fn position(&self) -> u64 {
        self.content.position()
    }

    fn next(&mut self) -> Result<Next, ReadError> {
        let opcode = match self.content.advance() {
            Ok(None) => return Ok(Next::End),
            Ok(Some(opcode)) => opcode,
            Err(error) => return Err(self.broken(error)),
        };
        self.is_vouched = matches!(opcode, mark::OPCODE | op::DATA_END);
        if self.is_vouched {
            self.vouched = Some(self.records);
        }
        let record = match self.content.record(opcode) {
            Ok(record) => record,
            Err(what) => return Err(self.damaged(what)),
        };
        match record {
            Record::Schema { header, data } => {
                let text = text::printable(&String::from_utf8_lossy(&data)).into_owned();
                self.schemas.insert(header.id, text);
            }
            Record::Channel(channel) if channel.topic == RECORD_TOPIC => {
                self.channels.insert(channel.id, None);
                let schema = self.schemas.get(&channel.schema_id);
                let schema = schema.map_or("", String::as_str);
                let Some(columns) = schema::columns_of(schema) else {
                    return Err(self.foreign("the file's schema is invalid"));
                };
                if !self.columns.is_empty() && columns != self.columns {
                    return Err(
                        self.damaged(format!("the definition of channel {RECORD_TOPIC} changes"))
                    );
                }
                self.columns = columns;
                self.hashed_words = schema::hashed(&self.columns);
                self.descriptions = schema::descriptions_of(schema);
            }
            Record::Channel(channel) if channel.topic == EVENT_TOPIC => {
                (self.channels).insert(channel.id, Some(channel.message_encoding));
            }
            Record::Metadata(metadata) => {
                let facts = self.metadata.entry(metadata.name).or_default();
                let printable =
                    |(name, fact): (String, String)| (name, text::printable(&fact).into_owned());
                facts.extend(metadata.metadata.into_iter().map(printable));
            }
            Record::Attachment { header, data, .. } => {
                let text = String::from_utf8_lossy(&data).into_owned();
                self.attachments.insert(header.name, text);
            }
            Record::Message { header, data } => match self.channels.get(&header.channel_id) {
                Some(None) if data.len() == ENCAPSULATION.len() + 8 * self.columns.len() => {
                    let step = data[ENCAPSULATION.len()..].first_chunk();
                    return Ok(Next::Record(
                        step.map_or(0, |step| u64::from_le_bytes(*step)),
                    ));
                }
                Some(None) => {
                    let bytes = data.len();
                    let what = format!("a record of {bytes} bytes does not fit its schema");
                    return Err(self.damaged(what));
                }
                Some(Some(encoding)) => {
                    return match event::read(encoding, &data) {
                        Ok(event) => Ok(Next::Event(Box::new(clean(event)))),
                        Err(error) => Err(self.damaged(format!("an event: {error}"))),
                    };
                }
                None => {}
            },
            _ => {}
        }
        Ok(Next::Other)
    }

    fn broken(&self, error: ContentError) -> ReadError {
        let path = self.path.clone();
        match error {
            ContentError::Io(error) => ReadError::Io { path, error },
            // Before the facts of a run it may be any file.
            ContentError::Damaged { what, .. } if !self.metadata.contains_key(FACTS) => {
                self.foreign(what)
            }
            ContentError::Damaged { at, what } => ReadError::Damaged {
                path,
                what,
                at,
                length: self.content.length(),
                records: self.records,
            },
        }
    }

    fn damaged(&self, what: String) -> ReadError {
        let at = self.content.position();
        self.broken(ContentError::Damaged { at, what })
    }
}

/// Decodes the words of the record that a file is at.
fn words_of(content: &Content) -> impl Iterator<Item = u64> {
    let (words, _) = content.data()[MESSAGE_BYTES + ENCAPSULATION.len()..].as_chunks();
    words.iter().map(|word| u64::from_le_bytes(*word))
}

/// Returns the folder of a run, given the folder or its recording.
#[must_use]
pub fn folder_of(run: &Path) -> &Path {
    match run.parent() {
        Some(parent) if !run.is_dir() => parent,
        _ => run,
    }
}

/// Computes the digest of the first records of a run.
///
/// # Errors
/// If the recording cannot be read.
pub fn digest_of_first(run: &Path, records: u64) -> Result<String, ReadError> {
    let mut reader = RunReader::open(run)?;
    while reader.records() < records && reader.advance()? {}
    Ok(reader.digest())
}

#[cfg(test)]
mod tests;
