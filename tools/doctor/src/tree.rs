//! Files that the checks read: `/proc`, `/sys` and a few more, below one root.
//!
//! The checks use a [`Tree`], so that tests can supply the files of any machine. Nothing is ever written.

use std::io;
use std::path::{Path, PathBuf};

/// Text files of a machine. Paths have no leading slash: `proc/version`.
pub trait Tree {
    /// Reads a whole file, without surrounding white space.
    ///
    /// # Errors
    /// If the file cannot be read; the error states the file and the reason.
    fn read(&self, path: &str) -> Result<String, Unread>;

    /// Lists the names in a folder, sorted; empty if the folder does not exist.
    fn names(&self, folder: &str) -> Vec<String>;

    /// Returns `true` if the file or folder exists.
    fn has(&self, path: &str) -> bool;
}

/// Error of reading a file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("/{path} cannot be read: {reason}")]
pub struct Unread {
    /// Path of the file.
    pub path: String,
    /// Reason why the file cannot be read.
    pub reason: String,
}

/// Files of this machine, or a copy of another machine's files below a folder.
#[derive(Clone, Debug)]
pub struct Root(PathBuf);

impl Root {
    /// Creates the tree of the files below a folder.
    pub(crate) fn new(folder: &Path) -> Self {
        Self(folder.to_owned())
    }

    /// Creates the tree of this machine.
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
                io::ErrorKind::NotFound => "it does not exist".into(),
                io::ErrorKind::PermissionDenied => "permission denied".into(),
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

/// Paths and texts of files.
#[cfg(test)]
pub(crate) type Files<'a> = &'a [(&'a str, &'a str)];

/// Files in memory, for tests.
#[cfg(test)]
#[derive(Clone, Debug, Default)]
pub(crate) struct Fake(std::collections::BTreeMap<String, String>);

#[cfg(test)]
impl Fake {
    /// Creates a machine with only these files.
    pub(crate) fn new<P: AsRef<str>, T: AsRef<str>>(files: &[(P, T)]) -> Self {
        Self::default().with(files)
    }

    /// Adds or replaces files.
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
            reason: "it does not exist".into(),
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
    fn a_missing_file_is_reported_with_its_path() {
        let error = Root::machine()
            .read("proc/no-such-file")
            .expect_err("missing");
        assert_eq!(
            error.to_string(),
            "/proc/no-such-file cannot be read: it does not exist"
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
