//! MCAP file, written sequentially.
//!
//! Used by the [recording](super). The `mcap` crate's own writer compresses message by message and accepts no
//! finished chunks. This writer takes chunks from [`Chunk`] and encodes all other records with the crate's types. It
//! truncates the file only to remove an incomplete record, so the file on disk is valid up to its last complete
//! record at any time. Format: <https://mcap.dev/spec>.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Cursor, Seek, SeekFrom, Write};

use binrw::BinWrite;
use mcap::records::{self, op};

use super::chunk::Chunk;
use super::mark;

/// File open for writing.
pub(super) struct McapFile {
    file: File,
    /// Number of bytes written.
    position: u64,
    /// Checksum of all bytes written.
    crc: crc32fast::Hasher,
    /// Records of the summary section, by opcode.
    summary: BTreeMap<u8, Vec<u8>>,
    statistics: records::Statistics,
}

impl McapFile {
    /// Starts an empty file.
    pub(super) fn create(file: File, profile: &str, library: &str) -> io::Result<Self> {
        let mut file = Self {
            file,
            position: 0,
            crc: crc32fast::Hasher::new(),
            summary: BTreeMap::new(),
            statistics: records::Statistics::default(),
        };
        let header = records::Header {
            profile: profile.into(),
            library: library.into(),
        };
        file.write(mcap::MAGIC)?;
        file.write(&record(op::HEADER, &[&bytes_of(&header)?]))?;
        Ok(file)
    }

    /// Writes a schema; returns its ID.
    pub(super) fn schema(&mut self, name: &str, encoding: &str, data: &[u8]) -> io::Result<u16> {
        self.statistics.schema_count += 1;
        let header = records::SchemaHeader {
            id: self.statistics.schema_count,
            name: name.into(),
            encoding: encoding.into(),
        };
        let length = (data.len() as u32).to_le_bytes();
        let schema = record(op::SCHEMA, &[&bytes_of(&header)?, &length, data]);
        self.write(&schema)?;
        self.summarise(op::SCHEMA, &schema);
        Ok(header.id)
    }

    /// Writes a channel; returns its ID.
    pub(super) fn channel(
        &mut self,
        schema_id: u16,
        topic: &str,
        message_encoding: &str,
        metadata: BTreeMap<String, String>,
    ) -> io::Result<u16> {
        self.statistics.channel_count += 1;
        let channel = records::Channel {
            id: self.statistics.channel_count as u16,
            schema_id,
            topic: topic.into(),
            message_encoding: message_encoding.into(),
            metadata,
        };
        let bytes = record(op::CHANNEL, &[&bytes_of(&channel)?]);
        self.write(&bytes)?;
        self.summarise(op::CHANNEL, &bytes);
        Ok(channel.id)
    }

    pub(super) fn metadata(&mut self, metadata: records::Metadata) -> io::Result<()> {
        let bytes = record(op::METADATA, &[&bytes_of(&metadata)?]);
        let index = records::MetadataIndex {
            offset: self.position,
            length: bytes.len() as u64,
            name: metadata.name,
        };
        self.write(&bytes)?;
        self.statistics.metadata_count += 1;
        let index = record(op::METADATA_INDEX, &[&bytes_of(&index)?]);
        self.summarise(op::METADATA_INDEX, &index);
        Ok(())
    }

    pub(super) fn attachment(
        &mut self,
        header: records::AttachmentHeader,
        data: &[u8],
    ) -> io::Result<()> {
        let length = data.len() as u64;
        let content = [&bytes_of(&header)?[..], &length.to_le_bytes(), data].concat();
        let crc = crc32fast::hash(&content).to_le_bytes();
        let bytes = record(op::ATTACHMENT, &[&content, &crc]);
        let index = records::AttachmentIndex {
            offset: self.position,
            length: bytes.len() as u64,
            log_time: header.log_time,
            create_time: header.create_time,
            data_size: length,
            name: header.name,
            media_type: header.media_type,
        };
        self.write(&bytes)?;
        self.statistics.attachment_count += 1;
        let index = record(op::ATTACHMENT_INDEX, &[&bytes_of(&index)?]);
        self.summarise(op::ATTACHMENT_INDEX, &index);
        Ok(())
    }

    /// Writes a chunk with the indexes of its messages, and empties it. An empty chunk is not written. After an error
    /// the file and the chunk are unchanged, so the write can be repeated.
    pub(super) fn chunk(&mut self, chunk: &mut Chunk) -> io::Result<()> {
        let before = self.state();
        let bytes = self.write_chunk(chunk);
        if bytes.is_err() {
            self.go_back(before);
        }
        bytes
    }

