//! The journal of an attempt at a shard: each case before it starts, each row when it is there.
//!
//! A line is JSON and the beginning of its hash, so that a torn or damaged line is known and ends what counts. The
//! owner holds a lock on the file, which the kernel drops with the process: whoever gets the lock knows that the
//! attempt is dead. Rows of the dead are taken over; rows of the living are read but not waited for.

use std::collections::BTreeMap;
use std::fs::{File, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hil_facts::results::curve::Curve;
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use crate::folder::Folder;
use crate::table::{Cell, Row};

/// Longest time for which rows are not on the disk.
const UNSYNCED: Duration = Duration::from_millis(200);
/// First part of the names of files that are not what they are to be yet.
pub(crate) const UNFINISHED: &str = "unfinished-";
/// First and last part of the names of journals.
pub(crate) const PREFIX: &str = "attempt-";
const SUFFIX: &str = ".journal";

/// A line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Line {
    /// First line: the campaign, and where the attempt is made.
    Of { campaign: String, host: String },
    /// A case starts.
    Start(u64),
    /// A case is left, through no fault of its own.
    Left(u64),
    /// A case ended.
    Row {
        wall_s: f64,
        cells: Row,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        curve: Option<Curve>,
        /// Maker of a row that this attempt did not make.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by: Option<Maker>,
    },
}

/// Maker of a row.
#[derive(Debug, Serialize, Deserialize)]
struct Maker {
    host: String,
    attempt: String,
    tries: u64,
}

/// Circumstances of a row, which may differ from one run of its case to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Circumstances {
    /// Time that the case took, in s.
    pub wall_s: f64,
    /// Machine that it ran on.
    pub host: String,
    /// Name of the attempt.
    pub attempt: String,
    /// Attempts that started it, this one included.
    pub tries: u64,
}

/// A journal being written.
pub struct Journal {
    file: File,
    path: PathBuf,
    name: String,
    host: String,
    synced: Instant,
}

/// Content of a journal.
pub(crate) struct Found {
    pub(crate) path: PathBuf,
    /// True if nobody writes it any more.
    pub(crate) is_dead: bool,
    pub(crate) started: Vec<u64>,
    pub(crate) rows: BTreeMap<u64, (Row, Circumstances)>,
    /// Curves of those cases that need one kept.
    pub(crate) curves: BTreeMap<u64, Curve>,
}

impl Journal {
    /// Begins a journal in the folder of a shard.
    ///
    /// # Errors
    /// If it cannot be written or locked.
    pub fn begin(shard: &Path, campaign: &str) -> io::Result<Self> {
        let (file, path) = loop {
            // Nobody may see it as a journal before it is locked: it would look dead.
            let (file, unfinished) = unfinished(shard)?.into_parts();
            let name = unfinished.file_name().unwrap_or_default().to_string_lossy();
            let name = name.replace(UNFINISHED, PREFIX) + SUFFIX;
            let path = shard.join(name);
            match unfinished.persist(&path) {
                Ok(()) => break (file, path),
                // Swept away before it was locked.
                Err(error) if error.error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error.error),
            }
        };
        let host = rustix::system::uname()
            .nodename()
            .to_string_lossy()
            .into_owned();
        let mut journal = Self {
            file,
            name: name_of(&path),
            path,
            host: host.clone(),
            synced: Instant::now(),
        };
        journal.write(&Line::Of {
            campaign: campaign.into(),
            host,
        })?;
        Ok(journal)
    }

    /// Notes that a case starts.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn start(&mut self, case: u64) -> io::Result<()> {
        self.write(&Line::Start(case))
    }

    /// Notes that a case that started is left: its worker is asked to end.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn leave(&mut self, case: u64) -> io::Result<()> {
        self.write(&Line::Left(case))
    }

    /// Notes the row of a case, and its curve if that must be kept; it is on the disk soon, and at once if the case
    /// took long.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn row(&mut self, cells: &Row, wall_s: f64, curve: Option<Curve>) -> io::Result<()> {
        self.write(&Line::Row {
            wall_s,
            cells: cells.clone(),
            curve,
            by: None,
        })?;
        if self.synced.elapsed() >= UNSYNCED {
            self.sync()?;
        }
        Ok(())
    }

    /// Notes a row that an earlier attempt made.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn keep(&mut self, cells: &Row, of: &Circumstances) -> io::Result<()> {
        self.write(&Line::Row {
            wall_s: of.wall_s,
            cells: cells.clone(),
            curve: None,
            by: Some(Maker {
                host: of.host.clone(),
                attempt: of.attempt.clone(),
                tries: of.tries,
            }),
        })
    }

    /// Writes all notes to the disk.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        self.synced = Instant::now();
        Ok(())
    }

    /// Returns its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the machine that it is written on.
    #[must_use]
    pub fn host(&self) -> &str {
        &self.host
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, line: &Line) -> io::Result<()> {
        let mut text = serde_json::to_string(line)?;
        text += &sealed(&text);
        self.file.write_all(text.as_bytes())
    }
}

