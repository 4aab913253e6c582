//! Columns of the records of a chunk, each copied at once.
//!
//! Used by readers that want whole signals of a long run, on several threads, and know where its chunks are: the Python
//! package. The records of a chunk are a table whose rows are as long as each other; tiles of it that fit into the
//! cache of a core are copied column by column, so that each value is read and written once.

use std::fs::File;
use std::os::unix::fs::FileExt;

use mcap::records::op;

use super::content::{self, HEAD_BYTES};
use super::span::{MESSAGE_BYTES, next};
use crate::schema::ENCAPSULATION;

/// Number of records of a tile, whose values of a column fill whole cache lines.
const TILE: usize = 32;

/// Reader of columns.
#[derive(Debug)]
pub struct ColumnReader {
    file: File,
    /// First bytes of every record: those of the channel's messages.
    head: [u8; HEAD_BYTES + size_of::<u16>()],
    /// Size of a record with its head, and the offset of each column in it.
    size: usize,
    offsets: Vec<usize>,
}

/// Memory that is used again for each chunk.
#[derive(Debug, Default)]
pub struct Buffers {
    packed: Vec<u8>,
    chunk: Vec<u8>,
}

impl ColumnReader {
    /// Creates a reader of some words of the records of `words` words on a channel of a file.
    ///
    /// # Panics
    /// If a place is not below the number of words.
    #[must_use]
    pub fn new(file: File, channel: u16, words: usize, places: &[usize]) -> Self {
        assert!(places.iter().all(|place| *place < words), "{places:?}");
        let first = HEAD_BYTES + MESSAGE_BYTES + ENCAPSULATION.len();
        let size = first + 8 * words;
        let mut head = [op::MESSAGE; HEAD_BYTES + 2];
        head[1..HEAD_BYTES].copy_from_slice(&((size - HEAD_BYTES) as u64).to_le_bytes());
        head[HEAD_BYTES..].copy_from_slice(&channel.to_le_bytes());
        Self {
            file,
            head,
            size,
            offsets: places.iter().map(|place| first + 8 * place).collect(),
        }
    }

    /// Fills the columns with the records of a chunk, which lies at this place of the file; `put` stores the bytes of a
    /// word. Every value was stored if this succeeds.
    ///
    /// # Errors
    /// If the chunk cannot be read, or has not as many records as the columns have room for.
    pub fn read<T>(
        &self,
        (at, bytes): (u64, usize),
        columns: &mut [&mut [T]],
        put: impl Fn(&mut T, [u8; 8]) + Copy,
        buffers: &mut Buffers,
    ) -> Result<(), String> {
        let Buffers { packed, chunk } = buffers;
        packed.resize(bytes, 0);
        let read = self.file.read_exact_at(packed, at);
        read.map_err(|error| error.to_string())?;
        content::unpack_chunk(packed, chunk)?;
        let records = columns.first().map_or(0, |column| column.len());
        let (mut rest, mut row) = (&chunk[..], 0);
        while !rest.is_empty() {
            let is_record = |record: &&[u8]| record.starts_with(&self.head);
            let count = rest.chunks_exact(self.size).take_while(is_record).count();
            if row + count > records {
                break;
            }
            let table = rest.split_off(..count * self.size).unwrap_or_default();
            for tile in table.chunks(TILE * self.size) {
                self.copy(tile, columns, row, put);
                row += tile.len() / self.size;
            }
            self.skip(&mut rest)?;
        }
        match rest.is_empty() && row == records {
            true => Ok(()),
            false => Err("an index does not match its chunk".into()),
        }
    }

    /// Copies the records of a tile to the rows from `row` on.
    fn copy<T>(
        &self,
        tile: &[u8],
        columns: &mut [&mut [T]],
        row: usize,
        put: impl Fn(&mut T, [u8; 8]),
    ) {
        for (column, offset) in columns.iter_mut().zip(&self.offsets) {
            let rows = tile.chunks_exact(self.size);
            for (value, record) in column[row..].iter_mut().zip(rows) {
                if let Some(word) = record[*offset..].first_chunk() {
                    put(value, *word);
                }
            }
        }
    }

