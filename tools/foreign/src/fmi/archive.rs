//! The archive that an FMU is: a ZIP file, read with limits and without trust.
//!
//! The whole list of entries is checked before any of them is read. Refused by name: names that climb out or
//! could mean two things, links and devices, encryption, entries that share bytes, more entries or content
//! than the [`Limits`] say. Content is unpacked into memory of the size that the list gives and compared
//! with its sum. Nothing here writes a file but [`Archive::extract`], into a folder that is there already.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::Path;

use miniz_oxide::inflate::decompress_to_vec_with_limit;

/// An archive cannot be used as an FMU's.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// The file cannot be read.
    #[error("cannot read it: {0}")]
    Read(#[from] io::Error),
    /// The file is no ZIP archive, or a damaged one.
    #[error("it is no sound ZIP archive: {0}")]
    Damaged(&'static str),
    /// The archive uses a feature that FMUs do not need.
    #[error("{0}, which is not read")]
    Unsupported(String),
    /// An entry's name leads elsewhere or can be read in two ways.
    #[error("entry {0:?} does not name a file inside the archive")]
    Name(String),
    /// An entry is there twice and the second is not the first, or a file is used as a folder.
    #[error("entry {0:?} is there twice, with different content or as a file and a folder")]
    Twice(String),
    /// An entry is a link, a device or the like.
    #[error("entry {0:?} is a link or a device, not a file")]
    Link(String),
    /// The archive is larger than the limits allow.
    #[error("{0}")]
    Large(String),
    /// The archive unpacks to more than the ratio allows.
    #[error("its entries have {total_mib} MiB unpacked, more than {ratio} times its size")]
    Ratio {
        /// Content of all entries in MiB.
        total_mib: u64,
        /// Ratio of the limits.
        ratio: u64,
    },
    /// An entry is not what the list says of it.
    #[error("entry {0:?} is damaged")]
    Content(String),
    /// There is no such entry.
    #[error("it has no {0}")]
    Missing(String),
    /// A file of it cannot be written.
    #[error("cannot unpack {path}: {error}")]
    Write {
        /// Name of the entry.
        path: String,
        /// Error of the operating system.
        error: io::Error,
    },
}

/// Limits on an archive.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Most entries.
    pub entries: usize,
    /// Most bytes of the archive itself.
    pub archive: u64,
    /// Most bytes of all entries together, unpacked.
    pub total: u64,
    /// Most bytes of all entries together for each byte of the archive, if they are more than `free`.
    pub ratio: u64,
    /// Unpacked bytes that no ratio is asked of.
    pub free: u64,
}

/// Limits for FMUs: large ones have a few hundred entries and some 100 MB.
pub const LIMITS: Limits = Limits {
    entries: 10_000,
    archive: 512 << 20,
    total: 1 << 30,
    ratio: 100,
    free: 32 << 20,
};

/// Limits for an FMU whose user says that its content is what it should be: only the ratio is free.
pub const TRUSTED: Limits = Limits {
    ratio: u64::MAX,
    ..LIMITS
};

/// Bytes of the record at the end of an archive, without its comment.
const END_BYTES: u64 = 22;
/// Bytes of an entry in the list, without names.
const LISTED_BYTES: usize = 46;
/// Bytes of an entry's own head, without names.
const HEAD_BYTES: usize = 30;
const END_MARK: [u8; 4] = *b"PK\x05\x06";
const LISTED_MARK: [u8; 4] = *b"PK\x01\x02";
const HEAD_MARK: [u8; 4] = *b"PK\x03\x04";
/// First bytes of every archive.
pub const MARK: [u8; 4] = HEAD_MARK;
/// Longest name of an entry.
const LONGEST_NAME: usize = 512;
/// Most folders on the way to an entry.
const DEEPEST: usize = 32;
/// Bits of an entry that tell of encryption.
const ENCRYPTED: u16 = 1 | 1 << 6 | 1 << 13;
const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// Bits of a UNIX mode that tell the type of a file, and those of a file and a folder.
const TYPE: u32 = 0o170_000;
const FILE: u32 = 0o100_000;
const FOLDER: u32 = 0o040_000;

/// An entry as the list has it.
#[derive(Clone, Debug)]
struct Entry {
    name: String,
    method: u16,
    crc: u32,
    packed: u64,
    size: u64,
    head: u64,
}

