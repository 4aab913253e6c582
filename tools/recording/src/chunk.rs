//! Chunk of a recording: messages that are collected, indexed and compressed.
//!
//! The [recording](super) decides when a chunk is full, and [`McapFile`](super::mcap_file::McapFile) writes it.
//! Records are the hot path of the recorder: they are copied once, directly to the compressor. Format:
//! <https://mcap.dev/spec>.

use std::io;
use std::time::{Duration, Instant};

use mcap::records::{MessageHeader, op};
use shared_types::zerocopy::IntoBytes;

use super::lz4::Encoder;
use super::schema::ENCAPSULATION;
use crate::compression::Compression;

/// Number of bytes of a message before its content.
const HEAD_BYTES: usize = 31;
/// Number of zero bytes that pad the head of a record to whole words.
const PADDING: usize = 5;
const HEAD_WORDS: usize = (PADDING + HEAD_BYTES + ENCAPSULATION.len()) / size_of::<u64>();

/// At the library's default of 3, records get no smaller but take 1.7 times as long.
const ZSTD_LEVEL: i32 = 1;

/// Chunk under construction.
pub(super) struct Chunk {
    body: Body,
    /// Size before compression, in bytes.
    bytes: usize,
    /// Checksum of the uncompressed bytes.
    crc: crc32fast::Hasher,
    /// Times of the chunk's first and last message.
    time_ns: Option<(u64, u64)>,
    since: Option<Instant>,
    /// For each channel from number 1: time and offset of each message.
    indexes: Vec<Vec<u8>>,
    /// Record with its head, as whole words.
    row: Vec<u64>,
}

enum Body {
    Plain(Vec<u8>),
    Lz4(Encoder),
    Zstd(Vec<u8>, zstd::bulk::Compressor<'static>),
}

impl Chunk {
    /// Creates an empty chunk of a file with `channels` channels.
    pub(super) fn new(compression: Compression, channels: u16) -> io::Result<Self> {
        let body = match compression {
            Compression::None => Body::Plain(Vec::new()),
            Compression::Lz4 => Body::Lz4(Encoder::new(PADDING)),
            Compression::Zstd => Body::Zstd(Vec::new(), zstd::bulk::Compressor::new(ZSTD_LEVEL)?),
        };
        Ok(Self {
            body,
            bytes: 0,
            crc: crc32fast::Hasher::new(),
            time_ns: None,
            since: None,
            indexes: vec![Vec::new(); channels.into()],
            row: Vec::new(),
        })
    }

    /// Adds a record in the form of words.
    pub(super) fn record(&mut self, header: &MessageHeader, words: &[u64]) {
        let mut head = [0; size_of::<u64>() * HEAD_WORDS];
        let bytes = ENCAPSULATION.len() + size_of_val(words);
        let (message, encapsulation) = head[PADDING..].split_at_mut(HEAD_BYTES);
        message.copy_from_slice(&head_of(header, bytes));
        encapsulation.copy_from_slice(&ENCAPSULATION);
        match &mut self.body {
            Body::Plain(body) | Body::Zstd(body, _) => {
                body.extend_from_slice(&head[PADDING..]);
                body.extend_from_slice(words.as_bytes());
                self.crc.update(&body[self.bytes..]);
            }
            Body::Lz4(encoder) => {
                let head = head
                    .as_chunks()
                    .0
                    .iter()
                    .map(|word| u64::from_le_bytes(*word));
                self.row.clear();
                self.row.extend(head);
                self.row.extend_from_slice(words);
                self.crc.update(&self.row.as_bytes()[PADDING..]);
                encoder.row(&mut self.row);
            }
        }
        self.note(header, HEAD_BYTES + bytes);
    }

