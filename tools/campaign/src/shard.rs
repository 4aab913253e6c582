//! Shards: blocks of consecutive cases that one worker computes and publishes as a whole.
//!
//! A claim only avoids duplicate work: if two workers compute the same shard, the first to link its result publishes
//! it. The rows of the other are compared with that result, so that a double execution, which no engine rules out,
//! becomes a check of repeatability.

pub(crate) mod attempt;
pub(crate) mod part;

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};

use hil_facts::results::curve::Grid;
use rustix::fs::{FlockOperation, flock};

use crate::curves::{CURVES, Curves};
use crate::folder::{Folder, SHARDS};
use crate::journal::{self, Journal};
use crate::table::{self, Row, TableError};
use attempt::{Attempt, difference};
use part::Part;

/// Number of times that a case may kill its worker before it is set aside.
pub(crate) const MOST_TRIES: u64 = 3;
/// File name of a published result.
const PART: &str = "part.parquet";

/// Shard of a campaign.
#[derive(Clone, Copy, Debug)]
pub struct Shard<'a> {
    folder: &'a Folder,
    number: u64,
}

/// Lists the shards of a campaign without a result.
#[must_use]
pub fn missing(folder: &Folder) -> Vec<u64> {
    let all = 0..folder.manifest().shards();
    all.filter(|number| !Shard::of(folder, *number).is_published())
        .collect()
}

