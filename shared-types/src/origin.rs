//! Origin of a program: its version and source, printed by `--describe`.
//!
//! A program whose package has a build script that calls `hil_origin::note` passes [`origin!`](macro@crate::origin) to
//! its `program::run`; any other program passes its version.

use std::borrow::Cow;
use std::fmt;

use serde::{Deserialize, Serialize};

/// Origin of a program, as passed by its `main`.
#[derive(Clone, Debug)]
pub struct Origin {
    /// Version of the program.
    pub version: Cow<'static, str>,
    /// Source of the program, if its build recorded it.
    pub source: Option<Source>,
}

/// Source of a program, as recorded by its build script.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    /// Commits of the repositories, the program's own first and joined by `+`; `None` if the build found none.
    pub commit: Option<&'static str>,
    /// `true` if sources of the program differed from the commit, or were untracked.
    pub modified: bool,
    /// Content of the lock file.
    pub lock: Option<&'static [u8]>,
}

impl From<&'static str> for Origin {
    fn from(version: &'static str) -> Self {
        Self {
            version: version.into(),
            source: None,
        }
    }
}

impl From<String> for Origin {
    fn from(version: String) -> Self {
        Self {
            version: version.into(),
            source: None,
        }
    }
}

/// Source of a program, as in its description.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Build {
    /// Commits of the repositories of its sources, the program's own first and joined by `+`; `unknown` stands for a
    /// source without a commit. `None` if the build found no commit.
    pub commit: Option<String>,
    /// `true` if sources of the program differed from the commit.
    pub modified: bool,
    /// BLAKE3 hash of the lock file.
    pub lock_blake3: Option<String>,
}

impl From<Source> for Build {
    fn from(source: Source) -> Self {
        let hash = |lock| blake3::hash(lock).to_hex().to_string();
        Self {
            commit: source.commit.map(Into::into),
            modified: source.modified,
            lock_blake3: source.lock.map(hash),
        }
    }
}

impl Build {
    /// Returns `true` if both programs were built from the same source: known commits without changes, and the same
    /// lock file.
    #[must_use]
    pub fn is_of_source_of(&self, other: &Self) -> bool {
        let is_known = |commit: &String| !commit.split('+').any(|one| one == "unknown");
        self == other
            && !self.modified
            && self.commit.as_ref().is_some_and(is_known)
            && self.lock_blake3.is_some()
    }
}

impl fmt::Display for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.commit {
            Some(commit) => write!(f, "commit {commit}")?,
            None => f.write_str("no known commit")?,
        }
        if self.modified {
            f.write_str(" with changes")?;
        }
        match &self.lock_blake3 {
            Some(hash) => write!(f, ", lock file {hash}"),
            None => f.write_str(", no lock file"),
        }
    }
}

/// Origin of the program of the calling package, as recorded by its build script with `hil_origin::note`.
#[macro_export]
macro_rules! origin {
    () => {
        ::core::include!(::core::concat!(::core::env!("OUT_DIR"), "/origin.rs"))
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_known_and_unchanged_sources_count_as_the_same() {
        let build = |commit: Option<&'static str>, modified, lock| {
            Build::from(Source {
                commit,
                modified,
                lock,
            })
        };
        let one = build(Some("ab+cd"), false, Some(b"lock"));
        assert!(one.is_of_source_of(&one.clone()));
        for other in [
            build(Some("ab+ce"), false, Some(b"lock")),
            build(Some("ab+cd"), false, Some(b"lick")),
            build(Some("ab+cd"), true, Some(b"lock")),
        ] {
            assert!(!one.is_of_source_of(&other), "{other}");
        }
        for unknown in [
            build(None, false, Some(b"lock")),
            build(Some("unknown+cd"), false, Some(b"lock")),
            build(Some("ab"), true, Some(b"lock")),
            build(Some("ab"), false, None),
        ] {
            assert!(!unknown.is_of_source_of(&unknown.clone()), "{unknown}");
        }
        // The published test vector of BLAKE3 for empty input.
        let empty = build(None, false, Some(b""));
        let hash = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";
        assert_eq!(empty.lock_blake3.as_deref(), Some(hash));
        assert_eq!(
            empty.to_string(),
            format!("no known commit, lock file {hash}")
        );
    }
}