/// Makes a locked file in the folder of a shard that is not what it is to be yet: sweepers leave alone what is locked.
pub(crate) fn unfinished(shard: &Path) -> io::Result<NamedTempFile> {
    let made = tempfile::Builder::new()
        .prefix(UNFINISHED)
        .rand_bytes(10)
        .append(true)
        // Less what the process's mask takes away, as of any new file.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(shard)?;
    flock(made.as_file(), FlockOperation::LockExclusive)?;
    Ok(made)
}

fn sum(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..16].to_owned()
}

/// Makes the end of a line: its sum.
pub(crate) fn sealed(json: &str) -> String {
    format!(" {}\n", sum(json))
}

/// Takes the end off a line; none if it is not whole.
pub(crate) fn unsealed(line: &str) -> Option<&str> {
    let (json, told) = line.strip_suffix('\n')?.rsplit_once(' ')?;
    (told == sum(json)).then_some(json)
}

fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_prefix(PREFIX).unwrap_or(&name);
    name.strip_suffix(SUFFIX).unwrap_or(name).into()
}

/// Lists the journals of a shard.
pub(crate) fn paths(shard: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(shard)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(PREFIX) && name.ends_with(SUFFIX) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads a journal of this campaign, up to the first line that is not whole; none if it is gone or another's.
pub(crate) fn read(path: &Path, folder: &Folder) -> io::Result<Option<Found>> {
    let mut file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    // Asked before it is read: what the dead wrote is all there is.
    let is_dead = flock(&file, FlockOperation::NonBlockingLockShared).is_ok();
    // Not by its name: the attempt may end meanwhile, and remove it.
    let mut text = Vec::new();
    file.read_to_end(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    let mut lines = (text.split_inclusive('\n'))
        .map_while(|line| serde_json::from_str::<Line>(unsealed(line)?).ok());
    let Some(Line::Of { campaign: of, host }) = lines.next() else {
        return Ok(None);
    };
    if !folder.has_results_of(&of) {
        return Ok(None);
    }
    let mut found = Found {
        path: path.to_owned(),
        is_dead,
        started: Vec::new(),
        rows: BTreeMap::new(),
        curves: BTreeMap::new(),
    };
    for line in lines {
        match line {
            Line::Start(case) => found.started.push(case),
            Line::Left(case) => {
                let last = found.started.iter().rposition(|started| *started == case);
                last.map(|last| found.started.remove(last));
            }
            Line::Row {
                wall_s,
                cells,
                curve,
                by,
            } => {
                let case = cells.first().map_or(0, Cell::as_count);
                found.curves.extend(curve.map(|curve| (case, curve)));
                let by = by.unwrap_or_else(|| Maker {
                    host: host.clone(),
                    attempt: name_of(path),
                    tries: 1,
                });
                let circumstances = Circumstances {
                    wall_s,
                    host: by.host,
                    attempt: by.attempt,
                    tries: by.tries,
                };
                found.rows.insert(case, (cells, circumstances));
            }
            Line::Of { .. } => break,
        }
    }
    Ok(Some(found))
}
