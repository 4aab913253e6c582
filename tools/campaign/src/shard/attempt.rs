//! An attempt at a shard: the rows of one worker, with those that earlier ones left, until they are published.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use hil_facts::results::curve::Curve;

use super::part::Part;
use super::{PART, PartError, Shard};
use crate::curves::Curves;
use crate::folder::Conflict;
use crate::journal::{self, Circumstances, Journal};
use crate::table::{self, CLASS, Column, LOST, Row};

/// An attempt at a shard.
pub struct Attempt<'a> {
    pub(super) shard: Shard<'a>,
    pub(super) journal: Journal,
    pub(super) rows: BTreeMap<u64, (Row, Circumstances)>,
    /// Dead attempts that started a case and have no row of it.
    tries: BTreeMap<u64, u64>,
    /// Journals of the dead.
    stale: Vec<PathBuf>,
    conflict: Option<Conflict>,
    curves: Curves,
}

/// End of an attempt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Published {
    /// Counts, as the first result of its case.
    First,
    /// Another one was first, with the same rows.
    Again,
    /// Another one was first, with other rows.
    Otherwise(Conflict),
}

impl<'a> Attempt<'a> {
    /// Begins it, with what earlier ones left.
    pub(super) fn begin(shard: Shard<'a>) -> io::Result<Self> {
        let path = shard.path();
        fs::create_dir_all(&path)?;
        let journal = Journal::begin(&path, shard.folder.id())?;
        let mut attempt = Self {
            shard,
            journal,
            rows: BTreeMap::new(),
            tries: BTreeMap::new(),
            stale: Vec::new(),
            conflict: None,
            curves: Curves::default(),
        };
        // Those of a result that was opened again, or of a worker that died just before it had one.
        if let Some(grid) = &shard.folder.manifest().curves {
            attempt.curves =
                Curves::read(&path, shard.folder, shard.number, grid)?.unwrap_or_default();
        }
        for path in journal::paths(&path)? {
            if path != attempt.journal.path() {
                attempt.take_over(&path)?;
            }
        }
        Ok(attempt)
    }

    fn take_over(&mut self, path: &Path) -> io::Result<()> {
        let Some(found) = journal::read(path, self.shard.folder)? else {
            return Ok(());
        };
        let columns = &self.shard.folder.manifest().columns;
        for case in found
            .started
            .iter()
            .filter(|case| !found.rows.contains_key(case))
        {
            *self.tries.entry(*case).or_default() += u64::from(found.is_dead);
        }
        for (case, (row, circumstances)) in found.rows {
            if !self.shard.cases().contains(&case) || !table::fits(&row, columns) {
                continue;
            }
            if let Some(curve) = found.curves.get(&case) {
                self.curves.take(self.shard.folder.manifest(), &row, curve);
            }
            self.keep(case, row, circumstances);
        }
        if found.is_dead {
            self.stale.push(found.path);
        }
        Ok(())
    }

    /// Keeps the first row of a case, and compares later ones with it.
    fn keep(&mut self, case: u64, row: Row, circumstances: Circumstances) {
        match self.rows.get(&case) {
            Some((first, _)) => {
                let columns = &self.shard.folder.manifest().columns;
                let found = difference(first, &row, columns, &circumstances.maker());
                self.conflict = self.conflict.take().or(found);
            }
            None => {
                self.rows.insert(case, (row, circumstances));
            }
        }
    }

    /// Tells whether a case has its row.
    #[must_use]
    pub fn has(&self, case: u64) -> bool {
        self.rows.contains_key(&case)
    }

    /// Counts the workers that a case has ended.
    #[must_use]
    pub fn tries(&self, case: u64) -> u64 {
        self.tries.get(&case).copied().unwrap_or_default()
    }

