//! The file of a program or a model: whether it can be run, its hash, and its identity while it is used.

use std::fs;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use hil_console::terminal::exit::Failure;
use hil_session::file::hash;
use rustix::fs::{Access, access};

/// Returns the path of a program beside this one.
///
/// # Errors
/// If the path of this program cannot be found.
pub fn beside(name: &str) -> Result<PathBuf, Failure> {
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    Ok(own.with_file_name(name))
}

/// Values that change with every change of a file and of its place: device, inode, size, and the times at
/// which its content and its inode were changed, in s and ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FileIdentity([i128; 7]);

impl FileIdentity {
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        let found = fs::metadata(path)?;
        Ok(Self([
            found.dev().into(),
            found.ino().into(),
            found.size().into(),
            found.mtime().into(),
            found.mtime_nsec().into(),
            found.ctime().into(),
            found.ctime_nsec().into(),
        ]))
    }

    /// Returns `true` if another file is at the path now, or if there is none.
    pub(super) fn is_changed(&self, path: &Path) -> bool {
        !Self::of(path).is_ok_and(|now| now == *self)
    }
}

/// Returns `true` if an interpreter runs a file.
pub(super) fn is_script(path: &Path) -> bool {
    let mut begins = [0; 2];
    let read = fs::File::open(path).and_then(|mut file| file.read_exact(&mut begins));
    read.is_ok() && begins == *b"#!"
}

/// Returns the reason for which a path can be no program; the system has one word for all such reasons.
fn unfit(path: &Path) -> Option<String> {
    let found = fs::metadata(path).ok()?;
    if found.is_dir() {
        return Some("it is a folder; name the program in it".into());
    }
    if !found.is_file() {
        return Some("it is no file that a program could be in".into());
    }
    (found.mode() & 0o111 == 0).then(|| {
        format!(
            "it is not executable; if it is a program, `chmod +x {}`",
            path.display()
        )
    })
}

/// A program's identity and hash. What cannot be executed is not read: it may have no end.
pub(super) fn hashed(path: &Path) -> io::Result<(FileIdentity, String)> {
    if let Some(what) = unfit(path) {
        return Err(io::Error::other(what));
    }
    access(path, Access::EXEC_OK)?;
    let file = FileIdentity::of(path)?;
    Ok((file, hash(path)?))
}

/// A model's identity and hash: a file that a program reads.
pub(super) fn hashed_model(path: &Path) -> io::Result<(FileIdentity, String)> {
    let file = FileIdentity::of(path)?;
    Ok((file, hash(path)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_no_program_is_told_by_what_it_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("text");
        std::fs::write(&file, "schema = 1").expect("written");
        let told = |path: &Path| unfit(path).unwrap_or_default();
        assert!(told(folder.path()).contains("it is a folder"));
        assert!(told(&file).contains("not executable"), "{}", told(&file));
        assert!(told(Path::new("/dev/null")).contains("no file"));
        assert_eq!(unfit(Path::new("/nowhere")), None);
        assert_eq!(unfit(&std::env::current_exe().expect("this")), None);
    }
}