impl Entry {
    fn is_folder(&self) -> bool {
        self.name.ends_with('/')
    }
}

/// An archive whose list of entries was checked.
#[derive(Debug)]
pub struct Archive<R> {
    source: R,
    entries: Vec<Entry>,
}

impl Archive<File> {
    /// Opens the archive at a path.
    ///
    /// # Errors
    /// If it is none, or breaks a limit.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self, ArchiveError> {
        let file = File::open(path)?;
        if !file.metadata()?.is_file() {
            return Err(ArchiveError::Damaged("it is no regular file"));
        }
        Self::read(file, limits)
    }
}

impl<R: Read + Seek> Archive<R> {
    /// Reads and checks the list of entries.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn read(mut source: R, limits: &Limits) -> Result<Self, ArchiveError> {
        let length = source.seek(SeekFrom::End(0))?;
        if length > limits.archive {
            let most = limits.archive >> 20;
            return Err(ArchiveError::Large(format!("it has more than {most} MiB")));
        }
        let end = EndRecord::find(&mut source, length)?;
        if usize::from(end.entries) > limits.entries {
            let (count, most) = (end.entries, limits.entries);
            return Err(ArchiveError::Large(format!(
                "it has {count} entries, more than {most}"
            )));
        }
        let list = read_at(&mut source, end.list, end.list_bytes)?;
        let entries = listed(&list, end.entries)?;
        check_names(&entries)?;
        check_size(&entries, length, limits)?;
        check_places(&entries, end.list)?;
        let entries = without_copies(&mut source, entries)?;
        Ok(Self { source, entries })
    }

    /// Names of all files in it.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let files = self.entries.iter().filter(|entry| !entry.is_folder());
        files.map(|entry| entry.name.as_str())
    }

    /// Content of a file.
    ///
    /// # Errors
    /// If there is no such file, or its content is not what the list says.
    pub fn content(&mut self, name: &str, most: u64) -> Result<Vec<u8>, ArchiveError> {
        let entry = self.entries.iter().find(|entry| entry.name == name);
        let entry = entry.ok_or_else(|| ArchiveError::Missing(name.into()))?;
        if entry.size > most {
            let most = most >> 20;
            return Err(ArchiveError::Large(format!(
                "entry {name:?} has more than {most} MiB"
            )));
        }
        content(&mut self.source, entry)
    }

    /// Unpacks all files whose names begin so into a folder; gives their number.
    ///
    /// # Errors
    /// If one of them is damaged or cannot be written.
    pub fn extract(&mut self, beginning: &str, folder: &Path) -> Result<usize, ArchiveError> {
        let mut count = 0;
        for entry in &self.entries {
            if entry.is_folder() || !entry.name.starts_with(beginning) {
                continue;
            }
            let bytes = content(&mut self.source, entry)?;
            let told = |error| ArchiveError::Write {
                path: entry.name.clone(),
                error,
            };
            write(&folder.join(&entry.name), &bytes).map_err(told)?;
            count += 1;
        }
        Ok(count)
    }
}

/// Writes a new file that its owner alone can read or run, with the folders on the way.
fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        (fs::DirBuilder::new().recursive(true).mode(0o700)).create(folder)?;
    }
    let mut options = OpenOptions::new();
    let mut file = options
        .write(true)
        .create_new(true)
        .mode(0o700)
        .open(path)?;
    file.write_all(bytes)
}

/// Record at the end of an archive.
struct EndRecord {
    entries: u16,
    list: u64,
    list_bytes: u64,
}

