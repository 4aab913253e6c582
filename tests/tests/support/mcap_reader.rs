//! Reader of recordings based on their format alone, independent of the code that writes them.
//!
//! A record is 4 bytes of CDR encapsulation and 64-bit words; the `ros2msg` schema names every word.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::MessageStream;
use mcap::read::Options;
use serde_json::Value;

/// Recording in memory.
pub(crate) struct Recording {
    bytes: Vec<u8>,
    /// Name of each word of a record, for example `truth.force_fight_n`.
    pub(crate) columns: Vec<String>,
    /// Events, in the order of the file.
    pub(crate) events: Vec<Value>,
}

/// Record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Record {
    pub(crate) log_time_ns: u64,
    pub(crate) words: Vec<u64>,
}

impl Record {
    pub(crate) fn step(&self) -> u64 {
        self.words[0]
    }
}

impl Recording {
    /// Reads a file, even one whose writer was killed.
    pub(crate) fn open(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let (mut columns, mut events) = (Vec::new(), Vec::new());
        for message in messages(&bytes) {
            match message.channel.topic.as_str() {
                "/events" => {
                    assert_eq!(message.channel.message_encoding, "cdr");
                    // After the encapsulation: the length of a text, and the text, with a zero.
                    let length =
                        u32::from_le_bytes(message.data[4..8].try_into().expect("4 bytes"));
                    let (json, rest) = message.data[8..].split_at(length as usize - 1);
                    assert_eq!(rest[0], 0);
                    events.push(serde_json::from_slice(json).expect("JSON"));
                }
                _ if !columns.is_empty() => {}
                _ => {
                    let schema = message.channel.schema.as_ref().expect("a schema");
                    assert_eq!(schema.encoding, "ros2msg");
                    columns = columns_of(std::str::from_utf8(&schema.data).expect("text"));
                }
            }
        }
        Self {
            bytes,
            columns,
            events,
        }
    }

    /// Iterates over the records, in the order of the file.
    pub(crate) fn records(&self) -> impl Iterator<Item = Record> {
        let records = messages(&self.bytes).filter(|message| message.channel.topic == "/record");
        records.map(|message| {
            assert_eq!(message.channel.message_encoding, "cdr");
            let (head, words) = message.data.split_at(4);
            assert_eq!(head, [0, 1, 0, 0], "CDR, little-endian");
            assert_eq!(words.len(), 8 * self.columns.len());
            let words = words
                .chunks(8)
                .map(|word| word.try_into().expect("8 bytes"));
            Record {
                log_time_ns: message.log_time,
                words: words.map(u64::from_le_bytes).collect(),
            }
        })
    }

    /// Returns the values of a signal in all records.
    pub(crate) fn column(&self, column: &str) -> Vec<f64> {
        let place = self.place(column);
        let values = self
            .records()
            .map(|record| f64::from_bits(record.words[place]));
        values.collect()
    }

    /// Returns the index of a word in a record.
    pub(crate) fn place(&self, column: &str) -> usize {
        let result = self.columns.iter().position(|name| name == column);
        result.unwrap_or_else(|| panic!("no {column} in {:?}", self.columns))
    }

    /// Returns a signal of a record.
    pub(crate) fn value(&self, record: &Record, column: &str) -> f64 {
        f64::from_bits(record.words[self.place(column)])
    }

