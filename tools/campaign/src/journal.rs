//! The journal of an attempt at a shard: an entry for each case before it starts, and for each row once it is
//! computed.
//!
//! Each line is JSON followed by the beginning of its hash, so that a torn or damaged line is detected and ends the
//! valid part. The writer holds a lock on the file that the kernel releases when the process ends: a process that
//! obtains the lock knows that the attempt is dead. Rows of dead attempts are reused; rows of live attempts are read
//! without waiting for the rest.

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

use crate::table::{Cell, Row};

/// Longest time before rows are synced to disk.
const UNSYNCED: Duration = Duration::from_millis(200);
/// Prefix of the names of files that are not complete yet.
pub(crate) const UNFINISHED: &str = "unfinished-";
/// Prefix and suffix of the names of journals.
pub(crate) const PREFIX: &str = "attempt-";
const SUFFIX: &str = ".journal";

/// Line of a journal.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Line {
    /// First line: the campaign, and the host of the attempt.
    Of { campaign: String, host: String },
    /// Start of a case.
    Start(u64),
    /// Case abandoned because the worker was asked to end; does not count as a failed try.
    Left(u64),
    /// End of a case.
    Row {
        wall_s: f64,
        cells: Row,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        curve: Option<Curve>,
        /// Origin of a row that this attempt reuses from another.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by: Option<Maker>,
    },
}

/// Origin of a row.
#[derive(Debug, Serialize, Deserialize)]
struct Maker {
    host: String,
    attempt: String,
    tries: u64,
}

/// Data about the computation of a row that may differ between runs of the same case.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Circumstances {
    /// Wall-clock time of the case, in s.
    pub wall_s: f64,
    /// Host of the case.
    pub host: String,
    /// Name of the attempt.
    pub attempt: String,
    /// Number of attempts that started the case, including this one.
    pub tries: u64,
}

/// Journal open for writing.
pub(crate) struct Journal {
    file: File,
    path: PathBuf,
    name: String,
    host: String,
    synced: Instant,
}

/// Content of a journal.
pub(crate) struct JournalContent {
    pub(crate) path: PathBuf,
    /// Set if the writer has ended.
    pub(crate) is_dead: bool,
    pub(crate) started: Vec<u64>,
    pub(crate) rows: BTreeMap<u64, (Row, Circumstances)>,
    /// Curves of the cases whose curve must be retained.
    pub(crate) curves: BTreeMap<u64, Curve>,
}

impl Journal {
    /// Creates a journal in the folder of a shard.
    ///
    /// # Errors
    /// If the file cannot be written or locked.
    pub(crate) fn begin(shard: &Path, campaign: &str) -> io::Result<Self> {
        let (file, path) = loop {
            // The file must not be visible as a journal before it is locked: it would look dead.
            let (file, unfinished) = unfinished(shard)?.into_parts();
            let name = unfinished.file_name().unwrap_or_default().to_string_lossy();
            let name = name.replace(UNFINISHED, PREFIX) + SUFFIX;
            let path = shard.join(name);
            match unfinished.persist(&path) {
                Ok(()) => break (file, path),
                // Removed by a cleanup before it was locked.
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

    /// Records the start of a case.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub(crate) fn start(&mut self, case: u64) -> io::Result<()> {
        self.write(&Line::Start(case))
    }

    /// Records that a started case is abandoned because the worker was asked to end.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub(crate) fn leave(&mut self, case: u64) -> io::Result<()> {
        self.write(&Line::Left(case))
    }

    /// Records the row of a case, and its curve if the curve must be retained. The entry is synced to disk soon, and at
    /// once after a long case.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub(crate) fn row(&mut self, cells: &Row, wall_s: f64, curve: Option<Curve>) -> io::Result<()> {
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

    /// Records a row that an earlier attempt computed.
    ///
    /// # Errors
    /// If the journal cannot be written.
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

    /// Syncs all entries to disk.
    ///
    /// # Errors
    /// If the journal cannot be written.
    pub(crate) fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        self.synced = Instant::now();
        Ok(())
    }

    /// Returns the name of the journal.
    #[must_use]
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Returns the host of the attempt.
    pub(crate) fn host(&self) -> &str {
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

/// Creates a locked temporary file in the folder of a shard; cleanups leave locked files alone.
pub(crate) fn unfinished(shard: &Path) -> io::Result<NamedTempFile> {
    let file = tempfile::Builder::new()
        .prefix(UNFINISHED)
        .rand_bytes(10)
        .append(true)
        // The umask applies, as for any new file.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(shard)?;
    flock(file.as_file(), FlockOperation::LockExclusive)?;
    Ok(file)
}

fn sum(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..16].to_owned()
}

/// Formats the end of a line: its checksum.
pub(crate) fn sealed(json: &str) -> String {
    format!(" {}\n", sum(json))
}

/// Verifies and strips the checksum of a line; `None` if the line is incomplete or damaged.
pub(crate) fn unsealed(line: &str) -> Option<&str> {
    let (json, sum_text) = line.strip_suffix('\n')?.rsplit_once(' ')?;
    (sum_text == sum(json)).then_some(json)
}

fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_prefix(PREFIX).unwrap_or(&name);
    name.strip_suffix(SUFFIX).unwrap_or(name).into()
}

/// Lists the journals of a shard.
pub(crate) fn paths(shard: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(shard)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(PREFIX) && name.ends_with(SUFFIX) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// Reads a journal up to the first invalid line; `None` if the journal is gone, or belongs to a campaign whose identity
/// is not valid here.
pub(crate) fn read(
    path: &Path,
    is_valid: impl Fn(&str) -> bool,
) -> io::Result<Option<JournalContent>> {
    let mut file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    // Checked before reading: the content of a dead attempt is final.
    let is_dead = flock(&file, FlockOperation::NonBlockingLockShared).is_ok();
    // Read through the descriptor: the attempt may end meanwhile and remove the file.
    let mut text = Vec::new();
    file.read_to_end(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    let mut lines = (text.split_inclusive('\n'))
        .map_while(|line| serde_json::from_str::<Line>(unsealed(line)?).ok());
    let Some(Line::Of { campaign: of, host }) = lines.next() else {
        return Ok(None);
    };
    if !is_valid(&of) {
        return Ok(None);
    }
    let mut content = JournalContent {
        path: path.to_owned(),
        is_dead,
        started: Vec::new(),
        rows: BTreeMap::new(),
        curves: BTreeMap::new(),
    };
    for line in lines {
        match line {
            Line::Start(case) => content.started.push(case),
            Line::Left(case) => {
                let last = content.started.iter().rposition(|started| *started == case);
                last.map(|last| content.started.remove(last));
            }
            Line::Row {
                wall_s,
                cells,
                curve,
                by,
            } => {
                let case = cells.first().map_or(0, Cell::as_count);
                content.curves.extend(curve.map(|curve| (case, curve)));
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
                content.rows.insert(case, (cells, circumstances));
            }
            Line::Of { .. } => break,
        }
    }
    Ok(Some(content))
}
