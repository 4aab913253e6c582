//! Private folders for files that a process unpacks, which go with it however it ends.
//!
//! Not in a session's folder: shared memory is often mounted so that no library in it can be loaded, as in most
//! containers. A private folder has mode 0700 and lies among the temporary files, with a lock beside it that the kernel
//! drops with the process. Its owner removes it; a folder whose lock is free is dead, and whoever sweeps next,
//! each `hil` and each process that makes a private folder, removes it.

use std::fs::{self, DirBuilder, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, OFlags, flock};

/// Ending of the lock beside a folder.
const LOCK: &str = "lock";
/// Attempts to make a folder that no sweep takes for dead. Thousands of processes that start and end at once may
/// each spoil one.
const ATTEMPTS: u32 = 4096;

/// A private folder of this process. Dropping it removes it with all that is in it.
#[derive(Debug)]
pub struct PrivateFolder {
    folder: PathBuf,
    // Held, never read: the kernel releases it with the process.
    _lock: File,
}

impl PrivateFolder {
    /// Makes a folder whose name begins so, after sweeping away dead ones.
    ///
    /// # Errors
    /// If the folder of all of them is not this user's alone, or cannot be written.
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
                // The last owner before took the folder of all with it.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                other => other?,
            };
            // A sweep that was faster holds it, or has removed it.
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
            "no place is free in {}",
            all.display()
        )))
    }

    /// The folder.
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

/// Removes the private folders of dead processes. What cannot be removed now the next sweep tries again.
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

/// Removes a private folder, its lock last: as long as that stands, a sweep finds what is left.
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

/// The folder of all private folders of this user.
fn all_folders() -> PathBuf {
    let uid = rustix::process::geteuid().as_raw();
    std::env::temp_dir().join(format!("hil-{uid}"))
}

/// Opens a file to read it, without waiting for anybody: a pipe of that name has no writer.
pub(crate) fn open_at_once(path: &Path) -> io::Result<File> {
    let flags = OFlags::NONBLOCK.bits().cast_signed();
    File::options().read(true).custom_flags(flags).open(path)
}

/// Makes a file that is closed to other users, or empties the one that is there, without waiting either.
pub(crate) fn private_file(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.write(true).create(true).truncate(true).mode(0o600);
    options.custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    options.open(path)
}

/// Makes the folder of all private folders unless it is there. Returns false if another process, which removed the
/// last private folder, removed this one just after it was there.
fn make_private(path: &Path) -> io::Result<bool> {
    match DirBuilder::new().mode(0o700).create(path) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    match fs::symlink_metadata(path) {
        Ok(metadata) if is_private(&metadata) => Ok(true),
        Ok(_) => Err(io::Error::other(format!(
            "{} is not a folder of yours alone; remove it or have it removed",
            path.display()
        ))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Returns true for a folder of this user that is closed to others; a link to one is none.
fn is_private(metadata: &fs::Metadata) -> bool {
    let uid = rustix::process::geteuid().as_raw();
    metadata.is_dir() && metadata.uid() == uid && metadata.mode() & 0o077 == 0
}

/// Checks whether an open file is still the one at its path.
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
    fn a_private_folder_goes_with_its_owner() {
        let place = tempdir().expect("a folder");
        let all = place.path().join("all");
        let one = PrivateFolder::create_in(&all, "one").expect("made");
        let other = PrivateFolder::create_in(&all, "one").expect("made");
        assert_ne!(one.folder(), other.folder());
        for path in [one.folder(), &all] {
            let mode = fs::metadata(path).expect("it is there").mode();
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
    fn processes_that_start_and_end_at_once_never_fail() {
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
        // Whatever the umask.
        fs::set_permissions(&all, Permissions::from_mode(0o755)).expect("its own");
        let refused = PrivateFolder::create_in(&all, "one").expect_err("open");
        assert!(refused.to_string().contains("not a folder of yours alone"));
        fs::write(all.join("one-1-0.lock"), "").expect("written");
        sweep_in(&all);
        assert!(all.join("one-1-0.lock").exists());
    }
}
