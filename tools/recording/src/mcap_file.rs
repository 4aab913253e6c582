//! An MCAP file, written from front to back.
//!
//! Used by the [recording](super). The `mcap` crate's own writer compresses message by message and
//! takes no finished chunk. This one takes chunks as [`Chunk`] makes them and leaves the form of all
//! other records to the crate's types. It goes back only over what it could not write as a whole: what
//! is on disk is right up to the last whole record, whatever happens. Format: <https://mcap.dev/spec>.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Cursor, Seek, SeekFrom, Write};

use binrw::BinWrite;
use mcap::records::{self, op};

use super::chunk::Chunk;
use super::mark;

/// A file being written.
pub(super) struct McapFile {
    file: File,
    /// Bytes written.
    position: u64,
    /// Of all bytes written.
    crc: crc32fast::Hasher,
    /// Records of the summary, by opcode.
    summary: BTreeMap<u8, Vec<u8>>,
    statistics: records::Statistics,
}

impl McapFile {
    /// Begins to write into an empty file.
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

    /// Writes a schema; returns its number.
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

    /// Writes a channel; returns its number.
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
        let written = record(op::CHANNEL, &[&bytes_of(&channel)?]);
        self.write(&written)?;
        self.summarise(op::CHANNEL, &written);
        Ok(channel.id)
    }

    pub(super) fn metadata(&mut self, metadata: records::Metadata) -> io::Result<()> {
        let written = record(op::METADATA, &[&bytes_of(&metadata)?]);
        let index = records::MetadataIndex {
            offset: self.position,
            length: written.len() as u64,
            name: metadata.name,
        };
        self.write(&written)?;
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
        let written = record(op::ATTACHMENT, &[&content, &crc]);
        let index = records::AttachmentIndex {
            offset: self.position,
            length: written.len() as u64,
            log_time: header.log_time,
            create_time: header.create_time,
            data_size: length,
            name: header.name,
            media_type: header.media_type,
        };
        self.write(&written)?;
        self.statistics.attachment_count += 1;
        let index = record(op::ATTACHMENT_INDEX, &[&bytes_of(&index)?]);
        self.summarise(op::ATTACHMENT_INDEX, &index);
        Ok(())
    }

    /// Writes a chunk and the indexes of its messages, and empties it. One without messages is not
    /// written. After an error the file is as before, and so is the chunk, to be written once more.
    pub(super) fn chunk(&mut self, chunk: &mut Chunk) -> io::Result<()> {
        let before = self.state();
        let written = self.write_chunk(chunk);
        if written.is_err() {
            self.go_back(before);
        }
        written
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
            let written = record(
                op::MESSAGE_INDEX,
                &[&channel.to_le_bytes(), &length, entries],
            );
            self.write(&written)?;
            self.count(channel, (entries.len() / size_of::<[u64; 2]>()) as u64);
        }
        index.message_index_length = self.position - index.chunk_start_offset - index.chunk_length;
        let index = record(op::CHUNK_INDEX, &[&bytes_of(&index)?]);
        self.count_chunk(first_ns, last_ns);
        self.mark()?;
        // Only now: what is taken back must not stand in the summary.
        self.summarise(op::CHUNK_INDEX, &index);
        chunk.clear();
        Ok(())
    }

    /// Writes down the sum of all that is written, for the case that nothing else comes.
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

    /// Returns the present state of the file.
    fn state(&self) -> State {
        State {
            position: self.position,
            crc: self.crc.clone(),
            statistics: self.statistics.clone(),
        }
    }

    /// Takes back what was written since.
    fn go_back(&mut self, before: State) {
        // If even that fails, the end of the file is a torn record, which readers pass over.
        let _ = self.file.set_len(before.position);
        let _ = self.file.seek(SeekFrom::Start(before.position));
        State {
            position: self.position,
            crc: self.crc,
            statistics: self.statistics,
        } = before;
    }

    /// Writes the last facts and the summary, and waits until all is on disk. After an error the file
    /// ends with the last chunk.
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
        // The CRC covers the footer up to itself.
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

/// Part of a file's state that changes with each write.
struct State {
    position: u64,
    crc: crc32fast::Hasher,
    statistics: records::Statistics,
}

/// A record of these parts.
fn record(opcode: u8, parts: &[&[u8]]) -> Vec<u8> {
    let content = parts.concat();
    [&head(opcode, content.len())[..], &content].concat()
}

/// Returns the head that stands in front of N bytes of a record.
fn head(opcode: u8, bytes: usize) -> [u8; 9] {
    let mut head = [opcode; 9];
    head[1..].copy_from_slice(&(bytes as u64).to_le_bytes());
    head
}

/// The bytes of a record's content, or of the part of it that the crate has a type for.
fn bytes_of<T>(content: &T) -> io::Result<Vec<u8>>
where
    T: for<'a> BinWrite<Args<'a> = ()>,
{
    let mut bytes = Cursor::new(Vec::new());
    content.write_le(&mut bytes).map_err(io::Error::other)?;
    Ok(bytes.into_inner())
}