    /// Computes the digest by its definition: for each record in order the fault events that take effect at its step,
    /// each as its length and its text, then the words up to the last internal signal, little-endian. A fault that
    /// only costs time does not count.
    pub(crate) fn digest(&self, mut change: impl FnMut(&mut Record)) -> String {
        let mut hasher = blake3::Hasher::new();
        let unhashed = |name: &String| name.starts_with("sensed.") || name == "time_ns";
        let hashed = self.columns.iter().position(unhashed).expect("timing");
        for mut record in self.records() {
            let step = record.step();
            for event in (self.events.iter()).filter(|event| event["event"] == "fault") {
                if event["step"] == step && event["wall_only"] != true {
                    let part = |name: &str| event[name].as_str().expect("text").to_owned();
                    let (kind, target) = (part("kind"), part("target"));
                    let (parameter, course) = (part("parameter"), part("canonical"));
                    let text = format!("{step} {kind} {target} {parameter} {course}");
                    hasher.update(&(text.len() as u64).to_le_bytes());
                    hasher.update(text.as_bytes());
                }
            }
            for event in self
                .events
                .iter()
                .filter(|event| event["event"] == "change")
            {
                if event["step"] == step {
                    let ramp_steps = event["ramp_steps"].as_u64().unwrap_or(0);
                    let mut text = format!("{step} change {ramp_steps}");
                    for set in event["set"].as_array().into_iter().flatten() {
                        let (key, value) = (&set["key"], &set["value"]);
                        let value = value.as_f64().expect("a finite number");
                        let value = shared_types::number::exact(value);
                        text += &format!(" {}={value}", key.as_str().expect("a key"));
                    }
                    for key in event["clear"].as_array().into_iter().flatten() {
                        text += &format!(" clear:{}", key.as_str().expect("a key"));
                    }
                    hasher.update(&(text.len() as u64).to_le_bytes());
                    hasher.update(text.as_bytes());
                }
            }
            change(&mut record);
            for word in &record.words[..hashed] {
                hasher.update(&word.to_le_bytes());
            }
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Returns the facts about the run, by the name of the metadata record.
    pub(crate) fn metadata(&self) -> BTreeMap<String, BTreeMap<String, String>> {
        let summary = self.summary();
        let records = summary.metadata_indexes.iter();
        let read = |index| mcap::read::metadata(&self.bytes, index).expect("metadata");
        records
            .map(read)
            .map(|record| (record.name, record.metadata))
            .collect()
    }

    /// Returns the attachments by name.
    pub(crate) fn attachments(&self) -> BTreeMap<String, String> {
        let summary = self.summary();
        let files = summary.attachment_indexes.iter();
        let read = |index| mcap::read::attachment(&self.bytes, index).expect("an attachment");
        files
            .map(read)
            .map(|file| (file.name, String::from_utf8(file.data.into_owned())))
            .map(|(name, text)| (name, text.expect("text")))
            .collect()
    }

    /// Returns `true` if the recording was finished.
    pub(crate) fn summary(&self) -> mcap::Summary {
        let summary = mcap::Summary::read(&self.bytes).expect("a whole file");
        summary.expect("a finished recording")
    }
}

/// Returns the messages up to the end of the file, or to where its writer was killed.
fn messages(bytes: &[u8]) -> impl Iterator<Item = mcap::Message<'static>> {
    let stream = MessageStream::new_with_options(bytes, Options::IgnoreEndMagic.into());
    stream.expect("an MCAP file").map_while(Result::ok)
}

/// Returns the names of the words: `uint64` fields, arrays of two `uint32` per word, messages of `float64`, and
/// messages of eight bytes that form one word.
fn columns_of(schema: &str) -> Vec<String> {
    let ruler = format!("{}\n", "=".repeat(80));
    let mut parts = schema.split(&ruler);
    let top = parts.next().expect("there is always a part");
    let messages: BTreeMap<&str, Option<Vec<&str>>> = parts
        .map(|part| {
            let (head, fields) = part.split_once('\n').expect("a name");
            let name = head.strip_prefix("MSG: ").expect("MSG:");
            let fields: Vec<_> = fields.lines().map(field).collect();
            let is_group = fields.iter().all(|(kind, _)| *kind == "float64");
            let names = fields.into_iter().map(|(_, name)| name);
            (name, is_group.then(|| names.collect()))
        })
        .collect();
    let mut columns = Vec::new();
    for line in top.lines() {
        let (kind, name) = field(line);
        if let Some(Some(fields)) = messages.get(kind) {
            columns.extend(fields.iter().map(|field| format!("{name}.{field}")));
        } else if messages.contains_key(kind) {
            columns.push(name.to_owned());
        } else if let Some(count) = kind.strip_prefix("uint32[") {
            let count: usize = count.trim_end_matches(']').parse().expect("a number");
            columns.extend((0..count / 2).map(|i| format!("{name}[{i}]")));
        } else {
            assert_eq!(kind, "uint64", "{line}");
            columns.push(name.to_owned());
        }
    }
    columns
}

/// Returns type and name of a field, without its comment.
fn field(line: &str) -> (&str, &str) {
    let mut words = line.split_ascii_whitespace();
    (words.next().expect("a type"), words.next().expect("a name"))
}

/// Returns the intervals of consecutive steps, counted from a first one, at which something holds.
pub(crate) fn intervals(first: u64, holds: &[bool]) -> Vec<[u64; 2]> {
    let mut intervals: Vec<[u64; 2]> = Vec::new();
    for (step, _) in (first..).zip(holds).filter(|(_, holds)| **holds) {
        match intervals.last_mut() {
            Some([_, last]) if *last + 1 == step => *last = step,
            _ => intervals.push([step, step]),
        }
    }
    intervals
}
