//! Files and folders that appear atomically and leave nothing behind.
//!
//! Used by every command that writes a result. The content is written under a hidden name in the folder of its
//! destination, with a lock that the kernel releases when the process ends; once complete, the file is renamed.
//! Leftovers of a killed `hil` are no longer locked, and the next command that writes to the folder removes them: the
//! name, the owner and the free lock identify them. Nothing else is ever removed.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, OFlags, flock};
use tempfile::{Builder, TempDir, TempPath};

/// Prefix of the names of unfinished files.
const PREFIX: &str = ".hil-part-";

/// Unfinished file, which is removed if the value is dropped before completion.
pub struct PartFile {
    file: File,
    temporary: TempPath,
}

impl PartFile {
    /// Creates an unfinished file in the folder of its destination.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn beside(path: &Path) -> io::Result<Self> {
        let folder = folder_of(path);
        sweep(folder);
        loop {
            let (file, temporary) = Builder::new()
                .prefix(PREFIX)
                // The umask applies, as for any new file.
                .permissions(Permissions::from_mode(0o666))
                .tempfile_in(folder)
                .map_err(without_its_name)?
                .into_parts();
            if is_locked(&file)? {
                return Ok(Self { file, temporary });
            }
        }
    }

    /// Returns the file to write to.
    #[must_use]
    pub const fn file(&self) -> &File {
        &self.file
    }

    /// Renames the finished file to its destination; replaces an existing file only if `may_replace`.
    ///
    /// # Errors
    /// If a write error surfaces only now, or the destination exists and may not be replaced.
    pub fn complete(self, path: &Path, may_replace: bool) -> io::Result<()> {
        self.file.sync_all()?;
        let result = if may_replace {
            self.temporary.persist(path)
        } else {
            self.temporary.persist_noclobber(path)
        };
        result.map_err(|error| error.error)
    }
}

/// Removes the hidden name, which means nothing to the user, from an I/O error.
fn without_its_name(error: io::Error) -> io::Error {
    let text = error.to_string();
    let message = text.split(" at path ").next().unwrap_or_default();
    io::Error::new(error.kind(), message)
}

/// Unfinished folder, which is removed if the value is dropped before completion.
pub struct PartFolder {
    folder: TempDir,
    _lock: File,
}

impl PartFolder {
    /// Creates an unfinished folder next to its destination.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn beside(path: &Path) -> io::Result<Self> {
        let parent = folder_of(path);
        sweep(parent);
        loop {
            let folder = Builder::new()
                .prefix(PREFIX)
                .permissions(Permissions::from_mode(0o777))
                .tempdir_in(parent)
                .map_err(without_its_name)?;
            let lock = File::open(folder.path())?;
            if is_locked(&lock)? {
                return Ok(Self {
                    folder,
                    _lock: lock,
                });
            }
        }
    }

    /// Returns the path of the folder to write to.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Renames the finished folder to its destination.
    ///
    /// # Errors
    /// If a non-empty folder exists at the destination.
    pub fn complete(self, path: &Path) -> io::Result<()> {
        fs::rename(self.folder.path(), path)?;
        // The old name is gone, so there is nothing to clean up.
        let _: PathBuf = self.folder.keep();
        Ok(())
    }
}

/// Writes a small file atomically; a device or pipe is written directly.
///
/// # Errors
/// If the output cannot be written.
pub fn write(path: &Path, text: &[u8]) -> io::Result<()> {
    let path = match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => return fs::write(path, text),
        // Resolves links, so that the target is replaced and not the link.
        Ok(_) => path.canonicalize()?,
        Err(_) => path.to_owned(),
    };
    let part = PartFile::beside(&path)?;
    part.file().write_all(text)?;
    part.complete(&path, true)
}

/// Removes leftovers of killed commands from a folder. Files that cannot be read or removed remain.
pub fn sweep(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        if entry
            .file_name()
            .as_encoded_bytes()
            .starts_with(PREFIX.as_bytes())
        {
            let _ = remove_if_dead(&entry.path()); // it stays for the next
        }
    }
}

