//! Checksum of a table file, stored in its metadata: BLAKE3 over all bytes, with zeros in place of its own digits.
//!
//! Parquet has no checksum of the whole file, and its reader trusts its input, so a file is verified before it is
//! parsed.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::os::unix::fs::FileExt;
use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};

use super::TableError;

/// Marker before the digits of the checksum.
const WORD: &str = "hil-table-sum:";
const DIGITS: usize = 64;
/// Last bytes of a table: the length of the metadata, and this word.
const END: [u8; 4] = *b"PAR1";
const END_BYTES: u64 = 8;

/// Returns the metadata entry, as key and value, that reserves space for the checksum.
pub(crate) fn unsealed() -> (&'static str, String) {
    ("sum", format!("{WORD}{}", "0".repeat(DIGITS)))
}

/// Writes the checksum into a table that has the entry of [`unsealed`].
///
/// # Errors
/// If the file cannot be read or written, or has no space for the checksum.
pub(crate) fn seal(file: &File) -> Result<(), TableError> {
    let place = place(file)?.ok_or_else(|| other("it has no space for a checksum"))?;
    file.write_all_at(&sum(file, place)?, place)?;
    Ok(())
}

/// Verifies the checksum of a table and returns the metadata entry with this key, if present; `None` for a table
/// without a checksum, as written by earlier versions.
///
/// # Errors
/// If the file cannot be read, its end is missing, or its checksum does not match.
pub(crate) fn checked_fact(path: &Path, name: &str) -> Result<Option<String>, TableError> {
    let file = File::open(path)?;
    let Some(place) = place(&file)? else {
        return Ok(None);
    };
    let mut digits = [0; DIGITS];
    file.read_exact_at(&mut digits, place)?;
    if digits != sum(&file, place)? {
        return Err(other("its checksum does not match"));
    }
    let file = SerializedFileReader::new(file)?;
    let facts = file.metadata().file_metadata().key_value_metadata();
    let fact = facts.into_iter().flatten().find(|fact| fact.key == name);
    Ok(fact.and_then(|fact| fact.value.clone()))
}

/// Finds the digits of the checksum in the metadata at the end of the file.
fn place(file: &File) -> Result<Option<u64>, TableError> {
    let bytes = file.metadata()?.len();
    let missing = || other("its end is missing");
    let last = bytes.checked_sub(END_BYTES).ok_or_else(missing)?;
    let mut end = [0; END_BYTES as usize];
    file.read_exact_at(&mut end, last)?;
    let [a, b, c, d, word @ ..] = end;
    if word != END {
        return Err(missing());
    }
    let length = u64::from(u32::from_le_bytes([a, b, c, d]));
    let begin = last.checked_sub(length).ok_or_else(missing)?;
    let mut facts = vec![0; usize::try_from(length).map_err(|_| missing())?];
    file.read_exact_at(&mut facts, begin)?;
    let offset = facts
        .windows(WORD.len())
        .rposition(|word| word == WORD.as_bytes());
    let place = offset.map(|offset| begin + (offset + WORD.len()) as u64);
    Ok(place.filter(|place| place + DIGITS as u64 <= last))
}

/// Computes the checksum of a file whose digits begin at `place`.
fn sum(file: &File, place: u64) -> io::Result<[u8; DIGITS]> {
    let mut hasher = blake3::Hasher::new();
    let mut bytes = BufReader::new(ReadAt { file, at: 0 });
    io::copy(&mut bytes.by_ref().take(place), &mut hasher)?;
    let mut own = [0; DIGITS];
    bytes.read_exact(&mut own)?;
    hasher.update(&[b'0'; DIGITS]);
    io::copy(&mut bytes, &mut hasher)?;
    let mut digits = [0; DIGITS];
    digits.copy_from_slice(hasher.finalize().to_hex().as_bytes());
    Ok(digits)
}

/// Reader of a file from its beginning, independent of the position of its descriptor.
struct ReadAt<'a> {
    file: &'a File,
    at: u64,
}

impl Read for ReadAt<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let bytes = self.file.read_at(to, self.at)?;
        self.at += bytes as u64;
        Ok(bytes)
    }
}

fn other(what: &str) -> TableError {
    TableError::Other(what.into())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::table::{Cell, Column, ColumnKind, Writer};

    /// Creates a table of a thousand rows with these metadata entries in addition to the digest.
    fn table(facts: &[(&str, String)]) -> Vec<u8> {
        let columns = [Column::new("case", ColumnKind::Count)];
        let mut writer = Writer::new(Vec::new(), &columns).expect("a table");
        for case in 0..1000 {
            writer.row(&[Cell::Count(case)]).expect("a row");
        }
        let digest = [("digest", "abc".to_owned())];
        writer.finish(&[&digest, facts].concat()).expect("a table")
    }

    #[test]
    fn any_changed_bit_is_detected() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table");
        fs::write(&path, table(&[unsealed()])).expect("written");
        let file = File::options().read(true).write(true).open(&path);
        seal(&file.expect("a file")).expect("sealed");
        let digest = || checked_fact(&path, "digest");
        assert_eq!(digest().expect("whole").as_deref(), Some("abc"));
        let whole = fs::read(&path).expect("bytes");
        for place in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[place] ^= 1 << (place % 8);
            fs::write(&path, damaged).expect("written");
            // A damaged marker hides the sum, as in a table of an earlier version.
            let is_noticed = digest().map_or(true, |digest| digest.is_none());
            assert!(is_noticed, "byte {place}");
        }
        for bytes in [0, 7, 8, whole.len() / 2, whole.len() - 1] {
            fs::write(&path, &whole[..bytes]).expect("written");
            digest().expect_err("its end is missing");
        }
    }

    #[test]
    fn metadata_of_a_table_without_a_check_sum_is_not_trusted() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table");
        fs::write(&path, table(&[])).expect("written");
        assert_eq!(checked_fact(&path, "digest").expect("a table"), None);
    }
}
