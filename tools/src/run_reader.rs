//! Reads a recorded run: its records one by one, its events, and the files that travel with it.
//!
//! Used by `hil compare`, `hil export`, `hil rerun` and `hil scenario from`. Goes through the file once and keeps
//! no record, so the length of a run does not matter. Takes what a file says of itself: the names
//! of signals come from its schema, so the recording of a plant that is not here can be read. A file
//! whose writer was killed is read as far as it goes.

mod schema;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::de::DeserializeOwned;
use shared_types::digest::Digest;
use shared_types::record::Event;
use shared_types::time::Rate;

pub use schema::Column;

/// Name of the recording in the folder of a run.
pub const RECORDING: &str = "run.mcap";
/// The fact that says what was kept, if not all was.
pub const EXCERPT: &str = "excerpt";
/// Bytes of encapsulation in front of a record.
const ENCAPSULATION: usize = 4;

/// Longest record of a file: a size beyond that is damage, not memory to ask for.
const LONGEST_RECORD: usize = 1 << 28;

/// The last step of the longest run that a scenario can ask for; what follows steps may count on it.
const LAST_STEP: u64 = 1 << 40;

/// A run cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The folder of a run has no recording.
    #[error("{0} has no recording; it was run with --no-record, or is no run's folder")]
    NoRecording(PathBuf),
    /// The file cannot be read.
    #[error("cannot read {path}: {error}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        error: std::io::Error,
    },
    /// Only a part of the run was kept.
    #[error(
        "{path} is an excerpt ({kept}); this needs the whole run: record it without --record, --record-every and --record-around-faults"
    )]
    Excerpt {
        /// The file.
        path: PathBuf,
        /// What was kept.
        kept: String,
    },
    /// The file is not what `hil run` writes.
    #[error("{path} is no recording of a run: {what}")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// A recorded run, read from its begin.
pub struct RunReader {
    path: PathBuf,
    file: File,
    mcap: LinearReader,
    columns: Vec<Column>,
    hashed_words: usize,
    /// Channels by number: whether they carry records.
    channels: BTreeMap<u16, bool>,
    schemas: BTreeMap<u16, String>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    enclosures: BTreeMap<String, String>,
    words: Vec<u64>,
    /// The first step that the next record may have.
    next_step: u64,
    events: Vec<Event>,
    records: u64,
    digest: Digest,
    is_hashing: bool,
    is_whole: bool,
}

/// What came next in the file.
enum Next {
    Record,
    Event(Event),
    /// Something that was kept or that means nothing here.
    Other,
    End,
}

