//! Private folders for unpacked files, removed with their process however the process ends.
//!
//! They are not in a session's folder, because shared memory is often mounted such that libraries in it cannot be
//! loaded, as in most containers. A private folder has mode 0700 and lies among the temporary files, next to a lock
//! that the kernel releases with the process. Its owner removes the folder; a folder whose lock is free is dead and is
//! removed by the next sweep, which each `hil` and each creator of a private folder performs.

use std::fs::{self, DirBuilder, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, OFlags, flock};

/// Extension of the lock file next to a folder.
const LOCK: &str = "lock";
/// Attempts to create a folder that no sweep mistakes for a dead one. Each of thousands of simultaneously starting and
/// ending processes may thwart one attempt.
const ATTEMPTS: u32 = 4096;

/// Private folder of this process, which is removed with its contents when this value is dropped.
#[derive(Debug)]
pub struct PrivateFolder {
    folder: PathBuf,
    // Held, never read: the kernel releases it with the process.
    _lock: File,
}

impl PrivateFolder {
    /// Creates a folder whose name has this prefix, after sweeping away dead folders.
    ///
    /// # Errors
    /// If the common parent folder is not exclusively this user's, or cannot be written.
    pub fn create(name: &str) -> io::Result<Self> {
        sweep();
        Self::create_in(&all_folders(), name)
    }

    fn create_in(all: &Path, name: &str) -> io::Result<Self> {
        let own = std::process::id();
        for attempt in 0..ATTEMPTS {
            if !make_private(all)? {
                continue;
            }
            let folder = all.join(format!("{name}-{own}-{attempt}"));
            let path = folder.with_extension(LOCK);
            let lock = match private_file(&path) {
                // The last owner before removed the parent folder.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                other => other?,
            };
            // A faster sweep holds it, or has removed it.
            let is_held = flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok();
            if !is_held || !is_at(&lock, &path) {
                continue;
            }
            match DirBuilder::new().mode(0o700).create(&folder) {
                Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
                other => other?,
            }
            return Ok(Self {
                folder,
                _lock: lock,
            });
        }
        Err(io::Error::other(format!(
            "no free name for a folder in {}; try again",
            all.display()
        )))
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

impl Drop for PrivateFolder {
    fn drop(&mut self) {
        remove(&self.folder);
    }
}

/// Removes the private folders of dead processes. The next sweep retries failures.
pub fn sweep() {
    sweep_in(&all_folders());
}

fn sweep_in(all: &Path) {
    if !fs::symlink_metadata(all).is_ok_and(|metadata| is_private(&metadata)) {
        return; // there is none, or it is not ours to clear
    }
    let entries = fs::read_dir(all).into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        if path.extension().is_none_or(|ending| ending != LOCK) {
            continue;
        }
        let Ok(lock) = open_at_once(&path) else {
            continue; // somebody else removed it
        };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok() && is_at(&lock, &path) {
            remove(&path.with_extension(""));
        }
    }
    let _ = fs::remove_dir(all); // only if it is empty
}

/// Removes a private folder and finally its lock: while the lock exists, a sweep finds the rest.
fn remove(folder: &Path) {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => return,
        _ => {}
    }
    let _ = fs::remove_file(folder.with_extension(LOCK)); // whoever else removed it did the same
    if let Some(all) = folder.parent() {
        let _ = fs::remove_dir(all); // only if it was the last
    }
}

/// Returns the parent folder of all private folders of this user.
fn all_folders() -> PathBuf {
    let uid = rustix::process::geteuid().as_raw();
    std::env::temp_dir().join(format!("hil-{uid}"))
}

/// Opens a file for reading without blocking: a named pipe may have no writer.
pub(crate) fn open_at_once(path: &Path) -> io::Result<File> {
    let flags = OFlags::NONBLOCK.bits().cast_signed();
    File::options().read(true).custom_flags(flags).open(path)
}

