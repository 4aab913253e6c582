//! Files that the checks read: `/proc`, `/sys` and a few more, below one root.
//!
//! The checks take a [`Tree`], so that tests give them the files of any machine. Nothing is written.

use std::io;
use std::path::{Path, PathBuf};

/// The text files of a machine. Paths begin without a slash: `proc/version`.
pub trait Tree {
    /// The whole of a file, without white space around it.
    ///
    /// # Errors
    /// If the file cannot be read; the error names it and the reason.
    fn read(&self, path: &str) -> Result<String, Unread>;

    /// The names in a folder, sorted; none if it is not there.
    fn names(&self, folder: &str) -> Vec<String>;

    /// Reports a file or folder that exists.
    fn has(&self, path: &str) -> bool;
}

/// A file that could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("/{path} cannot be read: {reason}")]
pub struct Unread {
    /// Path of the file.
    pub path: String,
    /// Reason for which the file cannot be read.
    pub reason: String,
}

/// The files of this machine, or a copy of another's below a folder.
#[derive(Clone, Debug)]
pub struct Root(PathBuf);

impl Root {
    /// The files below a folder.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self(folder.to_owned())
    }

    /// The files of this machine.
    #[must_use]
    pub fn machine() -> Self {
        Self::new(Path::new("/"))
    }
}

impl Tree for Root {
    fn read(&self, path: &str) -> Result<String, Unread> {
        let unread = |error: io::Error| Unread {
            path: path.into(),
            reason: match error.kind() {
                io::ErrorKind::NotFound => "it is not there".into(),
                io::ErrorKind::PermissionDenied => "not allowed".into(),
                _ => error.to_string(),
            },
        };
        let bytes = std::fs::read(self.0.join(path)).map_err(unread)?;
        Ok(String::from_utf8_lossy(&bytes).trim().to_owned())
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.join(folder));
        let mut names: Vec<String> = (entries.into_iter().flatten().flatten())
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    fn has(&self, path: &str) -> bool {
        self.0.join(path).exists()
    }
}

/// Paths and texts of some files.
#[cfg(test)]
pub(crate) type Files<'a> = &'a [(&'a str, &'a str)];

/// Files in memory, for tests.
#[cfg(test)]
#[derive(Clone, Debug, Default)]
pub(crate) struct Fake(std::collections::BTreeMap<String, String>);

#[cfg(test)]
impl Fake {
    /// A machine with these files and no others.
    pub(crate) fn new<P: AsRef<str>, T: AsRef<str>>(files: &[(P, T)]) -> Self {
        Self::default().with(files)
    }

    /// The same machine with these files besides, or changed.
    pub(crate) fn with<P: AsRef<str>, T: AsRef<str>>(mut self, files: &[(P, T)]) -> Self {
        for (path, text) in files {
            self.0.insert(path.as_ref().into(), text.as_ref().into());
        }
        self
    }
}

#[cfg(test)]
impl Tree for Fake {
    fn read(&self, path: &str) -> Result<String, Unread> {
        let text = self.0.get(path).map(|text| text.trim().to_owned());
        text.ok_or_else(|| Unread {
            path: path.into(),
            reason: "it is not there".into(),
        })
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let inside = |path: &String| {
            let rest = path.strip_prefix(folder)?.strip_prefix('/')?;
            Some(rest.split('/').next()?.to_owned())
        };
        let mut names: Vec<String> = self.0.keys().filter_map(inside).collect();
        names.sort();
        names.dedup();
        names
    }

    fn has(&self, path: &str) -> bool {
        self.0.contains_key(path) || !self.names(path).is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_is_told_with_its_path() {
        let error = Root::machine()
            .read("proc/no-such-file")
            .expect_err("missing");
        assert_eq!(
            error.to_string(),
            "/proc/no-such-file cannot be read: it is not there"
        );
    }

    #[test]
    fn this_machine_has_a_kernel_and_cores() {
        let machine = Root::machine();
        assert!(machine.read("proc/version").expect("there").contains(' '));
        assert!(machine.has("proc/self"));
        assert!(machine.names("proc/self").contains(&"stat".to_owned()));
        assert!(machine.names("proc/no-such-folder").is_empty());
    }

    #[test]
    fn a_fake_has_folders_like_a_machine() {
        let fake = Fake::new(&[("a/b/c", "1\n"), ("a/b/d/e", "2"), ("a/bb", "3")]);
        assert_eq!(fake.read("a/b/c").as_deref(), Ok("1"));
        assert_eq!(fake.names("a/b"), ["c", "d"]);
        assert!(fake.has("a/b/d") && !fake.has("a/c"));
    }
}