fn remove_if_dead(path: &Path) -> io::Result<()> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path)?;
    let metadata = file.metadata()?;
    if metadata.uid() != rustix::process::geteuid().as_raw() {
        return Ok(());
    }
    flock(&file, FlockOperation::NonBlockingLockExclusive)?;
    if metadata.is_dir() {
        fs::remove_dir_all(path)
    } else if metadata.is_file() {
        fs::remove_file(path)
    } else {
        Ok(())
    }
}

/// Locks a new file; returns `false` if a concurrent cleanup has removed it.
fn is_locked(file: &File) -> io::Result<bool> {
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file.metadata()?.nlink() > 0),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(false),
        // On a file system without locks, cleanups cannot lock it either, so the file stays.
        Err(_) => Ok(true),
    }
}

fn folder_of(path: &Path) -> &Path {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("a folder").flatten();
        let mut names: Vec<String> = entries
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    /// Simulates the leftover of a killed command, with its name but without a lock.
    fn leftover(part: PathBuf, folder: &Path) -> PathBuf {
        let path = folder.join(format!("{PREFIX}left-{}", part.is_dir()));
        fs::rename(part, &path).expect("renamed");
        path
    }

    #[test]
    fn a_file_or_folder_appears_only_once_complete() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, inner) = (folder.path().join("a"), folder.path().join("b"));
        drop(PartFile::beside(&file).expect("begun"));
        drop(PartFolder::beside(&inner).expect("begun"));
        assert_eq!(names(folder.path()), [""; 0], "nothing is left");
        let (part, part_folder) = (PartFile::beside(&file), PartFolder::beside(&inner));
        let (part, part_folder) = (part.expect("begun"), part_folder.expect("begun"));
        assert!(!file.exists() && !inner.exists());
        part.complete(&file, false).expect("complete");
        part_folder.complete(&inner).expect("complete");
        assert_eq!(names(folder.path()), ["a", "b"]);
    }

    #[test]
    fn only_leftovers_of_killed_commands_are_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("result");
        let live = PartFile::beside(&path).expect("begun");
        let live_folder = PartFolder::beside(&path).expect("begun");
        // The kernel releases the locks of a killed process.
        for is_folder in [false, true] {
            let dead = folder.path().join("dead");
            if is_folder {
                fs::create_dir(&dead).expect("made");
                fs::write(dead.join("inner"), "x").expect("written");
            } else {
                fs::write(&dead, "x").expect("written");
            }
            assert!(leftover(dead, folder.path()).exists());
        }
        let of_a_user = folder.path().join(".hil-export-notes");
        fs::write(&of_a_user, "mine").expect("written");
        let link = folder.path().join(format!("{PREFIX}link"));
        std::os::unix::fs::symlink(&of_a_user, &link).expect("linked");
        sweep(folder.path());
        let mut expected = vec![
            of_a_user,
            link,
            live.temporary.to_path_buf(),
            live_folder.path().to_owned(),
        ];
        expected.sort();
        let paths = names(folder.path()).into_iter();
        let paths: Vec<PathBuf> = paths.map(|name| folder.path().join(name)).collect();
        assert_eq!(paths, expected);
    }

    #[test]
    fn a_file_created_meanwhile_is_replaced_only_if_requested() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        let part = PartFile::beside(&path).expect("begun");
        fs::write(&path, "theirs").expect("written");
        let error = part.complete(&path, false).expect_err("refused");
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).expect("there"), b"theirs");
        write(&path, b"ours").expect("written");
        assert_eq!(fs::read(&path).expect("there"), b"ours");
    }

    #[test]
    fn links_and_devices_are_not_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, link) = (folder.path().join("a"), folder.path().join("link"));
        fs::write(&path, "old").expect("written");
        std::os::unix::fs::symlink(&path, &link).expect("linked");
        write(&link, b"new").expect("written");
        assert!(link.is_symlink());
        assert_eq!(fs::read(&path).expect("there"), b"new");
        let device = folder.path().join("device");
        std::os::unix::fs::symlink("/dev/null", &device).expect("linked");
        write(&device, b"anything").expect("written");
        assert!(device.is_symlink() && !device.metadata().expect("there").is_file());
        assert!(write(folder.path(), b"a folder").is_err());
    }
}
