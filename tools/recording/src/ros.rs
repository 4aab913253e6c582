//! Numbers in ROS 2 messages of MCAP files by other programs: CDR with a `ros2msg` schema.
//!
//! Used where a scenario plays back a file. A field is named by its topic and its path, as in
//! `/imu.linear_acceleration.x` or `/joint_states.position[0]`.

mod cdr;
mod message;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use mcap::records::Record;

use crate::reader::content::{Content, ContentError};
use message::{Message, Unread};
use shared_types::number::counted;

/// Error of reading such a file, or the reason `E` for which the receiver stopped.
#[derive(Debug, thiserror::Error)]
pub enum RosError<E = std::convert::Infallible> {
    /// The file cannot be read.
    #[error("{0}")]
    File(String),
    /// The file has no messages that can be read.
    #[error("the file has no ROS 2 message with a number")]
    Empty,
    /// A message does not fit its schema.
    #[error("message {0} does not fit its schema")]
    Unfitting(usize),
    /// An array of a message has fewer elements than a column needs.
    #[error("message {message}: `{array}` has {}", counted(*.elements as u64, "element"))]
    Short {
        /// Number of the message, from 1.
        message: usize,
        /// Topic and path of the array.
        array: String,
        /// Number of its elements.
        elements: usize,
    },
    /// Fields of several topics have no common rows.
    #[error("the columns are of several topics, which have different rows: {0} and {1}")]
    Topics(String, String),
    /// The receiver stopped.
    #[error("stopped")]
    Stopped(E),
}

impl From<ContentError> for String {
    fn from(error: ContentError) -> Self {
        error.to_string()
    }
}

/// File with messages.
#[derive(Debug)]
pub struct RosFile {
    path: PathBuf,
    /// Messages by topic.
    topics: BTreeMap<String, Message>,
    fields: Vec<String>,
}

/// Pass through a file.
struct Pass {
    content: Content,
    schemas: BTreeMap<u16, String>,
    /// Topic and schema by channel.
    channels: BTreeMap<u16, (String, u16)>,
}

/// Message of a channel.
struct Sent<'a> {
    channel: u16,
    time_ns: u64,
    data: &'a [u8],
}

impl Pass {
    fn of(path: &Path) -> Result<Self, String> {
        let content = File::open(path).and_then(Content::of);
        Ok(Self {
            content: content.map_err(|error| error.to_string())?,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
        })
    }

    /// Reads the next message, which `take` receives; returns `false` at the end.
    fn advance(&mut self, mut take: impl FnMut(&Self, &Sent<'_>)) -> Result<bool, String> {
        let Some(opcode) = self.content.advance()? else {
            return Ok(false);
        };
        let record = self.content.record(opcode)?;
        match record {
            Record::Schema { header, data } if header.encoding == crate::schema::LANGUAGE => {
                let text = String::from_utf8_lossy(&data).into_owned();
                self.schemas.insert(header.id, text);
            }
            Record::Channel(channel) if channel.message_encoding == crate::schema::ENCODING => {
                let topic = shared_types::text::printable(&channel.topic).into_owned();
                self.channels.insert(channel.id, (topic, channel.schema_id));
            }
            Record::Message { header, data } => {
                let sent = Sent {
                    channel: header.channel_id,
                    time_ns: header.log_time,
                    data: &data,
                };
                take(self, &sent);
            }
            _ => {}
        }
        Ok(true)
    }

    fn message(&self, channel: u16) -> Option<(&str, Message)> {
        let (topic, schema) = self.channels.get(&channel)?;
        Some((topic, Message::parse(self.schemas.get(schema)?)?))
    }
}

impl RosFile {
    /// Opens a file in which these columns are looked for: of the elements of a sequence only those that are asked for
    /// are listed, and the first.
    ///
    /// # Errors
    /// If the file cannot be read or has no such message.
    pub fn open(path: &Path, columns: &[&str]) -> Result<Self, RosError> {
        let mut pass = Pass::of(path).map_err(RosError::File)?;
        let mut topics = BTreeMap::new();
        while pass
            .advance(|pass, sent| {
                if let Some((topic, message)) = pass.message(sent.channel)
                    && !topics.contains_key(topic)
                {
                    topics.insert(topic.to_owned(), message);
                }
            })
            .map_err(RosError::File)?
        {}
        let named = |(topic, message): (&String, &Message)| {
            let paths = message.numbers().into_iter();
            paths
                .map(|path| format!("{topic}.{path}"))
                .collect::<Vec<_>>()
        };
        let mut fields: Vec<String> = topics.iter().flat_map(named).collect();
        for column in columns {
            let is_new = fields.iter().all(|field| field != column);
            let first = column
                .rsplit_once('[')
                .map(|(base, _)| format!("{base}[0]"));
            if is_new && column.ends_with(']') && first.is_some_and(|first| fields.contains(&first))
            {
                fields.push((*column).into());
            }
        }
        if fields.is_empty() {
            return Err(RosError::Empty);
        }
        Ok(Self {
            path: path.to_owned(),
            topics,
            fields,
        })
    }

    /// Lists the fields that are numbers.
    #[must_use]
    pub fn fields(&self) -> &[String] {
        &self.fields
    }

    /// Reads these fields of one topic: the log time in ns of each message, and their numbers.
    ///
    /// # Errors
    /// If the file cannot be read, the fields are not of one topic, or the receiver stops.
    ///
    /// # Panics
    /// If there is no such field.
    pub fn read<E>(
        &self,
        fields: &[usize],
        mut take: impl FnMut(u64, &[f64]) -> Result<(), E>,
    ) -> Result<(), RosError<E>> {
        let split = |field: &usize| {
            let name = &self.fields[*field];
            let mut topics = self.topics.keys();
            let topic = topics.find(|topic| {
                name.strip_prefix(*topic)
                    .is_some_and(|rest| rest.starts_with('.'))
            });
            topic.map(|topic| (topic, &name[topic.len() + 1..]))
        };
        let split: Vec<(&String, &str)> = fields.iter().filter_map(split).collect();
        let Some((topic, _)) = split.first() else {
            return Err(RosError::Empty);
        };
        if let Some((other, _)) = split.iter().find(|(other, _)| other != topic) {
            return Err(RosError::Topics((*topic).clone(), (*other).clone()));
        }
        let paths: Vec<&str> = split.iter().map(|(_, path)| *path).collect();
        let message = &self.topics[*topic];
        let mut pass = Pass::of(&self.path).map_err(RosError::File)?;
        let mut row = vec![0.0; paths.len()];
        let mut count = 0;
        let mut end = Ok(());
        while pass
            .advance(|pass, sent| {
                if end.is_err()
                    || pass
                        .channels
                        .get(&sent.channel)
                        .is_none_or(|(of, _)| of != *topic)
                {
                    return;
                }
                count += 1;
                end = match message.read(sent.data, &paths, &mut row) {
                    Ok(()) => take(sent.time_ns, &row).map_err(RosError::Stopped),
                    Err(Unread::Damaged) => Err(RosError::Unfitting(count)),
                    Err(Unread::Short { array, elements }) => Err(RosError::Short {
                        message: count,
                        array: format!("{topic}.{array}"),
                        elements,
                    }),
                };
            })
            .map_err(RosError::File)?
            && end.is_ok()
        {}
        end
    }
}

#[cfg(test)]
mod tests;
