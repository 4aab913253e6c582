//! The prefix of a session: its record, and the files that carry it.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::{SHARED_MEMORY, SessionError, SessionInfo, unless_gone};
use crate::private_folder::open_at_once;
use crate::process;

/// Lists this user's files in shared memory with a session's prefix.
pub(super) fn segments_of(prefix: &str) -> Vec<PathBuf> {
    let uid = rustix::process::geteuid().as_raw();
    let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    entries
        .filter(|entry| (entry.file_name().to_string_lossy()).starts_with(prefix))
        .map(|entry| entry.path())
        .filter(|path| fs::symlink_metadata(path).is_ok_and(|metadata| metadata.uid() == uid))
        .collect()
}

/// Removes everything with a session's prefix: leftover processes, and segments that they may still have mapped.
pub(super) fn remove_below(prefix: &str) -> Result<(), SessionError> {
    process::end_marked(prefix);
    for segment in segments_of(prefix) {
        unless_gone(fs::remove_file(&segment)).map_err(SessionError::io("remove", &segment))?;
    }
    Ok(())
}

/// Returns `true` if a text is a valid session prefix.
pub(super) fn is_prefix(text: &str) -> bool {
    (text.strip_prefix("hil_"))
        .and_then(|rest| rest.strip_suffix('_'))
        .is_some_and(|number| {
            number.len() == 8 && number.bytes().all(|byte| byte.is_ascii_hexdigit())
        })
}

impl SessionInfo {
    /// Writes the prefix into the session's lock, for a sweep that cannot read `session.json`, together with the file's
    /// inode number, so that a copy elsewhere is not trusted.
    pub(super) fn note_prefix(&self, mut lock: &File) -> io::Result<()> {
        let number = lock.metadata()?.ino();
        io::Write::write_all(&mut lock, format!("{} {number}\n", self.prefix).as_bytes())
    }
}

/// Reads the prefix from the lock of a session's folder.
pub(super) fn noted_prefix(folder: &Path) -> Option<String> {
    let lock = open_at_once(&folder.join("lock")).ok()?;
    let number = lock.metadata().ok()?.ino().to_string();
    let text = io::read_to_string(io::Read::take(lock, 64)).ok()?;
    let (prefix, inode) = text.trim_end().split_once(' ')?;
    (is_prefix(prefix) && inode == number).then(|| prefix.to_owned())
}
