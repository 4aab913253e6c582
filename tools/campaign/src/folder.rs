//! The folder of a campaign: its manifest, what is there, and what is missing.
//!
//! Nothing in it is decided by clocks, process numbers or times of files; hosts that share it need links and locks
//! of the file system, which are tried when it is planned.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};

use crate::manifest::{Copied, Manifest, ManifestError};

/// Folder of the shards.
pub const SHARDS: &str = "shards";
/// Folder of results that contradict earlier ones.
pub const CONFLICTS: &str = "conflicts";

/// A campaign's folder.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
    manifest: Manifest,
    is_sealed: bool,
    id: String,
}

/// Two results of one case that are not the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conflict {
    /// The case.
    pub case: u64,
    /// First column that differs.
    pub column: String,
    /// Value that counts.
    pub first: String,
    /// The other value.
    pub second: String,
    /// Machine and attempt of the other value.
    pub by: String,
}

impl std::fmt::Display for Conflict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            case,
            column,
            first,
            second,
            by,
        } = self;
        write!(
            f,
            "case {case} came out twice and not the same: {column} is {first}, and {second} by {by}"
        )
    }
}

impl Folder {
    /// Opens the folder of a campaign.
    ///
    /// # Errors
    /// If it is none.
    pub fn open(path: &Path) -> Result<Self, ManifestError> {
        let (manifest, is_sealed) = Manifest::read_sealed(path)?;
        Ok(Self {
            id: manifest.id(),
            path: path.to_owned(),
            manifest,
            is_sealed,
        })
    }

    /// Returns its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns its manifest.
    #[must_use]
    pub const fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Returns `true` if its manifest has a check sum, so that its identity can be relied on.
    #[must_use]
    pub const fn is_sealed(&self) -> bool {
        self.is_sealed
    }

    /// Returns the identity of its campaign.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Tells whether results with this identity are those of its campaign: its own, or of one that it grew from.
    #[must_use]
    pub fn has_results_of(&self, id: &str) -> bool {
        self.id == id || self.manifest.grown.iter().any(|stage| stage.id == id)
    }

    /// Checks the copies in it by their hashes.
    ///
    /// # Errors
    /// With the name of the first that is not as it was.
    pub fn check(&self) -> Result<(), String> {
        self.check_copies(self.manifest.files())
    }

    /// Checks some of the copies in it by their hashes.
    ///
    /// # Errors
    /// With the name of the first that is not as it was.
    pub fn check_copies<'a>(
        &self,
        files: impl IntoIterator<Item = &'a Copied>,
    ) -> Result<(), String> {
        for file in files {
            let path = self.path.join(&file.path);
            let mut hasher = blake3::Hasher::new();
            let hashed = File::open(&path).and_then(|file| io::copy(&mut &file, &mut hasher));
            hashed.map_err(|error| format!("{}: {error}", path.display()))?;
            let found = hasher.finalize().to_hex();
            if *found != *file.blake3 {
                return Err(format!(
                    "{} has hash {found}, and the campaign was planned with {}",
                    path.display(),
                    file.blake3
                ));
            }
        }
        Ok(())
    }

    /// Notes a contradiction.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn note(&self, conflict: &Conflict) -> io::Result<()> {
        let folder = self.path.join(CONFLICTS);
        fs::create_dir_all(&folder)?;
        let text = serde_json::to_vec_pretty(conflict)?;
        let hash = blake3::hash(&text).to_hex();
        let path = folder.join(format!("{:09}-{}.json", conflict.case, &hash[..8]));
        let mut part = tempfile::Builder::new()
            .prefix(".")
            // Less what the process's mask takes away, as of any new file.
            .permissions(fs::Permissions::from_mode(0o666))
            .tempfile_in(&folder)?;
        part.write_all(&text)?;
        part.as_file().sync_all()?;
        part.persist(path).map(|_| ()).map_err(|error| error.error)
    }

    /// Lists the contradictions so far.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn conflicts(&self) -> io::Result<Vec<Conflict>> {
        let entries = match fs::read_dir(self.path.join(CONFLICTS)) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries?,
        };
        let mut paths = Vec::new();
        for entry in entries {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.ends_with(".json") && !name.starts_with('.') {
                paths.push(path);
            }
        }
        paths.sort();
        let read = |path: PathBuf| {
            let broken = |error| io::Error::other(format!("{}: {error}", path.display()));
            serde_json::from_slice(&fs::read(&path)?).map_err(broken)
        };
        paths.into_iter().map(read).collect()
    }
}

/// Checks that a folder's file system has what workers need: links, and locks that another descriptor sees.
///
/// # Errors
/// With what it lacks.
pub fn try_out(folder: &Path) -> Result<(), String> {
    let shown = folder.display();
    let lacks = |what: &str, error: &dyn std::fmt::Display| {
        format!(
            "the file system of {shown} has no {what} ({error}); campaigns need them to count each case once"
        )
    };
    let probe = tempfile::Builder::new()
        .prefix(".probe-")
        .tempfile_in(folder);
    let probe = probe.map_err(|error| format!("cannot write to {shown}: {error}"))?;
    let other = probe.path().with_extension("link");
    let linked = fs::hard_link(probe.path(), &other);
    let again = fs::hard_link(probe.path(), &other);
    let _ = fs::remove_file(&other); // it may not be there
    linked.map_err(|error| lacks("links", &error))?;
    if again.is_ok() {
        return Err(lacks("links that refuse a second one", &"it was made"));
    }
    flock(probe.as_file(), FlockOperation::NonBlockingLockExclusive)
        .map_err(|error| lacks("locks", &error))?;
    let second = File::open(probe.path()).map_err(|error| lacks("files", &error))?;
    match flock(&second, FlockOperation::NonBlockingLockShared) {
        Err(_) => Ok(()),
        Ok(()) => Err(lacks("locks that keep others out", &"both got one")),
    }
}
