//! Results of points that outlive the process: rows in the journals of a folder.
//!
//! A journal names the scenario, tables and programs of its rows by one hash; rows of others are never used. A repeated
//! command takes over the rows of journals whose writers have ended.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use hil_console::terminal::exit::Failure;
use hil_session::file::hash;

use super::super::cases::Cases;
use crate::journal::{self, Journal};
use crate::table::Row;

/// Results in a folder, with the journal of this process.
pub(super) struct KeptResults {
    folder: PathBuf,
    rows: BTreeMap<u64, Row>,
    /// Number of processes that died in each case.
    tries: BTreeMap<u64, u64>,
    journal: Mutex<JournalInUse>,
}

/// Journal of this process.
struct JournalInUse {
    journal: Journal,
    /// Set if the journal has entries.
    is_used: bool,
}

impl Drop for KeptResults {
    /// Removes a journal without entries, as of a command that refused its study.
    fn drop(&mut self) {
        let kept = self.journal.get_mut();
        let kept = kept.unwrap_or_else(PoisonError::into_inner);
        if !kept.is_used {
            let _ = fs::remove_file(kept.journal.path()); // reported by the next command, if it is in the way
        }
    }
}

impl KeptResults {
    /// Opens a folder, which is created if it does not exist, and takes over its results.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub(super) fn open(folder: &Path, cases: &Cases) -> Result<Self, Failure> {
        let of = identity(cases)?;
        let cannot = |error: io::Error| cannot(folder, &error);
        fs::create_dir_all(folder).map_err(cannot)?;
        let earlier = journal::paths(folder).map_err(cannot)?;
        let mut journal = Journal::begin(folder, &of).map_err(cannot)?;
        let (mut rows, mut tries) = (BTreeMap::new(), BTreeMap::<u64, u64>::new());
        let mut stale = Vec::new();
        let mut is_other = false;
        for path in earlier {
            let content = journal::read(&path, |id| id == of).map_err(cannot)?;
            let Some(content) = content else {
                is_other = true;
                continue;
            };
            for (number, (row, circumstances)) in content.rows {
                if let std::collections::btree_map::Entry::Vacant(free) = rows.entry(number) {
                    journal.keep(&row, &circumstances).map_err(cannot)?;
                    free.insert(row);
                }
            }
            if content.is_dead {
                for number in content.started {
                    if !rows.contains_key(&number) {
                        *tries.entry(number).or_default() += 1;
                        journal.start(number).map_err(cannot)?;
                    }
                }
                stale.push(content.path);
            }
        }
        journal.sync().map_err(cannot)?;
        for path in stale {
            let _ = fs::remove_file(path); // another process may have removed it
        }
        if is_other {
            tell!(
                "note: {} also holds runs of another scenario or other programs, which are not used",
                folder.display()
            );
        }
        let is_used = !rows.is_empty() || !tries.is_empty();
        Ok(Self {
            folder: folder.to_owned(),
            rows,
            tries,
            journal: Mutex::new(JournalInUse { journal, is_used }),
        })
    }

    /// Returns the row of a point, if it has one.
    pub(super) fn row(&self, number: u64) -> Option<&Row> {
        self.rows.get(&number)
    }

    /// Returns the number of processes that died in the case.
    pub(super) fn tries(&self, number: u64) -> u64 {
        self.tries.get(&number).copied().unwrap_or_default()
    }

    /// Writes an entry to the journal.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn write(
        &self,
        entry: impl FnOnce(&mut Journal) -> io::Result<()>,
    ) -> Result<(), Failure> {
        let mut kept = self.journal.lock().unwrap_or_else(PoisonError::into_inner);
        kept.is_used = true;
        entry(&mut kept.journal).map_err(|error| cannot(&self.folder, &error))
    }

    /// Adds rows that are in the journal.
    ///
    /// # Errors
    /// If the journal cannot be synced to disk.
    pub(super) fn add(&mut self, rows: Vec<Row>) -> Result<(), Failure> {
        if !rows.is_empty() {
            self.write(Journal::sync)?;
        }
        let numbered = rows.into_iter().map(|row| (row[0].as_count(), row));
        self.rows.extend(numbered);
        Ok(())
    }
}

fn cannot(folder: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::infrastructure(format!(
        "cannot keep results in {}: {error}; choose another folder with -o",
        folder.display()
    ))
}

/// Returns a hash of everything that determines the result of a point, except its values.
///
/// # Errors
/// If a file cannot be read.
fn identity(cases: &Cases) -> Result<String, Failure> {
    let scenario = cases.scenario();
    let mut files = vec![std::env::current_exe().map_err(Failure::infrastructure)?];
    if let Some(binaries) = cases.binaries() {
        for side in [&binaries.plant, &binaries.controller] {
            files.push(side.path.clone());
            files.extend(side.host.iter().map(|host| host.path.clone()));
            files.extend(side.modules_beside()?.into_iter().map(|(file, _)| file));
        }
    }
    let beside = scenario.path().parent().unwrap_or(Path::new(""));
    files.extend(cases.named_tables().iter().map(|name| beside.join(name)));
    let mut hasher = blake3::Hasher::new();
    hasher.update(blake3::hash(scenario.text().as_bytes()).as_bytes());
    for path in files {
        let of_file = hash(&path)
            .map_err(|error| Failure::usage(format!("cannot read {}: {error}", path.display())))?;
        hasher.update(of_file.as_bytes());
    }
    Ok(hasher.finalize().to_hex().to_string())
}
