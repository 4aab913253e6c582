//! Files in shared memory that belong to no session of this user any more.

use std::ffi::OsStr;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Lists files of this user in shared memory that look like a session's, but whose session is gone.
pub(crate) fn segments_of_nobody() -> Vec<PathBuf> {
    let uid = rustix::process::geteuid().as_raw();
    // In this order: a session removes its folder last.
    let files: Vec<PathBuf> = (std::fs::read_dir("/dev/shm")
        .expect("shared memory")
        .flatten())
    .filter(|entry| entry.metadata().is_ok_and(|file| file.uid() == uid))
    .map(|entry| entry.path())
    .filter(|path| name(path).starts_with("hil_"))
    .collect();
    // Sessions of the user, and of each test.
    let groups = (std::fs::read_dir("/dev/shm")
        .expect("shared memory")
        .flatten())
    .map(|entry| entry.path())
    .filter(|path| name(path).starts_with(&format!("hil-{uid}")));
    let sessions = groups.filter_map(|group| std::fs::read_dir(group).ok());
    // From the lock file, which contains the prefix too: a test may have damaged the other file.
    let prefixes: Vec<String> = (sessions.flatten().flatten())
        .filter_map(|session| std::fs::read_to_string(session.path().join("lock")).ok())
        .filter_map(|lock| Some(lock.split_once(' ')?.0.to_owned()))
        .collect();
    let claimed = |file: &Path| prefixes.iter().any(|prefix| name(file).starts_with(prefix));
    (files.into_iter())
        .filter(|file| !claimed(file) && file.exists())
        .collect()
}

fn name(path: &Path) -> &str {
    path.file_name().and_then(OsStr::to_str).unwrap_or_default()
}

/// Returns the files left on this machine before any test began.
pub(crate) fn left_before() -> &'static [PathBuf] {
    static BEFORE: OnceLock<Vec<PathBuf>> = OnceLock::new();
    BEFORE.get_or_init(segments_of_nobody)
}
