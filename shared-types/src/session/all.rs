//! All sessions of this user: their folder, and who may create and sweep in it.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{FlockOperation, flock};

use super::{SHARED_MEMORY, SessionError, SessionInfo, private_file, private_folder, unless_gone};
use crate::process::ProcessId;

/// How long another `hil` may hold the lock over all sessions while it creates or sweeps.
const LOCK_LIMIT: Duration = Duration::from_secs(10);

/// The folder of all sessions of this user.
fn all_sessions() -> PathBuf {
    let uid = rustix::process::geteuid().as_raw();
    Path::new(SHARED_MEMORY).join(format!("hil-{uid}"))
}

/// The folder of all sessions of this user, locked.
pub(super) struct AllSessions {
    pub(super) folder: PathBuf,
    _lock: File,
}

impl AllSessions {
    pub(super) fn lock() -> Result<Self, SessionError> {
        let (uid, folder) = (rustix::process::geteuid().as_raw(), all_sessions());
        let path = folder.join(".lock");
        let since = Instant::now();
        loop {
            if since.elapsed() > LOCK_LIMIT {
                return Err(SessionError::Locked(path));
            }
            match private_folder(&folder) {
                Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                    return Err(SessionError::io("create", &folder)(error));
                }
                _ => {}
            }
            // Not `metadata`: a link to a folder of ours elsewhere is not ours to use. Whoever ends
            // its last session removes the folder, also between two of these lines.
            let found = match fs::symlink_metadata(&folder) {
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                found => found.map_err(SessionError::io("read", &folder))?,
            };
            if !found.is_dir() || found.uid() != uid || found.mode() & 0o077 != 0 {
                return Err(SessionError::NotPrivate(folder));
            }
            let lock = match private_file(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                lock => lock.map_err(SessionError::io("create", &path))?,
            };
            if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok() && is_at(&lock, &path)
            {
                return Ok(Self {
                    folder,
                    _lock: lock,
                });
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn folders(&self) -> Result<Vec<PathBuf>, SessionError> {
        let entries = fs::read_dir(&self.folder).map_err(SessionError::io("read", &self.folder))?;
        let mut folders: Vec<PathBuf> = entries
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| path.is_dir())
            .collect();
        folders.sort();
        Ok(folders)
    }

    /// Removes what dead owners left; returns the names of their sessions.
    pub(super) fn sweep(&self) -> Result<Vec<String>, SessionError> {
        let mut swept = Vec::new();
        for folder in self.folders()? {
            if is_live(&folder) {
                continue;
            }
            swept.extend(
                folder
                    .file_name()
                    .map(|name| name.to_string_lossy().into_owned()),
            );
            match SessionInfo::read(&folder) {
                Ok(info) => {
                    end_orphans(&info.children);
                    info.remove()?;
                }
                // Its owner died before it could write down anything else to remove.
                Err(_) => unless_gone(fs::remove_dir_all(&folder))
                    .map_err(SessionError::io("remove", &folder))?,
            }
        }
        Ok(swept)
    }
}

impl Drop for AllSessions {
    /// The last session takes the folder with it.
    fn drop(&mut self) {
        if self.folders().is_ok_and(|folders| folders.is_empty()) {
            // What cannot be removed now is empty and goes with the next session.
            let _ = fs::remove_file(self.folder.join(".lock"));
            let _ = fs::remove_dir(&self.folder);
        }
    }
}

/// Whether an open file is still the one at its path.
fn is_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(there)) => (open.dev(), open.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// Whether someone holds the session's lock.
fn is_live(folder: &Path) -> bool {
    let Ok(lock) = File::open(folder.join("lock")) else {
        return false;
    };
    flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err()
}

/// Children of a dead owner end by themselves when their input closes; a stopped one cannot.
fn end_orphans(children: &[ProcessId]) {
    let since = Instant::now();
    let grace = Duration::from_millis(200);
    while children.iter().any(|child| child.is_alive()) && since.elapsed() < grace {
        std::thread::sleep(Duration::from_millis(2));
    }
    for child in children {
        child.kill();
        child.kill_group();
    }
    while children.iter().any(|child| child.is_alive()) && since.elapsed() < 5 * grace {
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The live sessions of this user.
///
/// # Errors
/// If their folder cannot be used.
pub fn list() -> Result<Vec<SessionInfo>, SessionError> {
    let all = AllSessions::lock()?;
    let live = all.folders()?.into_iter().filter(|folder| is_live(folder));
    Ok(live
        .filter_map(|folder| SessionInfo::read(&folder).ok())
        .collect())
}

/// The names of dead sessions that left something behind.
///
/// # Errors
/// If their folder cannot be used.
pub fn dead() -> Result<Vec<String>, SessionError> {
    let all = AllSessions::lock()?;
    let dead = (all.folders()?.into_iter()).filter(|folder| !is_live(folder));
    Ok(dead
        .filter_map(|folder| Some(folder.file_name()?.to_string_lossy().into_owned()))
        .collect())
}

/// Removes what dead sessions left and returns their names. Live ones, also stopped, stay.
///
/// # Errors
/// If something of a dead session cannot be removed.
pub fn sweep() -> Result<Vec<String>, SessionError> {
    if !all_sessions().exists() {
        return Ok(Vec::new());
    }
    AllSessions::lock()?.sweep()
}