    /// Skips one record of the file that is no record of the run, if there is one.
    ///
    /// # Errors
    /// If it is one of another length.
    fn skip(&self, rest: &mut &[u8]) -> Result<(), String> {
        if rest.is_empty() || rest.starts_with(&self.head) && rest.len() >= self.size {
            return Ok(());
        }
        let (opcode, message) =
            next(rest).ok_or("the records of a chunk do not fill it completely")?;
        match opcode == op::MESSAGE && message.starts_with(&self.head[HEAD_BYTES..]) {
            true => Err(format!(
                "a record of {} bytes does not fit its schema",
                message.len()
            )),
            false => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// Appends a record of the file.
    fn put(into: &mut Vec<u8>, opcode: u8, content: &[u8]) {
        into.push(opcode);
        into.extend((content.len() as u64).to_le_bytes());
        into.extend(content);
    }

    /// Makes a message of a channel with these words.
    fn message(channel: u16, words: &[u64]) -> Vec<u8> {
        let mut message = channel.to_le_bytes().to_vec();
        message.resize(MESSAGE_BYTES, 7);
        message.extend([0, 1, 0, 0]);
        message.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        message
    }

    /// Makes a chunk without compression and checksum.
    fn chunk(records: &[u8]) -> Vec<u8> {
        let length = (records.len() as u64).to_le_bytes();
        let times = [0; 16];
        [&times[..], &length, &[0; 4], &[0; 4], &length, records].concat()
    }

    /// Reads the last and the first of three words of records on channel 4, from a file that has them behind 5 bytes.
    fn read(records: &[u8], count: usize) -> Result<[Vec<u64>; 2], String> {
        let body = chunk(records);
        let mut file = tempfile::tempfile().expect("a file");
        let written = file.write_all(&[&[9; 5][..], &body].concat());
        written.expect("room for it");
        let reader = ColumnReader::new(file, 4, 3, &[2, 0]);
        let mut columns = [vec![0; count], vec![0; count]];
        let mut parts = columns.each_mut().map(Vec::as_mut_slice);
        let put = |value: &mut u64, word| *value = u64::from_le_bytes(word);
        reader.read((5, body.len()), &mut parts, put, &mut Buffers::default())?;
        Ok(columns)
    }

    #[test]
    fn columns_have_the_words_of_all_records_around_other_messages() {
        let mut records = Vec::new();
        put(&mut records, op::CHANNEL, b"a channel");
        for step in 0..1000 {
            if step % 77 == 0 {
                put(&mut records, op::MESSAGE, &message(5, &[1, 2, 3]));
            }
            put(
                &mut records,
                op::MESSAGE,
                &message(4, &[step, 1, step * step]),
            );
        }
        put(&mut records, op::MESSAGE, &message(3, &[]));
        let columns = read(&records, 1000).expect("a good chunk");
        let squares: Vec<u64> = (0..1000).map(|step| step * step).collect();
        assert_eq!(columns, [squares, (0..1000).collect()]);
    }

    #[test]
    fn another_number_of_records_and_records_of_another_length_are_refused() {
        let mut records = Vec::new();
        for step in 0..40 {
            put(&mut records, op::MESSAGE, &message(4, &[step, 1, 2]));
        }
        for count in [0, 39, 41] {
            let error = read(&records, count).expect_err("40 records");
            assert!(error.contains("does not match its chunk"), "{error}");
        }
        let mut longer = records.clone();
        put(&mut longer, op::MESSAGE, &message(4, &[40, 1, 2, 3]));
        let error = read(&longer, 41).expect_err("a record of four words");
        assert!(error.contains("does not fit its schema"), "{error}");
        records.truncate(records.len() - 3);
        let error = read(&records, 40).expect_err("a record is cut");
        assert!(error.contains("do not fill it"), "{error}");
    }
}
