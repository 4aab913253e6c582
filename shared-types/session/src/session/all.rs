//! All sessions of this user: their folder, and the lock for creating and sweeping in it.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use super::{
    SHARED_MEMORY, SessionError, SessionInfo, guard, is_live, is_name, noted_prefix,
    private_folder, remove_below, remove_folder,
};
use crate::private_folder::{is_at, private_file};
use crate::process::ProcessId;

/// Time for which another `hil` may hold the lock over all sessions, to create or sweep sessions.
const LOCK_LIMIT: Duration = Duration::from_secs(10);
/// Polling interval of that lock, which is held for about as long.
const LOCK_LOOK: Duration = Duration::from_micros(200);

/// Environment variable with the name of a session group. Sessions of different groups do not see each other, as if
/// they belonged to different users; ungrouped sessions form another such group.
pub const GROUP: &str = "HIL_SESSION_GROUP";

/// Returns the folder of all sessions of this user in this process's group.
fn all_sessions() -> Result<PathBuf, SessionError> {
    let group = std::env::var_os(GROUP).filter(|group| !group.is_empty());
    folder_of(group.as_deref())
}

/// Returns the folder of all sessions of this user in a group.
fn folder_of(group: Option<&OsStr>) -> Result<PathBuf, SessionError> {
    let uid = rustix::process::geteuid().as_raw();
    let name = match group.map(|group| (group, group.to_str())) {
        None => format!("hil-{uid}"),
        Some((_, Some(group))) if is_name(group) => format!("hil-{uid}-{group}"),
        Some((group, _)) => return Err(SessionError::Group(group.to_string_lossy().into_owned())),
    };
    Ok(Path::new(SHARED_MEMORY).join(name))
}

/// Locked folder of all sessions of this user.
pub(super) struct AllSessions {
    pub(super) folder: PathBuf,
    _lock: File,
}

impl AllSessions {
    pub(super) fn lock() -> Result<Self, SessionError> {
        Self::lock_in(&all_sessions()?, LOCK_LIMIT)
    }

    /// Locks a folder of sessions; on timeout the error names the obstacle.
    fn lock_in(folder: &Path, limit: Duration) -> Result<Self, SessionError> {
        let since = Instant::now();
        loop {
            let obstacle = match Self::try_lock(folder)? {
                Ok(locked) => return Ok(locked),
                Err(obstacle) => obstacle,
            };
            if since.elapsed() > limit {
                return Err(obstacle);
            }
            std::thread::sleep(LOCK_LOOK);
        }
    }

    /// Tries once; the inner error is a temporary obstacle.
    fn try_lock(folder: &Path) -> Result<Result<Self, SessionError>, SessionError> {
        let (uid, path) = (rustix::process::geteuid().as_raw(), folder.join(".lock"));
        match private_folder(folder) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                return Err(SessionError::io("create", folder)(error));
            }
            _ => {}
        }
        // Not `metadata`: a link to a folder of ours elsewhere must not be used. The process that ends its last session
        // removes the folder, possibly between two of these lines.
        let passing = |error: io::Error, action, path: &Path| match error.kind() {
            ErrorKind::NotFound => Ok(SessionError::io(action, path)(error)),
            _ => Err(SessionError::io(action, path)(error)),
        };
        let metadata = match fs::symlink_metadata(folder) {
            Err(error) => return passing(error, "read", folder).map(Err),
            Ok(metadata) => metadata,
        };
        if !metadata.is_dir() || metadata.uid() != uid || metadata.mode() & 0o077 != 0 {
            return Err(SessionError::NotPrivate(folder.to_owned()));
        }
        let lock = match private_file(&path) {
            Err(error) => return passing(error, "open", &path).map(Err),
            Ok(lock) => lock,
        };
        Ok(
            match flock(&lock, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) if is_at(&lock, &path) => Ok(Self {
                    folder: folder.to_owned(),
                    _lock: lock,
                }),
                Ok(()) | Err(Errno::WOULDBLOCK) => Err(SessionError::Locked(path)),
                Err(error) => return Err(SessionError::io("lock", &path)(error.into())),
            },
        )
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

    /// Removes the remains of dead owners and returns the names of their sessions.
    pub(super) fn sweep(&self) -> Result<Vec<String>, SessionError> {
        let mut swept = Vec::new();
        for folder in self.folders()? {
            if is_live(&folder) && !guard::dies(&folder) {
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
                // Its owner died before writing it, or it is damaged: the lock contains the prefix too.
                Err(_) => {
                    if let Some(prefix) = noted_prefix(&folder) {
                        remove_below(&prefix)?;
                    }
                    remove_folder(&folder)?;
                }
            }
        }
        Ok(swept)
    }
}

impl Drop for AllSessions {
    /// Removes the folder once no session is left in it.
    fn drop(&mut self) {
        if self.folders().is_ok_and(|folders| folders.is_empty()) {
            // Anything that cannot be removed now is empty and removed with the next session.
            let _ = fs::remove_file(self.folder.join(".lock"));
            let _ = fs::remove_dir(&self.folder);
        }
    }
}

/// Ends the children of a dead owner. They end by themselves when their input closes, but a stopped child cannot.
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