    /// Notes that a case starts.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn start(&mut self, case: u64) -> io::Result<()> {
        self.journal.start(case)
    }

    /// Notes that a case that started is left: the worker is asked to end.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn leave(&mut self, case: u64) -> io::Result<()> {
        self.journal.leave(case)
    }

    /// Takes the row of a case, with its curve if it has one.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn row(&mut self, row: Row, wall_s: f64, curve: Option<Curve>) -> io::Result<()> {
        let manifest = self.shard.folder.manifest();
        // What lies within the curves of rows that were noted before follows from those.
        let curve = curve.filter(|curve| self.curves.take(manifest, &row, curve));
        self.journal.row(&row, wall_s, curve)?;
        let case = row[0].as_count();
        let circumstances = Circumstances {
            wall_s,
            host: self.journal.host().into(),
            attempt: self.journal.name().into(),
            tries: self.tries(case) + 1,
        };
        self.keep(case, row, circumstances);
        Ok(())
    }

    fn remove_journals(&self) {
        let stale = self.stale.iter().map(PathBuf::as_path);
        for path in stale.chain([self.journal.path()]) {
            let _ = fs::remove_file(path); // another worker may have done so
        }
    }

    /// Publishes the rows, of which there must be one for each case, and removes what is not needed any more.
    ///
    /// # Errors
    /// If they cannot be written, or an earlier result not be read.
    pub fn publish(mut self) -> Result<Published, PartError> {
        let io = PartError::Io;
        let path = self.shard.path();
        let place = path.join(PART);
        if self.shard.folder.manifest().curves.is_some() {
            let (folder, number) = (self.shard.folder, self.shard.number);
            self.curves.write(&path, folder, number).map_err(io)?;
        }
        let (rows, circumstances): (Vec<Row>, Vec<Circumstances>) =
            std::mem::take(&mut self.rows).into_values().unzip();
        let columns = &self.shard.folder.manifest().columns;
        let bytes = Part::bytes(self.shard.folder, &rows, &circumstances)?;
        // In the folder of the shard: some file systems refuse links across folders.
        let part = journal::unfinished(&path).map_err(io)?;
        part.as_file().write_all(&bytes).map_err(io)?;
        part.as_file().sync_all().map_err(io)?;
        let linked = fs::hard_link(part.path(), &place);
        // A network file system may lose the answer to a link that it made.
        let is_there = linked.is_ok()
            || part
                .as_file()
                .metadata()
                .is_ok_and(|file| file.nlink() == 2);
        let mut published = Published::First;
        // Sweepers leave alone what is locked; they may have been faster than the lock.
        let is_late = linked.is_err() && place.exists();
        if is_there {
            File::open(&path)
                .and_then(|folder| folder.sync_all())
                .map_err(io)?;
        } else if let Err(error) = linked
            && !is_late
        {
            return Err(PartError::Io(error));
        } else {
            let first = self.shard.part()?;
            let mut pairs = first.rows().zip(rows.iter().zip(&circumstances));
            let found = pairs
                .find_map(|(first, (second, by))| difference(&first, second, columns, &by.maker()));
            published = found.map_or(Published::Again, Published::Otherwise);
        }
        if let Some(conflict) = self.conflict.take() {
            published = Published::Otherwise(conflict);
        }
        if let Published::Otherwise(conflict) = &published {
            self.shard.folder.note(conflict).map_err(io)?;
        }
        self.remove_journals();
        Ok(published)
    }
}

/// Finds the first column in which two rows of a case differ, the second made `by` somebody. A case that was set
/// aside contradicts nothing.
#[must_use]
pub fn difference(first: &Row, second: &Row, columns: &[Column], by: &str) -> Option<Conflict> {
    if first == second || is_lost(first, columns) || is_lost(second, columns) {
        return None;
    }
    let pairs = columns.iter().zip(first.iter().zip(second));
    let (column, (one, other)) = pairs.into_iter().find(|(_, (one, other))| one != other)?;
    Some(Conflict {
        case: first[0].as_count(),
        column: column.name.clone(),
        first: one.to_string(),
        second: other.to_string(),
        by: by.into(),
    })
}

/// Tells whether a row is of a case that was set aside.
fn is_lost(row: &Row, columns: &[Column]) -> bool {
    let class = columns.iter().position(|column| column.name == CLASS);
    class.is_some_and(|class| row[class].as_text() == LOST)
}
