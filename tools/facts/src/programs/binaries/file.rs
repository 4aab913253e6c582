//! File of a program or a model: executability, hash, and identity while it is in use.

use std::fs;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use hil_console::terminal::exit::Failure;
use hil_session::file::hash;
use rustix::fs::{Access, access};

/// Returns the path of a program in the folder of this one.
///
/// # Errors
/// If the path of this program cannot be determined.
pub fn beside(name: &str) -> Result<PathBuf, Failure> {
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    Ok(own.with_file_name(name))
}

/// Values that change with every change of a file or its location: device, inode, size, and the modification times of
/// content and inode in s and ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FileIdentity([i128; 7]);

impl FileIdentity {
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path)?;
        Ok(Self([
            metadata.dev().into(),
            metadata.ino().into(),
            metadata.size().into(),
            metadata.mtime().into(),
            metadata.mtime_nsec().into(),
            metadata.ctime().into(),
            metadata.ctime_nsec().into(),
        ]))
    }

    /// Returns `true` if the path now leads to another file or to none.
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

/// Returns the reason why a path cannot be a program, in more detail than the system's error.
fn unfit(path: &Path) -> Option<String> {
    let metadata = fs::metadata(path).ok()?;
    if metadata.is_dir() {
        return Some("it is a folder; name the program in it".into());
    }
    if !metadata.is_file() {
        return Some("it is not a regular file".into());
    }
    (metadata.mode() & 0o111 == 0).then(|| {
        format!(
            "it is not executable; if it is a program, `chmod +x {}`",
            path.display()
        )
    })
}

/// Returns a program's identity and hash. A file that cannot be executed is not read, because it may be endless.
pub(super) fn hashed(path: &Path) -> io::Result<(FileIdentity, String)> {
    if let Some(what) = unfit(path) {
        return Err(io::Error::other(what));
    }
    access(path, Access::EXEC_OK)?;
    let file = FileIdentity::of(path)?;
    Ok((file, hash(path)?))
}

/// Returns the identity and hash of a model: a file that a program reads.
pub(super) fn hashed_model(path: &Path) -> io::Result<(FileIdentity, String)> {
    let file = FileIdentity::of(path)?;
    Ok((file, hash(path)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_cannot_be_a_program_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("text");
        std::fs::write(&file, "schema = 1").expect("written");
        let reason = |path: &Path| unfit(path).unwrap_or_default();
        assert!(reason(folder.path()).contains("it is a folder"));
        assert!(
            reason(&file).contains("not executable"),
            "{}",
            reason(&file)
        );
        assert!(reason(Path::new("/dev/null")).contains("not a regular file"));
        assert_eq!(unfit(Path::new("/nowhere")), None);
        assert_eq!(unfit(&std::env::current_exe().expect("this")), None);
    }
}