impl RunReader {
    /// Opens a run: its folder, or its recording.
    ///
    /// # Errors
    /// If there is no recording, or it is none of a run.
    pub fn open(run: &Path) -> Result<Self, ReadError> {
        let path = if run.is_dir() {
            run.join(RECORDING)
        } else {
            run.to_owned()
        };
        if run.is_dir() && !path.exists() {
            return Err(ReadError::NoRecording(run.to_owned()));
        }
        let file = File::open(&path).map_err(|error| ReadError::Io {
            path: path.clone(),
            error,
        })?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_record_length_limit(LONGEST_RECORD)
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true);
        let mut reader = Self {
            path,
            file,
            mcap: LinearReader::new_with_options(options),
            columns: Vec::new(),
            hashed_words: 0,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            metadata: BTreeMap::new(),
            enclosures: BTreeMap::new(),
            words: Vec::new(),
            next_step: 0,
            events: Vec::new(),
            records: 0,
            digest: Digest::default(),
            is_hashing: true,
            is_whole: false,
        };
        // All that is known before a run stands before its channels.
        while reader.columns.is_empty() {
            if matches!(reader.next()?, Next::End) {
                return Err(reader.foreign("it has no channel `/record`"));
            }
        }
        Ok(reader)
    }

    /// The same for who does not ask for the digest, which takes longer than all else.
    #[must_use]
    pub fn without_digest(mut self) -> Self {
        self.is_hashing = false;
        self
    }

    fn foreign(&self, what: impl Into<String>) -> ReadError {
        ReadError::Foreign {
            path: self.path.clone(),
            what: what.into(),
        }
    }

    /// The recording's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The words of a record.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// How many of them the digest covers, from the first.
    #[must_use]
    pub const fn hashed_words(&self) -> usize {
        self.hashed_words
    }

    /// A fact that was written down before the run.
    #[must_use]
    pub fn fact(&self, name: &str) -> Option<&str> {
        self.metadata.get("hil.run")?.get(name).map(String::as_str)
    }

    /// A fact that was written down after the run; only at the end of the file.
    #[must_use]
    pub fn result(&self, name: &str) -> Option<&str> {
        self.metadata
            .get("hil.result")?
            .get(name)
            .map(String::as_str)
    }

    /// The rate of the run.
    ///
    /// # Errors
    /// If the recording does not say.
    pub fn rate(&self) -> Result<Rate, ReadError> {
        let hz = self.fact("rate_hz").and_then(|hz| hz.parse().ok());
        hz.and_then(Rate::new)
            .ok_or_else(|| self.foreign("it does not say its rate"))
    }

    /// A file that travels with it.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn enclosure(&self, name: &str) -> Result<&str, ReadError> {
        let text = self.enclosures.get(name).map(String::as_str);
        text.ok_or_else(|| self.foreign(format!("it does not carry `{name}`")))
    }

    /// A JSON file that travels with it.
    ///
    /// # Errors
    /// If there is none of that name, or it cannot be understood.
    pub fn enclosed<T: DeserializeOwned>(&self, name: &str) -> Result<T, ReadError> {
        let text = self.enclosure(name)?;
        serde_json::from_str(text).map_err(|error| self.foreign(format!("`{name}`: {error}")))
    }

    /// Goes to the next record; whether there is one.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        self.events.clear();
        loop {
            match self.next()? {
                Next::Other => {}
                Next::End => return Ok(false),
                Next::Event(event) => {
                    if let Event::Fault(taken) = &event
                        && self.is_hashing
                    {
                        self.digest.fault(taken);
                    }
                    self.events.push(event);
                }
                Next::Record => {
                    let step = self.step();
                    if step < self.next_step || step > LAST_STEP {
                        let (records, next) = (self.records, self.next_step);
                        return Err(self.foreign(format!(
                            "damaged after {records} records: step {step} where step {next} or a later one comes"
                        )));
                    }
                    self.next_step = step + 1;
                    if self.is_hashing {
                        self.digest.record(&self.words[..self.hashed_words]);
                    }
                    self.records += 1;
                    return Ok(true);
                }
            }
        }
    }

    /// The record, as words.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// The step of the record.
    #[must_use]
    pub fn step(&self) -> u64 {
        self.words[0]
    }

    /// What happened after the record before this one; at the end, after the last.
    #[must_use]
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Records so far.
    #[must_use]
    pub const fn records(&self) -> u64 {
        self.records
    }

    /// The digest of what was read so far; of an excerpt that of the whole run, known at the end.
    #[must_use]
    pub fn digest(&self) -> String {
        if self.is_excerpt() {
            return self.result("digest").unwrap_or_default().to_owned();
        }
        self.digest.clone().finish()
    }

    /// Whether not all of the run was kept.
    #[must_use]
    pub fn is_excerpt(&self) -> bool {
        self.fact(EXCERPT).is_some()
    }

    /// Refuses an excerpt.
    ///
    /// # Errors
    /// If it is one, with what was kept.
    pub fn refuse_excerpt(&self) -> Result<(), ReadError> {
        match self.fact(EXCERPT) {
            None => Ok(()),
            Some(kept) => Err(ReadError::Excerpt {
                path: self.path.clone(),
                kept: kept.to_owned(),
            }),
        }
    }

    /// Whether the writer of the file finished it; known at the end.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.is_whole
    }

    fn next(&mut self) -> Result<Next, ReadError> {
        loop {
            let (opcode, data) = match self.mcap.next_event() {
                None => return Ok(Next::End),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    // More than is wanted, a record at a time would be a system call each; and not
                    // all of what a damaged length may want, which would be memory for nothing.
                    let room = wanted.clamp(1 << 16, 1 << 20);
                    let read = self.file.read(self.mcap.insert(room));
                    let read = read.map_err(|error| ReadError::Io {
                        path: self.path.clone(),
                        error,
                    })?;
                    self.mcap.notify_read(read);
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
                // Its writer was killed here.
                Some(Err(mcap::McapError::UnexpectedEof)) if !self.columns.is_empty() => {
                    return Ok(Next::End);
                }
                Some(Err(error)) if !self.columns.is_empty() => {
                    let (records, what) = (self.records, error.to_string());
                    return Err(self.foreign(format!("damaged after {records} records: {what}")));
                }
                Some(Err(error)) => {
                    let what = error.to_string();
                    return Err(self.foreign(what));
                }
            };
            let record = match mcap::parse_record(opcode, data) {
                Ok(record) => record,
                Err(error) => {
                    let what = error.to_string();
                    return Err(self.foreign(what));
                }
            };
            let (path, columns) = (&self.path, self.columns.len());
            let foreign = |what: String| ReadError::Foreign {
                path: path.clone(),
                what,
            };
            match record {
                Record::Schema { header, data } => {
                    self.schemas
                        .insert(header.id, String::from_utf8_lossy(&data).into_owned());
                }
                Record::Channel(channel) if channel.topic == "/record" => {
                    self.channels.insert(channel.id, true);
                    let schema = self
                        .schemas
                        .get(&channel.schema_id)
                        .map_or("", String::as_str);
                    let columns = schema::columns_of(schema)
                        .ok_or_else(|| foreign("its schema cannot be understood".into()))?;
                    // The end of a file repeats its channels.
                    if !self.columns.is_empty() && columns != self.columns {
                        return Err(foreign("its channel `/record` changes".into()));
                    }
                    self.columns = columns;
                    self.hashed_words = schema::hashed(&self.columns);
                }
                Record::Channel(channel) if channel.topic == "/events" => {
                    self.channels.insert(channel.id, false);
                }
                Record::Metadata(metadata) => {
                    let facts = self.metadata.entry(metadata.name).or_default();
                    facts.extend(metadata.metadata);
                }
                Record::Attachment { header, data, .. } => {
                    let text = String::from_utf8_lossy(&data).into_owned();
                    self.enclosures.insert(header.name, text);
                }
                Record::Message { header, data } => match self.channels.get(&header.channel_id) {
                    Some(true) if data.len() == ENCAPSULATION + 8 * columns => {
                        let words = data[ENCAPSULATION..].as_chunks::<8>().0;
                        self.words.clear();
                        self.words
                            .extend(words.iter().map(|word| u64::from_le_bytes(*word)));
                        return Ok(Next::Record);
                    }
                    Some(true) => {
                        let bytes = data.len();
                        return Err(foreign(format!(
                            "a record of {bytes} bytes does not fit its schema"
                        )));
                    }
                    Some(false) => {
                        let event = serde_json::from_slice(&data);
                        return Ok(Next::Event(
                            event.map_err(|error| foreign(format!("an event: {error}")))?,
                        ));
                    }
                    None => {}
                },
                Record::DataEnd(_) => self.is_whole = true,
                _ => {}
            }
            return Ok(Next::Other);
        }
    }
}

/// The digest of the first records of a run.
///
/// # Errors
/// If it cannot be read.
pub fn digest_of_first(run: &Path, records: u64) -> Result<String, ReadError> {
    let mut reader = RunReader::open(run)?;
    while reader.records() < records && reader.advance()? {}
    Ok(reader.digest())
}

#[cfg(test)]
pub(crate) mod tests;
