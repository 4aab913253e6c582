//! An attempt at a shard: rows of one worker, together with those of earlier attempts, until they are published.

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

/// Attempt at a shard.
pub struct Attempt<'a> {
    pub(super) shard: Shard<'a>,
    pub(super) journal: Journal,
    pub(super) rows: BTreeMap<u64, (Row, Circumstances)>,
    /// Number of dead attempts that started a case without recording its row.
    tries: BTreeMap<u64, u64>,
    /// Journals of dead attempts.
    stale: Vec<PathBuf>,
    conflict: Option<Conflict>,
    curves: Curves,
}

/// Outcome of publishing an attempt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Published {
    /// The result was the first one of the shard and counts.
    First,
    /// An earlier result exists, with the same rows.
    Again,
    /// An earlier result exists, with different rows.
    Otherwise(Conflict),
}

impl<'a> Attempt<'a> {
    /// Begins an attempt with the rows of earlier attempts.
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
        // Curves of a withdrawn result, or of a worker that died just before publishing.
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
        let is_valid = |id: &str| self.shard.folder.has_results_of(id);
        let Some(content) = journal::read(path, is_valid)? else {
            return Ok(());
        };
        let columns = &self.shard.folder.manifest().columns;
        for case in content
            .started
            .iter()
            .filter(|case| !content.rows.contains_key(case))
        {
            *self.tries.entry(*case).or_default() += u64::from(content.is_dead);
        }
        for (case, (row, circumstances)) in content.rows {
            if !self.shard.cases().contains(&case) || !table::fits(&row, columns) {
                continue;
            }
            if let Some(curve) = content.curves.get(&case) {
                self.curves.take(self.shard.folder.manifest(), &row, curve);
            }
            self.keep(case, row, circumstances);
        }
        if content.is_dead {
            self.stale.push(content.path);
        }
        Ok(())
    }

    /// Retains the first row of a case, and compares later rows with it.
    fn keep(&mut self, case: u64, row: Row, circumstances: Circumstances) {
        match self.rows.get(&case) {
            Some((first, _)) => {
                let columns = &self.shard.folder.manifest().columns;
                let conflict = difference(first, &row, columns, &circumstances.maker());
                self.conflict = self.conflict.take().or(conflict);
            }
            None => {
                self.rows.insert(case, (row, circumstances));
            }
        }
    }

    /// Returns `true` if the row of the case is available.
    pub(crate) fn has(&self, case: u64) -> bool {
        self.rows.contains_key(&case)
    }

    /// Returns the number of workers that died while running the case.
    pub(crate) fn tries(&self, case: u64) -> u64 {
        self.tries.get(&case).copied().unwrap_or_default()
    }

    /// Records the start of a case.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub(crate) fn start(&mut self, case: u64) -> io::Result<()> {
        self.journal.start(case)
    }

    /// Records that a started case is abandoned because the worker was asked to end.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub(crate) fn leave(&mut self, case: u64) -> io::Result<()> {
        self.journal.leave(case)
    }

    /// Adds the row of a case, with its curve if there is one.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub fn row(&mut self, row: Row, wall_s: f64, curve: Option<Curve>) -> io::Result<()> {
        let manifest = self.shard.folder.manifest();
        // A curve inside the envelope of journaled curves adds nothing.
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
            let _ = fs::remove_file(path); // another worker may have removed it
        }
    }

    /// Publishes the rows, which must include every case of the shard, and removes the files that are no longer
    /// needed.
    ///
    /// # Errors
    /// If the result cannot be written, or an earlier result cannot be read.
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
        // Created in the shard's folder: some file systems refuse links across folders.
        let part = journal::unfinished(&path).map_err(io)?;
        part.as_file().write_all(&bytes).map_err(io)?;
        part.as_file().sync_all().map_err(io)?;
        let linked = fs::hard_link(part.path(), &place);
        // A network file system may lose the reply to a successful link.
        let is_there = linked.is_ok()
            || part
                .as_file()
                .metadata()
                .is_ok_and(|file| file.nlink() == 2);
        let mut published = Published::First;
        // Cleanups spare locked files, but may have come before the lock.
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
            let conflict = pairs
                .find_map(|(first, (second, by))| difference(&first, second, columns, &by.maker()));
            published = conflict.map_or(Published::Again, Published::Otherwise);
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

/// Returns the first column in which two rows of a case differ; `by` names the origin of the second row. A case that
/// was set aside contradicts nothing.
pub(crate) fn difference(
    first: &Row,
    second: &Row,
    columns: &[Column],
    by: &str,
) -> Option<Conflict> {
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

/// Returns `true` if the row belongs to a case that was set aside.
fn is_lost(row: &Row, columns: &[Column]) -> bool {
    let class = columns.iter().position(|column| column.name == CLASS);
    class.is_some_and(|class| row[class].as_text() == LOST)
}