/// Removes the sessions of this process and immediately kills the processes that it started. Waits for no lock, because
/// the thread that holds it may never continue.
pub fn abandon() {
    let own = ProcessId::own();
    for session in peek().iter().filter(|session| session.owner == own) {
        let _ = session.remove(); // the next sweep tries again
    }
    drop(all_sessions().and_then(|folder| AllSessions::lock_in(&folder, Duration::ZERO)));
}

/// Lists the live sessions of this user.
///
/// # Errors
/// If the folder of sessions cannot be used.
pub fn list() -> Result<Vec<SessionInfo>, SessionError> {
    let all = AllSessions::lock()?;
    let live = all.folders()?.into_iter().filter(|folder| is_live(folder));
    Ok(live
        .filter_map(|folder| SessionInfo::read(&folder).ok())
        .collect())
}

/// Lists the live sessions of this user that are visible now; neither waits nor creates anything.
#[must_use]
pub fn peek() -> Vec<SessionInfo> {
    let entries = all_sessions().ok().and_then(|all| fs::read_dir(all).ok());
    let folders = entries
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let live = folders.filter(|folder| folder.is_dir() && is_live(folder));
    let mut live: Vec<_> = live
        .filter_map(|folder| SessionInfo::read(&folder).ok())
        .collect();
    live.sort_by(|a, b| a.name.cmp(&b.name));
    live
}

/// Lists the names of dead sessions with remaining files.
///
/// # Errors
/// If the folder of sessions cannot be used.
pub fn dead() -> Result<Vec<String>, SessionError> {
    let all = AllSessions::lock()?;
    let folders = all.folders()?.into_iter();
    let dead = folders.filter(|folder| !is_live(folder) || guard::dies(folder));
    Ok(dead
        .filter_map(|folder| Some(folder.file_name()?.to_string_lossy().into_owned()))
        .collect())
}

/// Removes the remains of dead sessions and returns their names. Live sessions remain, even stopped ones.
///
/// # Errors
/// If a file of a dead session cannot be removed.
pub fn sweep() -> Result<Vec<String>, SessionError> {
    if !all_sessions()?.exists() {
        return Ok(Vec::new());
    }
    crate::private_folder::sweep();
    AllSessions::lock()?.sweep()
}

#[cfg(test)]
mod tests {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use tempfile::tempdir;

    use super::*;

    #[test]
    fn a_failure_to_lock_is_reported_with_its_cause() {
        let place = tempdir().expect("a folder");
        let limit = Duration::from_millis(20);
        let folder = place.path().join("hil-0");
        let message = || match AllSessions::lock_in(&folder, limit) {
            Ok(_) => "locked".to_owned(),
            Err(error) => error.to_string(),
        };
        assert_eq!(message(), "locked");
        private_folder(&folder).expect("made");
        let path = folder.join(".lock");
        let open = |why: &str| format!("cannot open {}: {why}", path.display());

        std::os::unix::fs::symlink(place.path().join("none/none"), &path).expect("linked");
        assert_eq!(message(), open("No such file or directory (os error 2)"));
        fs::remove_file(&path).expect("removed");
        fs::create_dir(&path).expect("made");
        assert_eq!(message(), open("Is a directory (os error 21)"));
        fs::remove_dir(&path).expect("removed");

        let lock = private_file(&path).expect("made");
        flock(&lock, FlockOperation::NonBlockingLockExclusive).expect("free");
        assert!(message().ends_with("resume or end it"), "{}", message());
        drop(lock);
        assert_eq!(message(), "locked");
    }

    #[test]
    fn a_group_has_a_folder_of_its_own_beside_that_of_the_user() {
        let folder = |group: Option<&str>| {
            folder_of(group.map(OsStr::new)).map_err(|error| error.to_string())
        };
        let uid = rustix::process::geteuid().as_raw();
        let of_user = format!("/dev/shm/hil-{uid}");
        assert_eq!(folder(None), Ok(PathBuf::from(&of_user)));
        let of_group = PathBuf::from(format!("{of_user}-ci-7"));
        assert_eq!(folder(Some("ci-7")), Ok(of_group));
        for name in ["..", "a/b", "A", &"a".repeat(25)] {
            let error = folder(Some(name)).expect_err(name);
            assert!(error.contains("HIL_SESSION_GROUP"), "{error}");
        }
    }

    #[test]
    fn a_session_whose_lock_cannot_be_checked_is_not_dead() {
        let place = tempdir().expect("a folder");
        let folder = place.path();
        assert!(!is_live(folder));
        // Neither to be opened nor missing, for any user.
        std::os::unix::fs::symlink("lock", folder.join("lock")).expect("linked");
        assert!(is_live(folder));
    }

    #[test]
    fn a_pipe_in_place_of_a_file_blocks_nobody() {
        let folder = tempdir().expect("a folder");
        let place = folder.path().to_owned();
        for name in ["lock", "session.json", ".lock"] {
            let mode = Mode::RUSR | Mode::WUSR;
            mknodat(CWD, place.join(name), FileType::Fifo, mode, 0).expect("made");
        }
        let (sender, waits) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let read = SessionInfo::read(&place).is_ok();
            let actual = (is_live(&place), noted_prefix(&place), read);
            let _ = sender.send((actual, AllSessions::lock_in(&place, Duration::ZERO).is_ok()));
        });
        let actual = waits.recv_timeout(Duration::from_secs(60));
        assert_eq!(actual, Ok(((false, None, false), false)));
    }
}
