//! Reads a recorded run: its records one by one, its events, and the files that travel with it.
//!
//! Used by `hil compare`, `hil rerun` and `hil scenario from`. Goes through the file once and keeps
//! no record, so the length of a run does not matter. Takes what a file says of itself: the names
//! of signals come from its schema, so the recording of a plant that is not here can be read. A file
//! whose writer was killed is read as far as it goes.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::de::DeserializeOwned;
use shared_types::digest::Digest;
use shared_types::record::{Event, GROUPS, HASHED_GROUPS, Timing};
use shared_types::time::Rate;

/// Name of the recording in the folder of a run.
pub const RECORDING: &str = "run.mcap";
/// Bytes of encapsulation in front of a record.
const ENCAPSULATION: usize = 4;

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
    /// The file is not what `hil run` writes.
    #[error("{path} is no recording of a run: {what}")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// One word of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Name: `step`, `truth.x_m`, `sample_invalid[0]`.
    pub name: String,
    /// Unit; empty for what is no signal.
    pub unit: String,
}

impl Column {
    /// Whether it is a number with a unit, not a count or bits.
    #[must_use]
    pub fn is_signal(&self) -> bool {
        self.name.contains('.')
    }
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
    events: Vec<Event>,
    records: u64,
    digest: Digest,
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
        let options = LinearReaderOptions::default().with_skip_end_magic(true);
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
            events: Vec::new(),
            records: 0,
            digest: Digest::default(),
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
                    if let Event::Fault(taken) = &event {
                        self.digest.fault(taken);
                    }
                    self.events.push(event);
                }
                Next::Record => {
                    self.digest.record(&self.words[..self.hashed_words]);
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

    /// The digest of what was read so far.
    #[must_use]
    pub fn digest(&self) -> String {
        self.digest.clone().finish()
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
                    // More than is wanted: a record at a time would be a system call each.
                    let read = self.file.read(self.mcap.insert(wanted.max(1 << 16)));
                    let read = read.map_err(|error| ReadError::Io {
                        path: self.path.clone(),
                        error,
                    })?;
                    self.mcap.notify_read(read);
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
                // Its writer was killed here.
                Some(Err(_)) if !self.columns.is_empty() => return Ok(Next::End),
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
                    self.columns = columns_of(schema)
                        .ok_or_else(|| foreign("its schema cannot be understood".into()))?;
                    self.hashed_words = hashed(&self.columns);
                }
                Record::Channel(channel) if channel.topic == "/events" => {
                    self.channels.insert(channel.id, false);
                }
                Record::Metadata(metadata) => {
                    self.metadata.insert(metadata.name, metadata.metadata);
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

/// The names of the words in a `ros2msg` schema: `uint64` and arrays of them, and one level of
/// messages of `float64`.
fn columns_of(schema: &str) -> Option<Vec<Column>> {
    let mut parts = schema.split(crate::recording::RULER);
    let top = parts.next()?;
    let mut messages = BTreeMap::new();
    for part in parts {
        let (name, fields) = part.trim_start().strip_prefix("MSG: ")?.split_once('\n')?;
        messages.insert(name.trim(), fields);
    }
    let mut columns = Vec::new();
    for line in top.lines().filter(|line| !line.trim().is_empty()) {
        let (kind, name, _) = field(line)?;
        if let Some(fields) = messages.get(kind) {
            for line in fields.lines().filter(|line| !line.trim().is_empty()) {
                let ("float64", field, unit) = field(line)? else {
                    return None;
                };
                let name = format!("{name}.{field}");
                columns.push(Column {
                    name,
                    unit: unit.into(),
                });
            }
        } else if let Some(count) = kind.strip_prefix("uint64[") {
            let count: usize = count.strip_suffix(']')?.parse().ok()?;
            columns.extend((0..count).map(|index| Column {
                name: format!("{name}[{index}]"),
                unit: String::new(),
            }));
        } else if kind == "uint64" {
            columns.push(Column {
                name: name.into(),
                unit: String::new(),
            });
        } else {
            return None;
        }
    }
    (columns.first()?.name == "step").then_some(columns)
}

/// Type, name and unit of a field.
fn field(line: &str) -> Option<(&str, &str, &str)> {
    let (field, comment) = line.split_once('#').unwrap_or((line, ""));
    let mut words = field.split_ascii_whitespace();
    let unit = comment.trim_start().strip_prefix('[');
    let unit = unit
        .and_then(|rest| rest.split_once(']'))
        .map_or("", |(unit, _)| unit);
    Some((words.next()?, words.next()?, unit))
}

/// Words up to the first that the digest leaves out.
fn hashed(columns: &[Column]) -> usize {
    let is_left_out = |column: &Column| match column.name.split_once('.') {
        Some((group, _)) => GROUPS[HASHED_GROUPS..].contains(&group),
        None => Timing::NAMES.contains(&column.name.as_str()),
    };
    columns
        .iter()
        .position(is_left_out)
        .unwrap_or(columns.len())
}

#[cfg(test)]
pub(crate) mod tests {
    use shared_types::record::{FaultTaken, Outcome, RecordLayout, RunEnd};
    use shared_types::table::Field;

    use super::*;
    use crate::cli::run::Compression;
    use crate::recording::{Enclosure, Provenance, Recording};

    /// Signals of a small run: `truth.x_m`, `measured.x_m`, `command.u_n`, and what they bring.
    pub(crate) fn layout() -> RecordLayout {
        RecordLayout {
            truth: vec![Field::signal("x_m", "m", "Place.")],
            measured: vec![Field::signal("x_m", "m", "Place [as seen].")],
            command: vec![Field::signal("u_n", "N", "Force.")],
            command_signals: 1,
            parameter: vec![Field::signal("mass_kg", "kg", "Mass.")],
            ..RecordLayout::default()
        }
    }

    /// A record: step, both validity words, then truth, measured, command, applied, sensed and
    /// parameter, then timing.
    pub(crate) fn record(step: u64, truth: f64, command: f64) -> Vec<u64> {
        let values = [truth, truth, command, command, truth, 1.0].map(f64::to_bits);
        let timing = [step * 1000, 1, 0, 0, 77, 0, 0, 0];
        [&[step, 0, 0][..], &values, &timing].concat()
    }

    pub(crate) fn taken(step: u64) -> Event {
        Event::Fault(FaultTaken {
            id: 1,
            effect: 0,
            step,
            kind: "bias".into(),
            target: "measured.x_m".into(),
            parameter: "x_m".into(),
            canonical: "bias=0 step".into(),
            wall_only: false,
        })
    }

    /// What is in a recording, in order.
    pub(crate) enum Content {
        Record(Vec<u64>),
        Event(Event),
    }

    /// Writes a recording into a new folder and returns that. `finish`: as after a whole run.
    pub(crate) fn recorded(
        name: &str,
        layout: &RecordLayout,
        contents: &[Content],
        enclosures: Vec<Enclosure>,
        finish: bool,
    ) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("hil-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let provenance = Provenance {
            facts: BTreeMap::from([("rate_hz".into(), "1000".into())]),
            enclosures,
        };
        let path = folder.join(RECORDING);
        let mut recording =
            Recording::create(&path, Compression::Lz4, layout, &provenance).expect("created");
        for content in contents {
            match content {
                Content::Record(words) => recording
                    .record(words, &layout.view(words))
                    .expect("written"),
                Content::Event(event) => recording.event(event, None, 0).expect("written"),
            }
        }
        if finish {
            let result = BTreeMap::from([("outcome".into(), "completed".into())]);
            recording.finish(result).expect("finished");
        }
        folder
    }

    #[test]
    fn a_recording_reads_back_as_it_was_written() {
        let end = Event::End(RunEnd {
            steps: 2,
            outcome: Outcome::Completed,
            reason: None,
            rejected_frames: 0,
            effects: vec![],
        });
        let contents = [
            Content::Record(record(0, 0.5, 2.0)),
            Content::Event(taken(1)),
            Content::Record(record(1, -0.0, f64::NAN)),
            Content::Event(end.clone()),
        ];
        let enclosure = Enclosure {
            name: "scenario.toml",
            media_type: "application/toml",
            text: "schema = 1".into(),
        };
        let folder = recorded("reads", &layout(), &contents, vec![enclosure], true);
        let mut reader = RunReader::open(&folder).expect("opens");
        assert_eq!(reader.rate().expect("a rate").hz(), 1000.0);
        assert_eq!(
            reader.enclosure("scenario.toml").expect("enclosed"),
            "schema = 1"
        );
        assert!(reader.enclosure("other.toml").is_err());
        let names: Vec<&str> = reader
            .columns()
            .iter()
            .map(|column| column.name.as_str())
            .collect();
        let signals = [
            "truth.x_m",
            "measured.x_m",
            "command.u_n",
            "applied.u_n",
            "sensed.x_m",
            "parameter.mass_kg",
        ];
        let bits = ["step", "sample_invalid[0]", "command_invalid[0]"];
        assert_eq!(names, [&bits[..], &signals, &Timing::NAMES].concat());
        assert_eq!(
            (reader.columns()[4].unit.as_str(), reader.hashed_words()),
            ("m", 7)
        );
        assert!(reader.advance().expect("read"));
        assert_eq!(
            (reader.words(), reader.events()),
            (&record(0, 0.5, 2.0)[..], &[][..])
        );
        assert!(reader.advance().expect("read"));
        assert_eq!((reader.step(), reader.events()), (1, &[taken(1)][..]));
        assert_eq!(reader.words(), record(1, -0.0, f64::NAN));
        assert!(!reader.advance().expect("read"));
        assert_eq!((reader.events(), reader.records()), (&[end][..], 2));
        assert_eq!(
            (reader.result("outcome"), reader.is_whole()),
            (Some("completed"), true)
        );
        // By the digest's definition.
        let text = "1 bias measured.x_m x_m bias=0 step";
        let mut hasher = blake3::Hasher::new();
        let words = |hasher: &mut blake3::Hasher, words: &[u64]| {
            words.iter().for_each(|word| {
                hasher.update(&word.to_le_bytes());
            });
        };
        words(&mut hasher, &record(0, 0.5, 2.0)[..7]);
        words(&mut hasher, &[text.len() as u64]);
        hasher.update(text.as_bytes());
        words(&mut hasher, &record(1, -0.0, f64::NAN)[..7]);
        assert_eq!(reader.digest(), hasher.finalize().to_hex().to_string());
        std::fs::remove_dir_all(folder).expect("removed");
    }

    #[test]
    fn a_file_that_was_cut_off_is_read_as_far_as_it_goes() {
        let contents: Vec<Content> = (0..2000)
            .map(|step| Content::Record(record(step, step as f64, 0.0)))
            .collect();
        let folder = recorded("cut", &layout(), &contents, vec![], true);
        let path = folder.join(RECORDING);
        let bytes = std::fs::read(&path).expect("read");
        std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
        let mut reader = RunReader::open(&path).expect("opens");
        let mut records = 0;
        while reader.advance().expect("reads on") {
            assert_eq!(reader.words(), record(records, records as f64, 0.0));
            records += 1;
        }
        assert!(!reader.is_whole() && records < 2000, "{records}");
        std::fs::remove_dir_all(folder).expect("removed");
    }

    #[test]
    fn what_is_no_recording_is_named() {
        let folder = std::env::temp_dir().join(format!("hil-none-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let text = folder.join("text");
        std::fs::write(&text, "not an MCAP file at all").expect("written");
        let told = |path: &Path| RunReader::open(path).err().expect("refused").to_string();
        assert!(told(&folder).contains("has no recording"));
        assert!(told(&text).contains("is no recording of a run"));
        assert!(told(&folder.join("nothing")).starts_with("cannot read"));
        std::fs::remove_dir_all(folder).expect("removed");
    }
}