impl EndRecord {
    fn find<R: Read + Seek>(source: &mut R, length: u64) -> Result<Self, ArchiveError> {
        if length < END_BYTES {
            return Err(ArchiveError::Damaged("it is too short"));
        }
        let tail = length.min(END_BYTES + u64::from(u16::MAX));
        let bytes = read_at(source, length - tail, tail)?;
        let starts = (0..=bytes.len() - END_BYTES as usize).rev();
        let is_end = |at: &usize| {
            let (record, comment) = bytes[*at..].split_at(END_BYTES as usize);
            record.starts_with(&END_MARK) && usize::from(short(record, 20)) == comment.len()
        };
        let found = starts.into_iter().find(is_end);
        let at = found.ok_or(ArchiveError::Damaged("it has no list of entries"))?;
        let record = &bytes[at..];
        let (entries, list_bytes, list) = (
            short(record, 10),
            u64::from(long(record, 12)),
            u64::from(long(record, 16)),
        );
        let is_large = entries == u16::MAX || list == u64::from(u32::MAX);
        if is_large {
            return Err(ArchiveError::Unsupported("it is in the form ZIP64".into()));
        }
        let is_split = short(record, 4) != 0 || short(record, 6) != 0;
        if is_split || short(record, 8) != entries {
            return Err(ArchiveError::Unsupported(
                "it is one of several parts".into(),
            ));
        }
        // Anything else has bytes that no entry accounts for, or a list that is not where it says.
        if list + list_bytes != length - tail + at as u64 {
            return Err(ArchiveError::Damaged(
                "its list of entries is not at its end",
            ));
        }
        Ok(Self {
            entries,
            list,
            list_bytes,
        })
    }
}

fn listed(mut list: &[u8], count: u16) -> Result<Vec<Entry>, ArchiveError> {
    let mut entries = Vec::new();
    for _ in 0..count {
        if list.len() < LISTED_BYTES || !list.starts_with(&LISTED_MARK) {
            return Err(ArchiveError::Damaged("its list of entries is cut off"));
        }
        let [name, extra, comment] = [28, 30, 32].map(|at| usize::from(short(list, at)));
        let length = LISTED_BYTES + name + extra + comment;
        if list.len() < length {
            return Err(ArchiveError::Damaged("its list of entries is cut off"));
        }
        let (made_by, flags) = (list[5], short(list, 8));
        let mode = long(list, 38) >> 16;
        let bytes = &list[LISTED_BYTES..LISTED_BYTES + name];
        let name = String::from_utf8(bytes.to_vec())
            .map_err(|_| ArchiveError::Name(String::from_utf8_lossy(bytes).into_owned()))?;
        let entry = Entry {
            method: short(list, 10),
            crc: long(list, 16),
            packed: u64::from(long(list, 20)),
            size: u64::from(long(list, 24)),
            head: u64::from(long(list, 42)),
            name,
        };
        if flags & ENCRYPTED != 0 {
            let name = &entry.name;
            return Err(ArchiveError::Unsupported(format!(
                "entry {name:?} is encrypted"
            )));
        }
        if ![STORED, DEFLATED].contains(&entry.method) {
            let (name, method) = (&entry.name, entry.method);
            return Err(ArchiveError::Unsupported(format!(
                "entry {name:?} is packed by method {method}"
            )));
        }
        // Some tools leave the mode out, and some write that of a folder without a slash at the end.
        let kind = mode & TYPE;
        let is_plain = kind == 0 || kind == if entry.is_folder() { FOLDER } else { FILE };
        if !is_plain && [3, 19].contains(&made_by) {
            return Err(ArchiveError::Link(entry.name));
        }
        if entry.method == STORED && entry.packed != entry.size {
            return Err(ArchiveError::Content(entry.name));
        }
        entries.push(entry);
        list = &list[length..];
    }
    match list.is_empty() {
        true => Ok(entries),
        false => Err(ArchiveError::Damaged("its list of entries is too long")),
    }
}

fn check_names(entries: &[Entry]) -> Result<(), ArchiveError> {
    let (mut files, mut folders) = (BTreeSet::new(), BTreeSet::new());
    for entry in entries {
        let name = &entry.name;
        let path = name.strip_suffix('/').unwrap_or(name);
        // The folder of the archive itself, as some tools list it.
        if path == "." && entry.is_folder() && entry.size == 0 {
            continue;
        }
        let parts: Vec<&str> = path.split('/').collect();
        let is_part = |part: &&str| !["", ".", ".."].contains(part);
        let is_plain = |c: char| !c.is_control() && !matches!(c, '\\' | ':');
        let is_sound = name.len() <= LONGEST_NAME
            && parts.len() <= DEEPEST
            && parts.iter().all(is_part)
            && name.chars().all(is_plain);
        if !is_sound {
            return Err(ArchiveError::Name(name.chars().take(80).collect()));
        }
        let above = path.match_indices('/').map(|(at, _)| &path[..at]);
        folders.extend(above);
        match entry.is_folder() {
            true => {
                folders.insert(path);
            }
            false => {
                files.insert(path);
            }
        }
    }
    match files.intersection(&folders).next() {
        Some(name) => Err(ArchiveError::Twice((*name).into())),
        None => Ok(()),
    }
}

