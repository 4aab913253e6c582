//! A controller that is built for another processor, and the desk's build of the same program.

use std::fmt;
use std::path::{Path, PathBuf};

use hil_console::terminal::interruption::Interruption;
use hil_target::machine::built_for;
use shared_types::origin::Build;

use super::Binary;
use super::named::Choice;

/// Controller built for another processor, compared with the desk's build.
#[derive(Clone, Debug)]
pub struct BesideDesk {
    desk: PathBuf,
    /// Source revisions of the builds on the target and at the desk, as far as recorded.
    builds: [Option<Build>; 2],
}

impl BesideDesk {
    /// Compares a controller on a target with the one that would run at the desk; `None` if that is the same file or
    /// another program.
    pub(crate) fn of(there: &Binary, desk: &Choice, interruption: &Interruption) -> Option<Self> {
        let machine = |path: &Path| built_for(path).ok().flatten();
        if machine(&there.path)? == machine(&desk.path)? {
            return None;
        }
        let desk = Binary::of_controller(desk, None, interruption).ok()?;
        let is_same = desk.description.program == there.description.program;
        is_same.then(|| Self {
            builds: [&there.description, &desk.description].map(|one| one.build.clone()),
            desk: desk.path,
        })
    }

    /// Returns `true` if both builds are known to have the same source; `None` if that cannot be determined.
    pub(crate) fn is_same_source(&self) -> Option<bool> {
        match &self.builds {
            [Some(there), Some(desk)] if there.is_of_source_of(desk) => Some(true),
            // Both have uncommitted changes, which may differ.
            [Some(there), Some(desk)] if there == desk => None,
            [Some(_), Some(_)] => Some(false),
            _ => None,
        }
    }
}

impl fmt::Display for BesideDesk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let describe = |build: &Option<Build>| match build {
            Some(build) => build.to_string(),
            None => "a build without a recorded source".into(),
        };
        let [there, desk] = self.builds.each_ref().map(describe);
        let path = self.desk.display();
        match self.is_same_source() {
            Some(true) => write!(f, "built from the source of {path}: {there}"),
            Some(false) => write!(
                f,
                "note: built from another source than {path}: {there}; at the desk {desk}"
            ),
            None => write!(
                f,
                "note: cannot verify that it is built from the source of {path}: {there}; at the desk {desk}"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beside(commits: [Option<&str>; 2], modified: bool) -> BesideDesk {
        let build = |commit: Option<&str>| {
            commit.map(|commit| Build {
                commit: Some(commit.into()),
                modified,
                lock_blake3: Some("00".into()),
            })
        };
        BesideDesk {
            desk: "desk".into(),
            builds: commits.map(build),
        }
    }

    #[test]
    fn builds_count_as_the_same_source_only_if_that_is_known() {
        #[rustfmt::skip] // a table
        let cases = [
            ([Some("a"), Some("a")], false, Some(true), "built from the source of desk: commit a"),
            ([Some("a"), Some("b")], false, Some(false), "from another source than desk: commit a"),
            ([Some("a"), Some("b")], true, Some(false), "commit b with changes"),
            ([Some("a"), Some("a")], true, None, "cannot verify"),
            ([None, Some("a")], false, None, "a build without a recorded source"),
        ];
        for (commits, modified, same, expected) in cases {
            let beside = beside(commits, modified);
            assert_eq!(beside.is_same_source(), same, "{beside}");
            assert!(beside.to_string().contains(expected), "{beside}");
        }
    }
}