    /// Adds a message.
    pub(super) fn message(&mut self, header: &MessageHeader, content: &[u8]) {
        for part in [&head_of(header, content.len())[..], content] {
            match &mut self.body {
                Body::Plain(body) | Body::Zstd(body, _) => body.extend_from_slice(part),
                Body::Lz4(encoder) => encoder.plain(part),
            }
            self.crc.update(part);
        }
        self.note(header, HEAD_BYTES + content.len());
    }

    fn note(&mut self, header: &MessageHeader, bytes: usize) {
        let time_ns = header.log_time;
        let mut entry = [0; 16];
        entry[..8].copy_from_slice(&time_ns.to_le_bytes());
        entry[8..].copy_from_slice(&(self.bytes as u64).to_le_bytes());
        self.indexes[usize::from(header.channel_id) - 1].extend_from_slice(&entry);
        self.bytes += bytes;
        let (first_ns, last_ns) = self.time_ns.unwrap_or((time_ns, time_ns));
        self.time_ns = Some((first_ns.min(time_ns), last_ns.max(time_ns)));
        if self.since.is_none() {
            self.since = Some(Instant::now());
        }
    }

    /// Returns the size before compression, in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Returns the CRC 32 of the uncompressed bytes.
    pub(super) fn crc(&self) -> u32 {
        self.crc.clone().finalize()
    }

    /// Returns the time since the first message was added; zero for an empty chunk.
    pub(super) fn age(&self) -> Duration {
        self.since.map_or(Duration::ZERO, |since| since.elapsed())
    }

    /// Returns the times of the first and last message; `None` for an empty chunk.
    pub(super) fn time_ns(&self) -> Option<(u64, u64)> {
        self.time_ns
    }

    /// Iterates over the channels with messages, as number and message index.
    pub(super) fn indexes(&self) -> impl Iterator<Item = (u16, &[u8])> {
        let numbered = (1..).zip(self.indexes.iter().map(Vec::as_slice));
        numbered.filter(|(_, entries)| !entries.is_empty())
    }

    /// Returns the name of the compression in the file.
    pub(super) fn compression(&self) -> &'static str {
        match self.body {
            Body::Plain(_) => "",
            Body::Lz4(_) => "lz4",
            Body::Zstd(..) => "zstd",
        }
    }

    /// Returns the compressed messages as stored in the file. The chunk accepts no more messages until it is cleared.
    pub(super) fn packed(&mut self) -> io::Result<Packed<'_>> {
        Ok(match &mut self.body {
            Body::Plain(body) => Packed::Borrowed(body.as_slice()),
            Body::Lz4(encoder) => Packed::Borrowed(encoder.finish()),
            Body::Zstd(body, compressor) => Packed::Owned(compressor.compress(body)?),
        })
    }

    /// Empties the chunk for reuse.
    pub(super) fn clear(&mut self) {
        match &mut self.body {
            Body::Plain(body) | Body::Zstd(body, _) => body.clear(),
            Body::Lz4(encoder) => encoder.begin(),
        }
        self.indexes.iter_mut().for_each(Vec::clear);
        self.bytes = 0;
        self.crc = crc32fast::Hasher::new();
        self.time_ns = None;
        self.since = None;
    }
}

/// Compressed messages of a chunk.
pub(super) type Packed<'a> = std::borrow::Cow<'a, [u8]>;

fn head_of(header: &MessageHeader, bytes: usize) -> [u8; HEAD_BYTES] {
    let mut head = [0; HEAD_BYTES];
    let MessageHeader {
        channel_id,
        sequence,
        log_time,
        publish_time,
    } = header;
    head[0] = op::MESSAGE;
    let length = HEAD_BYTES - 9 + bytes;
    head[1..9].copy_from_slice(&(length as u64).to_le_bytes());
    head[9..11].copy_from_slice(&channel_id.to_le_bytes());
    head[11..15].copy_from_slice(&sequence.to_le_bytes());
    head[15..23].copy_from_slice(&log_time.to_le_bytes());
    head[23..].copy_from_slice(&publish_time.to_le_bytes());
    head
}