fn check_size(entries: &[Entry], length: u64, limits: &Limits) -> Result<(), ArchiveError> {
    let total: u64 = entries.iter().map(|entry| entry.size).sum();
    if total > limits.total {
        let (total, most) = (total >> 20, limits.total >> 20);
        return Err(ArchiveError::Large(format!(
            "its entries have {total} MiB unpacked, more than {most} MiB"
        )));
    }
    if total > limits.free && total / limits.ratio > length {
        let (total_mib, ratio) = (total >> 20, limits.ratio);
        return Err(ArchiveError::Ratio { total_mib, ratio });
    }
    Ok(())
}

/// The entries without those that are there once more with the same content, as tools that pack a file twice leave
/// them.
fn without_copies<R: Read + Seek>(
    source: &mut R,
    entries: Vec<Entry>,
) -> Result<Vec<Entry>, ArchiveError> {
    let mut first: BTreeMap<String, Entry> = BTreeMap::new();
    let mut kept = Vec::with_capacity(entries.len());
    for entry in entries {
        let Some(before) = first.get(&entry.name).filter(|_| !entry.is_folder()) else {
            first.insert(entry.name.clone(), entry.clone());
            kept.push(entry);
            continue;
        };
        let is_alike = (before.size, before.crc) == (entry.size, entry.crc);
        if !is_alike || content(source, before)? != content(source, &entry)? {
            return Err(ArchiveError::Twice(entry.name));
        }
    }
    Ok(kept)
}

/// Checks that no two entries share bytes, as those of a bomb do that is small and unpacks to very much.
fn check_places(entries: &[Entry], list: u64) -> Result<(), ArchiveError> {
    let mut places: Vec<(u64, u64)> = (entries.iter())
        .map(|entry| {
            let heads = (HEAD_BYTES + entry.name.len()) as u64;
            (entry.head, entry.head + heads + entry.packed)
        })
        .collect();
    places.push((list, list));
    places.sort_unstable();
    match places.windows(2).all(|pair| pair[0].1 <= pair[1].0) {
        true => Ok(()),
        false => Err(ArchiveError::Damaged("two of its entries share bytes")),
    }
}

fn content<R: Read + Seek>(source: &mut R, entry: &Entry) -> Result<Vec<u8>, ArchiveError> {
    let damaged = || ArchiveError::Content(entry.name.clone());
    let head = read_at(source, entry.head, HEAD_BYTES as u64)?;
    if !head.starts_with(&HEAD_MARK) || short(&head, 6) & ENCRYPTED != 0 {
        return Err(damaged());
    }
    let (name, extra) = (u64::from(short(&head, 26)), u64::from(short(&head, 28)));
    let names = read_at(source, entry.head + HEAD_BYTES as u64, name)?;
    if names != entry.name.as_bytes() || short(&head, 8) != entry.method {
        return Err(damaged());
    }
    let start = entry.head + HEAD_BYTES as u64 + name + extra;
    let packed = read_at(source, start, entry.packed)?;
    let bytes = match entry.method {
        STORED => packed,
        _ => {
            let size = usize::try_from(entry.size).map_err(|_| damaged())?;
            decompress_to_vec_with_limit(&packed, size).map_err(|_| damaged())?
        }
    };
    let is_sound = bytes.len() as u64 == entry.size && crc32fast::hash(&bytes) == entry.crc;
    is_sound.then_some(bytes).ok_or_else(damaged)
}

/// Reads a number of bytes of the archive; memory is taken as they come.
fn read_at<R: Read + Seek>(source: &mut R, at: u64, count: u64) -> Result<Vec<u8>, ArchiveError> {
    source.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::new();
    source.take(count).read_to_end(&mut bytes)?;
    match bytes.len() as u64 == count {
        true => Ok(bytes),
        false => Err(ArchiveError::Damaged("it is cut off")),
    }
}

fn short(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn long(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

#[cfg(test)]
mod tests;