    fn write_chunk(&mut self, chunk: &mut Chunk) -> io::Result<()> {
        let Some((first_ns, last_ns)) = chunk.time_ns() else {
            return Ok(());
        };
        let (compression, uncompressed_size) = (chunk.compression(), chunk.bytes() as u64);
        let uncompressed_crc = chunk.crc();
        let packed = chunk.packed()?;
        let header = records::ChunkHeader {
            message_start_time: first_ns,
            message_end_time: last_ns,
            uncompressed_size,
            uncompressed_crc,
            compression: compression.into(),
            compressed_size: packed.len() as u64,
        };
        let mut index = records::ChunkIndex {
            message_start_time: first_ns,
            message_end_time: last_ns,
            chunk_start_offset: self.position,
            chunk_length: 0,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: header.compression.clone(),
            compressed_size: header.compressed_size,
            uncompressed_size,
        };
        let header = bytes_of(&header)?;
        self.write(&head(op::CHUNK, header.len() + packed.len()))?;
        self.write(&header)?;
        self.write(&packed)?;
        index.chunk_length = self.position - index.chunk_start_offset;
        for (channel, entries) in chunk.indexes() {
            (index.message_index_offsets).insert(channel, self.position);
            let length = (entries.len() as u32).to_le_bytes();
            let bytes = record(
                op::MESSAGE_INDEX,
                &[&channel.to_le_bytes(), &length, entries],
            );
            self.write(&bytes)?;
            self.count(channel, (entries.len() / size_of::<[u64; 2]>()) as u64);
        }
        index.message_index_length = self.position - index.chunk_start_offset - index.chunk_length;
        let index = record(op::CHUNK_INDEX, &[&bytes_of(&index)?]);
        self.count_chunk(first_ns, last_ns);
        self.mark()?;
        // Added only now, because a chunk that is rolled back must not be in the summary.
        self.summarise(op::CHUNK_INDEX, &index);
        chunk.clear();
        Ok(())
    }

    /// Writes a checksum of everything written so far, in case nothing else follows.
    pub(super) fn mark(&mut self) -> io::Result<()> {
        let crc = self.crc.clone().finalize();
        self.write(&mark::mark(self.position, crc))
    }

    fn count(&mut self, channel: u16, messages: u64) {
        let statistics = &mut self.statistics;
        statistics.message_count += messages;
        *(statistics.channel_message_counts)
            .entry(channel)
            .or_default() += messages;
    }

    fn count_chunk(&mut self, first_ns: u64, last_ns: u64) {
        let statistics = &mut self.statistics;
        if statistics.chunk_count == 0 {
            statistics.message_start_time = first_ns;
        }
        statistics.message_start_time = statistics.message_start_time.min(first_ns);
        statistics.message_end_time = statistics.message_end_time.max(last_ns);
        statistics.chunk_count += 1;
    }

    /// Returns the state for a rollback.
    fn state(&self) -> State {
        State {
            position: self.position,
            crc: self.crc.clone(),
            statistics: self.statistics.clone(),
        }
    }

    /// Rolls back everything written since the state was taken.
    fn go_back(&mut self, before: State) {
        // If that fails, too, the file ends with a partial record, which readers skip.
        let _ = self.file.set_len(before.position);
        let _ = self.file.seek(SeekFrom::Start(before.position));
        State {
            position: self.position,
            crc: self.crc,
            statistics: self.statistics,
        } = before;
    }

    /// Writes the last facts and the summary, and syncs the file to disk. After an error the file ends with the last
    /// chunk.
    pub(super) fn finish(mut self, facts: records::Metadata) -> io::Result<()> {
        let before = self.state();
        let marked = self.metadata(facts).and_then(|()| self.mark());
        let finished = marked.and_then(|()| self.write_end());
        if finished.is_err() {
            self.go_back(before);
        }
        finished
    }

    fn write_end(&mut self) -> io::Result<()> {
        let crc = self.crc.clone().finalize();
        let data_end = records::DataEnd {
            data_section_crc: crc,
        };
        self.write(&record(op::DATA_END, &[&bytes_of(&data_end)?]))?;
        let statistics = record(op::STATISTICS, &[&bytes_of(&self.statistics)?]);
        self.summarise(op::STATISTICS, &statistics);
        self.crc = crc32fast::Hasher::new();
        let summary_start = self.position;
        let mut offsets = Vec::new();
        for (opcode, group) in std::mem::take(&mut self.summary) {
            let offset = records::SummaryOffset {
                group_opcode: opcode,
                group_start: self.position,
                group_length: group.len() as u64,
            };
            self.write(&group)?;
            offsets.extend(record(op::SUMMARY_OFFSET, &[&bytes_of(&offset)?]));
        }
        let summary_offset_start = self.position;
        self.write(&offsets)?;
        // The CRC covers the footer up to the CRC itself.
        let footer = bytes_of(&records::Footer {
            summary_start,
            summary_offset_start,
            summary_crc: 0,
        })?;
        let covered = footer.len() - size_of::<u32>();
        self.write(&head(op::FOOTER, footer.len()))?;
        self.write(&footer[..covered])?;
        let crc = self.crc.clone().finalize();
        self.write(&crc.to_le_bytes())?;
        self.write(mcap::MAGIC)?;
        self.file.sync_all()
    }

    fn summarise(&mut self, opcode: u8, record: &[u8]) {
        self.summary.entry(opcode).or_default().extend(record);
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.crc.update(bytes);
        self.position += bytes.len() as u64;
        Ok(())
    }
}

/// State of the file that changes with each write.
struct State {
    position: u64,
    crc: crc32fast::Hasher,
    statistics: records::Statistics,
}

/// Builds a record from these parts.
fn record(opcode: u8, parts: &[&[u8]]) -> Vec<u8> {
    let content = parts.concat();
    [&head(opcode, content.len())[..], &content].concat()
}

/// Builds the head of a record with a content of this size.
fn head(opcode: u8, bytes: usize) -> [u8; 9] {
    let mut head = [opcode; 9];
    head[1..].copy_from_slice(&(bytes as u64).to_le_bytes());
    head
}

/// Encodes a record's content, or the part for which the crate has a type.
fn bytes_of<T>(content: &T) -> io::Result<Vec<u8>>
where
    T: for<'a> BinWrite<Args<'a> = ()>,
{
    let mut bytes = Cursor::new(Vec::new());
    content.write_le(&mut bytes).map_err(io::Error::other)?;
    Ok(bytes.into_inner())
}