/// Creates a file that is closed to other users, or truncates an existing one, without blocking.
pub(crate) fn private_file(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.write(true).create(true).truncate(true).mode(0o600);
    options.custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    options.open(path)
}

/// Creates the parent folder of all private folders unless it exists. Returns `false` if another process removed the
/// parent at the same moment, after removing the last private folder.
fn make_private(path: &Path) -> io::Result<bool> {
    match DirBuilder::new().mode(0o700).create(path) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    match fs::symlink_metadata(path) {
        Ok(metadata) if is_private(&metadata) => Ok(true),
        Ok(_) => Err(io::Error::other(format!(
            "{} is not your private folder; remove it or have it removed",
            path.display()
        ))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Returns `true` for a folder of this user that is closed to others; `false` for a link to such a folder.
fn is_private(metadata: &fs::Metadata) -> bool {
    let uid = rustix::process::geteuid().as_raw();
    metadata.is_dir() && metadata.uid() == uid && metadata.mode() & 0o077 == 0
}

/// Returns `true` if an open file is still the file at its path.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(there)) => (open.dev(), open.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt;

    use tempfile::tempdir;

    use super::*;

    #[test]
    fn a_private_folder_is_removed_with_its_owner() {
        let place = tempdir().expect("a folder");
        let all = place.path().join("all");
        let one = PrivateFolder::create_in(&all, "one").expect("made");
        let other = PrivateFolder::create_in(&all, "one").expect("made");
        assert_ne!(one.folder(), other.folder());
        for path in [one.folder(), &all] {
            let mode = fs::metadata(path).expect("the folder's metadata").mode();
            assert_eq!(mode & 0o777, 0o700, "{}", path.display());
        }
        fs::create_dir(one.folder().join("deep")).expect("made");
        fs::write(one.folder().join("deep/file"), "x").expect("written");
        sweep_in(&all);
        assert!(one.folder().join("deep/file").is_file(), "its owner lives");
        drop(one);
        assert_eq!(fs::read_dir(&all).expect("there").count(), 2);
        drop(other);
        assert!(!all.exists());
    }

    #[test]
    fn simultaneous_starts_and_ends_never_fail() {
        let place = tempdir().expect("a folder");
        let all = place.path().join("all");
        std::thread::scope(|scope| {
            for number in 0..8 {
                let all = &all;
                // A name for each thread, as each process has its own.
                let name = format!("t{number}");
                scope.spawn(move || {
                    for _ in 0..500 {
                        sweep_in(all);
                        drop(PrivateFolder::create_in(all, &name).expect("made"));
                    }
                });
            }
        });
        assert!(!all.exists());
    }

    #[test]
    fn a_folder_of_a_dead_owner_is_swept_away() {
        let place = tempdir().expect("a folder");
        let all = place.path().join("all");
        let dead = PrivateFolder::create_in(&all, "one").expect("made");
        let folder = dead.folder().to_owned();
        fs::write(folder.join("file"), "x").expect("written");
        // As after kill -9: nothing is removed, the lock is free.
        let PrivateFolder { folder: _, _lock } = &dead;
        flock(_lock, FlockOperation::Unlock).expect("held");
        std::mem::forget(dead);
        sweep_in(&all);
        assert!(!folder.exists() && !all.exists());
    }

    #[test]
    fn a_folder_that_is_open_to_others_is_neither_used_nor_cleared() {
        let place = tempdir().expect("a folder");
        let all = place.path().join("all");
        fs::create_dir(&all).expect("made");
        // Independent of the umask.
        fs::set_permissions(&all, Permissions::from_mode(0o755)).expect("its own");
        let error = PrivateFolder::create_in(&all, "one").expect_err("open");
        assert!(error.to_string().contains("not your private folder"));
        fs::write(all.join("one-1-0.lock"), "").expect("written");
        sweep_in(&all);
        assert!(all.join("one-1-0.lock").exists());
    }
}
