//! Destination of a table or a page: an atomically written file, a device, or standard output.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};

use crate::files::part_file::PartFile;
use crate::terminal::exit::Failure;

/// Output of a command.
pub struct Destination {
    file: BufWriter<File>,
    /// `None` if the output is unbuffered and final, as for a pipe.
    whole: Option<Whole>,
}

/// File that does not exist yet.
struct Whole {
    part: PartFile,
    path: PathBuf,
    may_replace: bool,
}

impl Destination {
    /// Opens the destination: a file under a temporary name until it is complete, or standard output without a path.
    pub fn open(path: Option<&Path>, may_replace: bool) -> Result<Self, Failure> {
        let at_once = |file| Self {
            file: BufWriter::new(file),
            whole: None,
        };
        let Some(path) = path else {
            // `Stdout` would search all output for line ends.
            let descriptor = io::stdout().as_fd().try_clone_to_owned();
            let descriptor = descriptor.map_err(Failure::infrastructure)?;
            return Ok(at_once(descriptor.into()));
        };
        let path_text = path.display();
        let cannot =
            |error: io::Error| Failure::usage(format!("cannot write {path_text}: {error}"));
        let mut path = path.to_owned();
        match fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(cannot(error)),
            Ok(metadata) if metadata.is_dir() => {
                return Err(Failure::usage(format!(
                    "{path_text} is a folder; name a file in it"
                )));
            }
            Ok(metadata) if !metadata.is_file() => {
                // A device or pipe is written directly instead of being replaced by a file.
                let file = File::options().write(true).open(&path);
                return file.map(at_once).map_err(cannot);
            }
            Ok(_) if !may_replace => return Err(Failure::usage(already_exists(&path))),
            // Resolves links, so that the target is replaced and not the link.
            Ok(_) => path = path.canonicalize().map_err(cannot)?,
        }
        let part = PartFile::beside(&path).map_err(cannot)?;
        let file = part.file().try_clone().map_err(cannot)?;
        let whole = Whole {
            part,
            path,
            may_replace,
        };
        Ok(Self {
            file: BufWriter::new(file),
            whole: Some(whole),
        })
    }

    /// Completes the output: a file gets its final name.
    pub fn complete(mut self) -> io::Result<()> {
        self.file.flush()?;
        let Some(whole) = self.whole else {
            return Ok(());
        };
        let Whole {
            part,
            path,
            may_replace,
        } = whole;
        (part.complete(&path, may_replace)).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => io::Error::new(error.kind(), already_exists(&path)),
            _ => error,
        })
    }
}

fn already_exists(path: &Path) -> String {
    format!("{} already exists; --force overwrites it", path.display())
}

impl Write for Destination {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Writes a whole text; a closed pipe on standard output counts as success.
///
/// # Errors
/// If the output cannot be written.
pub fn deliver(
    text: &str,
    mut destination: Destination,
    path: Option<&Path>,
) -> Result<(), Failure> {
    let written = (destination.write_all(text.as_bytes())).and_then(|()| destination.complete());
    written.or_else(|error| match error.kind() {
        ErrorKind::BrokenPipe if path.is_none() => Ok(()),
        _ => Err(not_written(path, &error)),
    })
}

/// Returns the failure for an output that could not be completed.
pub fn not_written(path: Option<&Path>, error: &io::Error) -> Failure {
    match error.kind() {
        ErrorKind::AlreadyExists => Failure::usage(error),
        _ => cannot_write(path, error),
    }
}

fn cannot_write(path: Option<&Path>, error: &io::Error) -> Failure {
    let what = path.map_or_else(
        || "the output".to_owned(),
        |path| path.display().to_string(),
    );
    let hint = match (error.kind(), path) {
        (ErrorKind::StorageFull, Some(path)) if !path.exists() => "; no part of it is left behind",
        _ => "",
    };
    Failure::infrastructure(format!("cannot write {what}: {error}{hint}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(destination: Result<Destination, Failure>) -> String {
        destination.err().expect("refused").to_string()
    }

    #[test]
    fn a_file_appears_only_once_complete() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table.csv");
        let entries = || fs::read_dir(folder.path()).expect("a folder").count();

        let mut given_up = Destination::open(Some(&path), false).expect("begun");
        given_up.write_all(b"half").expect("written");
        assert!(!path.exists());
        drop(given_up);
        assert_eq!(entries(), 0, "nothing is left");

        let mut whole = Destination::open(Some(&path), false).expect("begun");
        whole.write_all(b"whole").expect("written");
        whole.complete().expect("complete");
        assert_eq!(fs::read(&path).expect("there"), b"whole");
        assert_eq!(entries(), 1);
    }

    #[test]
    fn an_existing_file_is_replaced_only_if_requested() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, link) = (
            folder.path().join("old.csv"),
            folder.path().join("link.csv"),
        );
        let late = Destination::open(Some(&path), false).expect("begun");
        fs::write(&path, "old").expect("written");
        std::os::unix::fs::symlink(&path, &link).expect("linked");
        assert!(refused(Destination::open(Some(&path), false)).contains("--force"));
        // The file was created while the other one was being written.
        let error = late.complete().expect_err("refused");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).expect("there"), b"old");

        let mut forced = Destination::open(Some(&link), true).expect("begun");
        forced.write_all(b"new").expect("written");
        forced.complete().expect("complete");
        assert_eq!(fs::read(&path).expect("there"), b"new");
        assert!(link.is_symlink());
    }

    #[test]
    fn an_impossible_destination_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let nowhere = folder.path().join("nowhere/table.csv");
        assert!(refused(Destination::open(Some(folder.path()), true)).contains("is a folder"));
        assert!(refused(Destination::open(Some(&nowhere), true)).contains("nowhere/table.csv"));
    }
}
