//! The ZIP archive of an FMU, read with limits and without trust.
//!
//! The whole list of entries is checked before any of them is read. Refused with a reason: paths that leave the
//! archive or are ambiguous, links and devices, encryption, overlapping entries, and more entries or content than the
//! [`Limits`] allow. Content is unpacked into memory of the listed size and compared with its checksum. Only
//! [`Archive::extract`] writes files, into an existing folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::Path;

use miniz_oxide::inflate::decompress_to_vec_with_limit;

/// Error of reading an FMU archive.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// The file cannot be read.
    #[error("the archive cannot be read: {0}")]
    Read(#[from] io::Error),
    /// The file is not a ZIP archive, or a damaged one.
    #[error("not a valid ZIP archive: {0}")]
    Damaged(&'static str),
    /// The archive uses a feature that FMUs do not need.
    #[error("{0}, which is not supported")]
    Unsupported(String),
    /// The name of an entry leaves the archive or is ambiguous.
    #[error("entry {0:?} does not name a file inside the archive")]
    Name(String),
    /// An entry occurs twice with different content, or a file is also used as a folder.
    #[error("entry {0:?} occurs twice, with different content or as a file and a folder")]
    Twice(String),
    /// An entry is a link, a device or another special file.
    #[error("entry {0:?} is a link or a device, not a file")]
    Link(String),
    /// The archive exceeds a limit.
    #[error("{0}")]
    Large(String),
    /// The archive unpacks to more than the allowed ratio.
    #[error("the archive unpacks to {total_mib} MiB, more than {ratio} times its size")]
    Ratio {
        /// Unpacked size of all entries, in MiB.
        total_mib: u64,
        /// Allowed ratio.
        ratio: u64,
    },
    /// An entry does not match its list entry.
    #[error("entry {0:?} is damaged")]
    Content(String),
    /// The entry does not exist.
    #[error("the archive has no {0}")]
    Missing(String),
    /// A file cannot be written.
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
    /// Maximum number of entries.
    pub entries: usize,
    /// Maximum size of the archive, in bytes.
    pub archive: u64,
    /// Maximum unpacked size of all entries, in bytes.
    pub total: u64,
    /// Maximum ratio of the unpacked size to the size of the archive, if the unpacked size exceeds `free`.
    pub ratio: u64,
    /// Unpacked size up to which the ratio is not checked, in bytes.
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

/// Limits for an FMU that its user trusts: the ratio is unlimited.
pub const TRUSTED: Limits = Limits {
    ratio: u64::MAX,
    ..LIMITS
};

/// Size of the end record of an archive, without its comment.
const END_BYTES: u64 = 22;
/// Size of an entry in the list, without names.
const LISTED_BYTES: usize = 46;
/// Size of an entry's local header, without names.
const HEAD_BYTES: usize = 30;
const END_MARK: [u8; 4] = *b"PK\x05\x06";
const LISTED_MARK: [u8; 4] = *b"PK\x01\x02";
const HEAD_MARK: [u8; 4] = *b"PK\x03\x04";
/// First bytes of every archive.
pub const MARK: [u8; 4] = HEAD_MARK;
/// Maximum length of an entry's name.
const LONGEST_NAME: usize = 512;
/// Maximum number of folders in the path of an entry.
const DEEPEST: usize = 32;
/// Flag bits of an entry that indicate encryption.
const ENCRYPTED: u16 = 1 | 1 << 6 | 1 << 13;
const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// File type bits of a UNIX mode, and those of a file and a folder.
const TYPE: u32 = 0o170_000;
const FILE: u32 = 0o100_000;
const FOLDER: u32 = 0o040_000;

/// Entry of the archive's list.
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

/// Archive whose list of entries has been checked.
#[derive(Debug)]
pub struct Archive<R> {
    source: R,
    entries: Vec<Entry>,
}

impl Archive<File> {
    /// Opens the archive at a path.
    ///
    /// # Errors
    /// If the file is not an archive, or exceeds a limit.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self, ArchiveError> {
        let file = File::open(path)?;
        if !file.metadata()?.is_file() {
            return Err(ArchiveError::Damaged("not a regular file"));
        }
        Self::read(file, limits)
    }
}

impl<R: Read + Seek> Archive<R> {
    /// Reads and checks the list of entries.
    ///
    /// # Errors
    /// For the first problem found.
    pub fn read(mut source: R, limits: &Limits) -> Result<Self, ArchiveError> {
        let length = source.seek(SeekFrom::End(0))?;
        if length > limits.archive {
            let most = limits.archive >> 20;
            return Err(ArchiveError::Large(format!(
                "the archive is larger than {most} MiB"
            )));
        }
        let end = EndRecord::find(&mut source, length)?;
        if usize::from(end.entries) > limits.entries {
            let (count, most) = (end.entries, limits.entries);
            return Err(ArchiveError::Large(format!(
                "the archive has {count} entries, more than {most}"
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

    /// Iterates over the names of all files.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let files = self.entries.iter().filter(|entry| !entry.is_folder());
        files.map(|entry| entry.name.as_str())
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If the file does not exist, exceeds `most` bytes, or does not match its list entry.
    pub fn content(&mut self, name: &str, most: u64) -> Result<Vec<u8>, ArchiveError> {
        let entry = self.entries.iter().find(|entry| entry.name == name);
        let entry = entry.ok_or_else(|| ArchiveError::Missing(name.into()))?;
        if entry.size > most {
            let most = most >> 20;
            return Err(ArchiveError::Large(format!(
                "entry {name:?} is larger than {most} MiB"
            )));
        }
        content(&mut self.source, entry)
    }

    /// Unpacks all files whose names begin with `beginning` into a folder; returns their number.
    ///
    /// # Errors
    /// If a file is damaged or cannot be written.
    pub fn extract(&mut self, beginning: &str, folder: &Path) -> Result<usize, ArchiveError> {
        let mut count = 0;
        for entry in &self.entries {
            if entry.is_folder() || !entry.name.starts_with(beginning) {
                continue;
            }
            let bytes = content(&mut self.source, entry)?;
            let write_error = |error| ArchiveError::Write {
                path: entry.name.clone(),
                error,
            };
            write(&folder.join(&entry.name), &bytes).map_err(write_error)?;
            count += 1;
        }
        Ok(count)
    }
}

/// Writes a new file that only its owner can read or run, and creates parent folders.
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
            return Err(ArchiveError::Damaged("too short"));
        }
        let tail = length.min(END_BYTES + u64::from(u16::MAX));
        let bytes = read_at(source, length - tail, tail)?;
        let starts = (0..=bytes.len() - END_BYTES as usize).rev();
        let is_end = |at: &usize| {
            let (record, comment) = bytes[*at..].split_at(END_BYTES as usize);
            record.starts_with(&END_MARK) && usize::from(short(record, 20)) == comment.len()
        };
        let start = starts.into_iter().find(is_end);
        let at = start.ok_or(ArchiveError::Damaged("no central directory"))?;
        let record = &bytes[at..];
        let (entries, list_bytes, list) = (
            short(record, 10),
            u64::from(long(record, 12)),
            u64::from(long(record, 16)),
        );
        let is_large = entries == u16::MAX || list == u64::from(u32::MAX);
        if is_large {
            return Err(ArchiveError::Unsupported(
                "the archive is in ZIP64 format".into(),
            ));
        }
        let is_split = short(record, 4) != 0 || short(record, 6) != 0;
        if is_split || short(record, 8) != entries {
            return Err(ArchiveError::Unsupported(
                "the archive is one part of several".into(),
            ));
        }
        // Otherwise there are bytes outside of all entries, or the list is at another offset.
        if list + list_bytes != length - tail + at as u64 {
            return Err(ArchiveError::Damaged(
                "the central directory is not at the end",
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
            return Err(ArchiveError::Damaged("the central directory is truncated"));
        }
        let [name, extra, comment] = [28, 30, 32].map(|at| usize::from(short(list, at)));
        let length = LISTED_BYTES + name + extra + comment;
        if list.len() < length {
            return Err(ArchiveError::Damaged("the central directory is truncated"));
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
                "entry {name:?} is compressed with method {method}"
            )));
        }
        // Some tools omit the mode, and some write that of a folder for names without a trailing slash.
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
        false => Err(ArchiveError::Damaged("the central directory is too long")),
    }
}

fn check_names(entries: &[Entry]) -> Result<(), ArchiveError> {
    let (mut files, mut folders) = (BTreeSet::new(), BTreeSet::new());
    for entry in entries {
        let name = &entry.name;
        let path = name.strip_suffix('/').unwrap_or(name);
        // The root folder of the archive, as some tools list it.
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
            "the entries unpack to {total} MiB, more than {most} MiB"
        )));
    }
    if total > limits.free && total / limits.ratio > length {
        let (total_mib, ratio) = (total >> 20, limits.ratio);
        return Err(ArchiveError::Ratio { total_mib, ratio });
    }
    Ok(())
}