/// Claim on a shard, held until the value is dropped or its process ends.
pub(crate) struct Claim(#[expect(dead_code, reason = "never read: holds the lock")] File);

/// Error of reading a part.
#[derive(Debug, thiserror::Error)]
pub enum PartError {
    /// The shard has no result.
    #[error("no result")]
    Missing,
    /// The file is damaged, or belongs to another campaign.
    #[error("invalid result: {0}")]
    Broken(String),
    /// An I/O operation failed.
    #[error(transparent)]
    Io(io::Error),
}

impl From<TableError> for PartError {
    fn from(error: TableError) -> Self {
        match error {
            TableError::Io(error) if error.kind() == ErrorKind::NotFound => Self::Missing,
            TableError::Io(error) => Self::Io(error),
            TableError::Other(what) => Self::Broken(what),
        }
    }
}

impl<'a> Shard<'a> {
    /// Creates the handle of a shard by its number.
    #[must_use]
    pub const fn of(folder: &'a Folder, number: u64) -> Self {
        Self { folder, number }
    }

    /// Returns the number of the shard.
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Returns the cases of the shard.
    #[must_use]
    pub fn cases(&self) -> Range<u64> {
        self.folder.manifest().cases_of(self.number)
    }

    fn path(&self) -> PathBuf {
        let name = format!("{:08}", self.number);
        self.folder.path().join(SHARDS).join(name)
    }

    /// Returns the path of the shard's result.
    pub(crate) fn result(&self) -> PathBuf {
        self.path().join(PART)
    }

    /// Returns `true` if the shard has a result.
    pub(crate) fn is_published(&self) -> bool {
        self.result().exists()
    }

    /// Claims the shard; returns `None` if another worker holds it.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub(crate) fn claim(&self) -> io::Result<Option<Claim>> {
        let path = self.path();
        fs::create_dir_all(&path)?;
        let mut options = File::options();
        let file = options
            .create(true)
            .truncate(false)
            .write(true)
            .open(path.join("claim"))?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(Some(Claim(file))),
            Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Begins an attempt, which starts with the rows of earlier attempts.
    ///
    /// # Errors
    /// If the folder cannot be read or written.
    pub fn attempt(self) -> io::Result<Attempt<'a>> {
        Attempt::begin(self)
    }

    /// Counts the rows in the journals of a shard without a result; the flag is `true` if an attempt is alive.
    ///
    /// # Errors
    /// If the journals cannot be read.
    pub fn begun(&self) -> io::Result<(u64, bool)> {
        let path = self.path();
        let mut cases = BTreeSet::new();
        let mut is_alive = false;
        let paths = match journal::paths(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            paths => paths?,
        };
        for path in paths {
            if let Some(content) = journal::read(&path, self.folder)? {
                is_alive |= !content.is_dead;
                cases.extend(content.rows.into_keys());
            }
        }
        Ok((cases.len() as u64, is_alive))
    }

    /// Reads the result of the shard.
    ///
    /// # Errors
    /// If the result is missing or invalid.
    pub(crate) fn part(&self) -> Result<Part, PartError> {
        let bytes = fs::read(self.result()).map_err(TableError::Io)?;
        Part::read(bytes, self.folder, self.cases())
    }

    /// Reads the curves of the shard; `None` if they are missing or damaged.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn curves(&self, grid: &Grid) -> io::Result<Option<Curves>> {
        Curves::read(&self.path(), self.folder, self.number, grid)
    }

    /// Removes the files that dead workers left next to the result. Rows in these files are first compared with the
    /// result, and a difference is recorded, because a worker may have died before its own comparison.
    ///
    /// # Errors
    /// If the folder cannot be read, a difference cannot be recorded, or the result is invalid.
    pub fn sweep(&self) -> Result<(), PartError> {
        for entry in fs::read_dir(self.path()).map_err(PartError::Io)? {
            let path = entry.map_err(PartError::Io)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_journal = name.starts_with(journal::PREFIX);
            if !name.starts_with(journal::UNFINISHED) && !is_journal {
                continue;
            }
            // A live worker holds a lock on its file.
            let is_dead =
                |file: File| flock(file, FlockOperation::NonBlockingLockExclusive).is_ok();
            if File::open(&path).is_ok_and(is_dead) {
                if is_journal {
                    self.compare(&path)?;
                }
                let _ = fs::remove_file(&path); // another worker may have removed it
            }
        }
        Ok(())
    }

    /// Compares the rows of a journal with the result, and records the first difference.
    fn compare(&self, journal: &Path) -> Result<(), PartError> {
        let content = journal::read(journal, self.folder).map_err(PartError::Io)?;
        let Some(content) = content.filter(|content| !content.rows.is_empty()) else {
            return Ok(());
        };
        let columns = &self.folder.manifest().columns;
        let part = self.part()?;
        let mut pairs = (part.cases().iter().enumerate())
            .filter_map(|(place, case)| Some((place, content.rows.get(case)?)));
        let differs = pairs.find_map(|(place, (row, by))| {
            let fits = table::fits(row, columns);
            fits.then(|| difference(&part.row(place), row, columns, &by.maker()))?
        });
        match differs {
            Some(conflict) => self.folder.note(&conflict).map_err(PartError::Io),
            None => Ok(()),
        }
    }

    /// Withdraws a result to recompute the rows for which `is_kept` returns `false`: the other rows go to the journal of
    /// a finished attempt, from which the next worker takes them over. Does nothing while a worker holds the shard.
    ///
    /// # Errors
    /// If the shard has no valid result, or the folder cannot be written.
    pub fn reopen(&self, is_kept: impl Fn(&Row) -> bool) -> Result<(), PartError> {
        let io = PartError::Io;
        let Some(_claim) = self.claim().map_err(io)? else {
            return Ok(());
        };
        let part = self.part()?;
        let path = self.path();
        let mut journal = Journal::begin(&path, self.folder.id()).map_err(io)?;
        for (place, row) in part.rows().enumerate() {
            if is_kept(&row) {
                journal
                    .keep(&row, &part.circumstances_of(place))
                    .map_err(io)?;
            }
        }
        journal.sync().map_err(io)?;
        let on_disk = || File::open(&path).and_then(|folder| folder.sync_all());
        on_disk().map_err(io)?;
        fs::remove_file(self.result()).map_err(io)
    }

    /// Renames an invalid result so that it is computed again; returns the new path.
    ///
    /// # Errors
    /// If the file cannot be renamed.
    pub(crate) fn set_aside(&self) -> io::Result<PathBuf> {
        let path = self.path();
        let mut names = (1..).map(|number| path.join(format!("broken-{number}.parquet")));
        let free = names.find(|path| !path.exists()).unwrap_or_default();
        fs::rename(path.join(PART), &free)?;
        let _ = fs::remove_file(path.join(CURVES)); // may not exist
        Ok(free)
    }
}

#[cfg(test)]
pub(crate) mod tests;
