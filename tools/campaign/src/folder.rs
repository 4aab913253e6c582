//! A campaign's folder: its manifest, its shards and the conflicts between results.
//!
//! No decision depends on clocks, process IDs or file times. Hosts that share a folder need hard links and locks from
//! the file system; planning a campaign tests both.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};

use crate::manifest::{Copied, Manifest, ManifestError};

/// Subfolder of the shards.
pub(crate) const SHARDS: &str = "shards";
/// Subfolder of results that contradict earlier ones.
pub(crate) const CONFLICTS: &str = "conflicts";

/// A campaign's folder.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
    manifest: Manifest,
    is_sealed: bool,
    id: String,
}

/// Conflict between two results of the same case.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conflict {
    /// Case number.
    pub case: u64,
    /// First column that differs.
    pub column: String,
    /// Value of the result that counts.
    pub first: String,
    /// Value of the other result.
    pub second: String,
    /// Host and attempt of the other result.
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
            "case {case} has two different results: {column} is {first}, but {second} from {by}"
        )
    }
}

impl Folder {
    /// Opens the folder of a campaign.
    ///
    /// # Errors
    /// If the folder has no readable manifest.
    pub fn open(path: &Path) -> Result<Self, ManifestError> {
        let (manifest, is_sealed) = Manifest::read_sealed(path)?;
        Ok(Self {
            id: manifest.id(),
            path: path.to_owned(),
            manifest,
            is_sealed,
        })
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the manifest of the campaign.
    #[must_use]
    pub const fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Returns `true` if the manifest has a checksum, so that the campaign's identity can be relied on.
    pub(crate) const fn is_sealed(&self) -> bool {
        self.is_sealed
    }

    /// Returns the identity of the campaign.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Returns `true` if `id` identifies this campaign or one from which it grew, so that its results are valid here.
    pub(crate) fn has_results_of(&self, id: &str) -> bool {
        self.id == id || self.manifest.grown.iter().any(|stage| stage.id == id)
    }

    /// Verifies the hashes of all copied files.
    ///
    /// # Errors
    /// If a copy cannot be read or has changed; the message names the first one.
    pub fn check(&self) -> Result<(), String> {
        self.check_copies(self.manifest.files())
    }

    /// Verifies the hashes of some of the copied files.
    ///
    /// # Errors
    /// If a copy cannot be read or has changed; the message names the first one.
    pub(crate) fn check_copies<'a>(
        &self,
        files: impl IntoIterator<Item = &'a Copied>,
    ) -> Result<(), String> {
        for file in files {
            let path = self.path.join(&file.path);
            let mut hasher = blake3::Hasher::new();
            let hashed = File::open(&path).and_then(|file| io::copy(&mut &file, &mut hasher));
            hashed.map_err(|error| format!("{}: {error}", path.display()))?;
            let actual = hasher.finalize().to_hex();
            if *actual != *file.blake3 {
                return Err(format!(
                    "{} has hash {actual}, and the campaign was planned with {}",
                    path.display(),
                    file.blake3
                ));
            }
        }
        Ok(())
    }

    /// Records a conflict.
    ///
    /// # Errors
    /// If the conflict cannot be written.
    pub(crate) fn note(&self, conflict: &Conflict) -> io::Result<()> {
        let folder = self.path.join(CONFLICTS);
        fs::create_dir_all(&folder)?;
        let text = serde_json::to_vec_pretty(conflict)?;
        let hash = blake3::hash(&text).to_hex();
        let path = folder.join(format!("{:09}-{}.json", conflict.case, &hash[..8]));
        let mut part = tempfile::Builder::new()
            .prefix(".")
            // The umask applies, as for any new file.
            .permissions(fs::Permissions::from_mode(0o666))
            .tempfile_in(&folder)?;
        part.write_all(&text)?;
        part.as_file().sync_all()?;
        part.persist(path).map(|_| ()).map_err(|error| error.error)
    }

    /// Lists the conflicts recorded so far.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub(crate) fn conflicts(&self) -> io::Result<Vec<Conflict>> {
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

/// Checks that the file system of a folder supports what workers need: hard links, and locks across descriptors.
///
/// # Errors
/// If the folder cannot be written or a feature is missing; the message names the feature.
pub(crate) fn try_out(folder: &Path) -> Result<(), String> {
    let folder_text = folder.display();
    let lacks = |what: &str, error: &dyn std::fmt::Display| {
        format!(
            "the file system of {folder_text} does not support {what} ({error}), which campaigns need to count each case once"
        )
    };
    let probe = tempfile::Builder::new()
        .prefix(".probe-")
        .tempfile_in(folder);
    let probe = probe.map_err(|error| format!("cannot write to {folder_text}: {error}"))?;
    let other = probe.path().with_extension("link");
    let linked = fs::hard_link(probe.path(), &other);
    let again = fs::hard_link(probe.path(), &other);
    let _ = fs::remove_file(&other); // may not exist
    linked.map_err(|error| lacks("links", &error))?;
    if again.is_ok() {
        return Err(lacks("exclusive links", &"a second link succeeded"));
    }
    flock(probe.as_file(), FlockOperation::NonBlockingLockExclusive)
        .map_err(|error| lacks("locks", &error))?;
    let second = File::open(probe.path()).map_err(|error| lacks("files", &error))?;
    match flock(&second, FlockOperation::NonBlockingLockShared) {
        Err(_) => Ok(()),
        Ok(()) => Err(lacks("exclusive locks", &"both requests succeeded")),
    }
}