/// Removes duplicate entries with the same content, as left by tools that pack a file twice.
fn without_copies<R: Read + Seek>(
    source: &mut R,
    entries: Vec<Entry>,
) -> Result<Vec<Entry>, ArchiveError> {
    let mut first: BTreeMap<String, Entry> = BTreeMap::new();
    let mut unique = Vec::with_capacity(entries.len());
    for entry in entries {
        let Some(before) = first.get(&entry.name).filter(|_| !entry.is_folder()) else {
            first.insert(entry.name.clone(), entry.clone());
            unique.push(entry);
            continue;
        };
        let is_alike = (before.size, before.crc) == (entry.size, entry.crc);
        if !is_alike || content(source, before)? != content(source, &entry)? {
            return Err(ArchiveError::Twice(entry.name));
        }
    }
    Ok(unique)
}

/// Checks that no two entries overlap, as they do in a small archive bomb that unpacks to a huge size.
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
        false => Err(ArchiveError::Damaged("two of its entries overlap")),
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

/// Reads `count` bytes of the archive, allocating memory only as they arrive.
fn read_at<R: Read + Seek>(source: &mut R, at: u64, count: u64) -> Result<Vec<u8>, ArchiveError> {
    source.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::new();
    source.take(count).read_to_end(&mut bytes)?;
    match bytes.len() as u64 == count {
        true => Ok(bytes),
        false => Err(ArchiveError::Damaged("truncated")),
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
