//! A file or folder that appears whole or not at all, and of which nothing is left.
//!
//! Used by every command that writes a result. What is written has a hidden name beside its place and a
//! lock that the kernel drops with the process; when it is complete it gets its own name. What a killed
//! `hil` left has no lock any more, and the next one that comes to that folder removes it: its name, its
//! owner and the free lock prove whose it was. Nothing else is ever removed.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, OFlags, flock};
use tempfile::{Builder, TempDir, TempPath};

/// First part of the names of unfinished files.
const PREFIX: &str = ".hil-part-";

/// A file that is not there yet. Dropped before it is complete, nothing of it is left.
pub struct PartFile {
    file: File,
    temporary: TempPath,
}

impl PartFile {
    /// Begins a file beside the place that it is for.
    ///
    /// # Errors
    /// If no file can be made there.
    pub fn beside(path: &Path) -> io::Result<Self> {
        let folder = folder_of(path);
        sweep(folder);
        loop {
            let (file, temporary) = Builder::new()
                .prefix(PREFIX)
                // Less what the process's mask takes away, as of any new file.
                .permissions(Permissions::from_mode(0o666))
                .tempfile_in(folder)
                .map_err(without_its_name)?
                .into_parts();
            if is_locked(&file)? {
                return Ok(Self { file, temporary });
            }
        }
    }

    /// Returns the file that is written to.
    #[must_use]
    pub const fn file(&self) -> &File {
        &self.file
    }

    /// Gives the file, of which all is written, its name, in place of another if that may be.
    ///
    /// # Errors
    /// If a full disk says so only now, or there is a file that may not be replaced.
    pub fn complete(self, path: &Path, may_replace: bool) -> io::Result<()> {
        self.file.sync_all()?;
        let named = if may_replace {
            self.temporary.persist(path)
        } else {
            self.temporary.persist_noclobber(path)
        };
        named.map_err(|error| error.error)
    }
}

/// Removes the hidden name, which nobody chose, from an error of the system.
fn without_its_name(error: io::Error) -> io::Error {
    let text = error.to_string();
    let said = text.split(" at path ").next().unwrap_or_default();
    io::Error::new(error.kind(), said)
}

/// A folder that is not there yet.
pub struct PartFolder {
    folder: TempDir,
    _lock: File,
}

impl PartFolder {
    /// Begins a folder beside the place that it is for.
    ///
    /// # Errors
    /// If no folder can be made there.
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

    /// Returns the folder that is written to.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Gives the folder, of which all is written, its name.
    ///
    /// # Errors
    /// If there is one with something in it.
    pub fn complete(self, path: &Path) -> io::Result<()> {
        fs::rename(self.folder.path(), path)?;
        // Nothing has its old name any more.
        let _: PathBuf = self.folder.keep();
        Ok(())
    }
}

/// Writes a small file, whole or not at all. A device or a pipe takes it as it is.
///
/// # Errors
/// If it cannot be written.
pub fn write(path: &Path, text: &[u8]) -> io::Result<()> {
    let path = match fs::metadata(path) {
        Ok(found) if !found.is_file() => return fs::write(path, text),
        // What a link leads to, not the link.
        Ok(_) => path.canonicalize()?,
        Err(_) => path.to_owned(),
    };
    let part = PartFile::beside(&path)?;
    part.file().write_all(text)?;
    part.complete(&path, true)
}

/// Removes from a folder the files that killed commands have left. A file that cannot be seen or
/// removed stays.
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
    let found = file.metadata()?;
    if found.uid() != rustix::process::geteuid().as_raw() {
        return Ok(());
    }
    flock(&file, FlockOperation::NonBlockingLockExclusive)?;
    if found.is_dir() {
        fs::remove_dir_all(path)
    } else if found.is_file() {
        fs::remove_file(path)
    } else {
        Ok(())
    }
}

/// Locks what was just made; false if a sweep was quicker and has removed it.
fn is_locked(file: &File) -> io::Result<bool> {
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file.metadata()?.nlink() > 0),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(false),
        // A file system without locks: nobody's sweep gets one either, and it stays.
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

    /// A file or folder that a killed command has left: with the name, without the lock.
    fn left(part: PathBuf, folder: &Path) -> PathBuf {
        let left = folder.join(format!("{PREFIX}left-{}", part.is_dir()));
        fs::rename(part, &left).expect("renamed");
        left
    }

    #[test]
    fn a_file_or_folder_appears_only_when_it_is_complete() {
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
    fn what_a_killed_command_left_is_removed_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("result");
        let live = PartFile::beside(&path).expect("begun");
        let live_folder = PartFolder::beside(&path).expect("begun");
        // Of a process that was killed the kernel drops the locks.
        for is_folder in [false, true] {
            let dead = folder.path().join("dead");
            if is_folder {
                fs::create_dir(&dead).expect("made");
                fs::write(dead.join("inner"), "x").expect("written");
            } else {
                fs::write(&dead, "x").expect("written");
            }
            assert!(left(dead, folder.path()).exists());
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
        let found = names(folder.path()).into_iter();
        let found: Vec<PathBuf> = found.map(|name| folder.path().join(name)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_file_that_came_meanwhile_is_not_replaced_unless_that_is_meant() {
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
    fn a_link_and_a_device_stay_what_they_are() {
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
