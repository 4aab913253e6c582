//! Shards: cases in a row that one worker computes and publishes as a whole.
//!
//! A claim saves work and decides nothing: a shard that two workers compute is published by the one that links its
//! result first. The other one's rows are compared with it, so that a double execution, which no engine excludes,
//! becomes a check that runs repeat.

pub mod attempt;
pub mod part;

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

/// Times that a case may end its worker before it is set aside.
pub const MOST_TRIES: u64 = 3;
/// Name of a published result.
const PART: &str = "part.parquet";

/// A shard.
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

/// Claim on a shard, until it is dropped or its process ends.
pub struct Claim(#[expect(dead_code, reason = "held, never read: it has the lock")] File);

/// Reason for which a part does not count.
#[derive(Debug, thiserror::Error)]
pub enum PartError {
    /// No result.
    #[error("it has no result")]
    Missing,
    /// Damaged file, or one of another campaign.
    #[error("its result is broken: {0}")]
    Broken(String),
    /// The system refused.
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
    /// Makes a shard of a campaign by its number.
    #[must_use]
    pub const fn of(folder: &'a Folder, number: u64) -> Self {
        Self { folder, number }
    }

    /// Returns its number.
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Returns its cases.
    #[must_use]
    pub fn cases(&self) -> Range<u64> {
        self.folder.manifest().cases_of(self.number)
    }

    fn path(&self) -> PathBuf {
        let name = format!("{:08}", self.number);
        self.folder.path().join(SHARDS).join(name)
    }

    /// Returns the place of its result.
    pub(crate) fn result(&self) -> PathBuf {
        self.path().join(PART)
    }

    /// Tells whether it has a result.
    #[must_use]
    pub fn is_published(&self) -> bool {
        self.result().exists()
    }

    /// Claims it; none if another worker has it.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn claim(&self) -> io::Result<Option<Claim>> {
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

    /// Begins an attempt, with what earlier attempts left.
    ///
    /// # Errors
    /// If the folder cannot be read or written.
    pub fn attempt(self) -> io::Result<Attempt<'a>> {
        Attempt::begin(self)
    }

    /// Counts the rows that there are before the result is published.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn begun(&self) -> io::Result<(u64, bool)> {
        let path = self.path();
        let mut cases = BTreeSet::new();
        let mut is_alive = false;
        let paths = match journal::paths(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            paths => paths?,
        };
        for path in paths {
            if let Some(found) = journal::read(&path, self.folder)? {
                is_alive |= !found.is_dead;
                cases.extend(found.rows.into_keys());
            }
        }
        Ok((cases.len() as u64, is_alive))
    }

    /// Reads its result.
    ///
    /// # Errors
    /// If it has none, or one that does not count.
    pub fn part(&self) -> Result<Part, PartError> {
        let bytes = fs::read(self.result()).map_err(TableError::Io)?;
        Part::read(bytes, self.folder, self.cases())
    }

    /// Reads its curves; none if they are not there, or not whole.
    ///
    /// # Errors
    /// If their file cannot be read.
    pub(crate) fn curves(&self, grid: &Grid) -> io::Result<Option<Curves>> {
        Curves::read(&self.path(), self.folder, self.number, grid)
    }

    /// Removes what dead workers left beside its result. Rows among it are compared with the result first, and a
    /// difference is noted: who died may have had no time for it.
    ///
    /// # Errors
    /// If the folder cannot be read, a difference not be written, or the result does not count.
    pub fn sweep(&self) -> Result<(), PartError> {
        for entry in fs::read_dir(self.path()).map_err(PartError::Io)? {
            let path = entry.map_err(PartError::Io)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_journal = name.starts_with(journal::PREFIX);
            if !name.starts_with(journal::UNFINISHED) && !is_journal {
                continue;
            }
            // Whoever lives holds a lock on it.
            let is_dead =
                |file: File| flock(file, FlockOperation::NonBlockingLockExclusive).is_ok();
            if File::open(&path).is_ok_and(is_dead) {
                if is_journal {
                    self.compare(&path)?;
                }
                let _ = fs::remove_file(&path); // another one may have done so
            }
        }
        Ok(())
    }

    /// Compares the rows of a journal with the result, and notes the first difference.
    fn compare(&self, journal: &Path) -> Result<(), PartError> {
        let found = journal::read(journal, self.folder).map_err(PartError::Io)?;
        let Some(found) = found.filter(|found| !found.rows.is_empty()) else {
            return Ok(());
        };
        let columns = &self.folder.manifest().columns;
        let part = self.part()?;
        let mut pairs = (part.cases().iter().enumerate())
            .filter_map(|(place, case)| Some((place, found.rows.get(case)?)));
        let differs = pairs.find_map(|(place, (row, by))| {
            let fits = table::fits(row, columns);
            fits.then(|| difference(&part.row(place), row, columns, &by.maker()))?
        });
        match differs {
            Some(conflict) => self.folder.note(&conflict).map_err(PartError::Io),
            None => Ok(()),
        }
    }

    /// Opens a result again for the rows that are not `kept`: the others go to the journal of an attempt that is
    /// over, and whoever works on the shard next takes them over. Nothing happens while a worker has it.
    ///
    /// # Errors
    /// If it has no result that counts, or the folder cannot be written.
    pub fn reopen(&self, kept: impl Fn(&Row) -> bool) -> Result<(), PartError> {
        let io = PartError::Io;
        let Some(_claim) = self.claim().map_err(io)? else {
            return Ok(());
        };
        let part = self.part()?;
        let path = self.path();
        let mut journal = Journal::begin(&path, self.folder.id()).map_err(io)?;
        for (place, row) in part.rows().enumerate() {
            if kept(&row) {
                journal.keep(&row, &part.made(place)).map_err(io)?;
            }
        }
        journal.sync().map_err(io)?;
        let on_disk = || File::open(&path).and_then(|folder| folder.sync_all());
        on_disk().map_err(io)?;
        fs::remove_file(self.result()).map_err(io)
    }

    /// Sets a result that does not count aside, so that it is computed again; gives its new name.
    ///
    /// # Errors
    /// If it cannot be renamed.
    pub fn set_aside(&self) -> io::Result<PathBuf> {
        let path = self.path();
        let mut names = (1..).map(|number| path.join(format!("broken-{number}.parquet")));
        let free = names.find(|path| !path.exists()).unwrap_or_default();
        fs::rename(path.join(PART), &free)?;
        let _ = fs::remove_file(path.join(CURVES)); // there may be none
        Ok(free)
    }
}

#[cfg(test)]
pub(crate) mod tests;
