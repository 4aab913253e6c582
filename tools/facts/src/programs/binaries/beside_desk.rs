//! A controller that is built for another processor, and the desk's build of the same program.

use std::fmt;
use std::path::{Path, PathBuf};

use hil_console::terminal::interruption::Interruption;
use hil_target::machine::built_for;
use shared_types::origin::Build;

use super::Binary;
use super::named::Choice;

/// A controller that is built for another processor, beside the desk's build of it.
#[derive(Clone, Debug)]
pub struct BesideDesk {
    desk: PathBuf,
    /// Builds there and at the desk, as far as they noted their sources.
    builds: [Option<Build>; 2],
}

impl BesideDesk {
    /// Compares a controller that runs elsewhere with what would run at the desk; nothing if that is the same file or
    /// another program.
    pub fn of(there: &Binary, desk: &Choice, interruption: &Interruption) -> Option<Self> {
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

    /// True if both are known to be built from the same source; nothing if that cannot be told.
    pub(crate) fn is_same_source(&self) -> Option<bool> {
        match &self.builds {
            [Some(there), Some(desk)] if there.is_of_source_of(desk) => Some(true),
            // Each with changes of its own: nobody knows which.
            [Some(there), Some(desk)] if there == desk => None,
            [Some(_), Some(_)] => Some(false),
            _ => None,
        }
    }
}

impl fmt::Display for BesideDesk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let told = |build: &Option<Build>| match build {
            Some(build) => build.to_string(),
            None => "a build that noted no source".into(),
        };
        let [there, desk] = self.builds.each_ref().map(told);
        let path = self.desk.display();
        match self.is_same_source() {
            Some(true) => write!(f, "built from the source of {path}: {there}"),
            Some(false) => write!(
                f,
                "note: built from another source than {path}: {there}; the desk's {desk}"
            ),
            None => write!(
                f,
                "note: nobody can tell that it is built from the source of {path}: {there}; the desk's {desk}"
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
    fn a_build_for_another_processor_is_called_the_same_source_only_where_that_is_known() {
        for (commits, modified, same, told) in [
            (
                [Some("a"), Some("a")],
                false,
                Some(true),
                "built from the source of desk: commit a",
            ),
            (
                [Some("a"), Some("b")],
                false,
                Some(false),
                "from another source than desk: commit a",
            ),
            (
                [Some("a"), Some("b")],
                true,
                Some(false),
                "commit b with changes",
            ),
            ([Some("a"), Some("a")], true, None, "nobody can tell"),
            (
                [None, Some("a")],
                false,
                None,
                "a build that noted no source",
            ),
        ] {
            let beside = beside(commits, modified);
            assert_eq!(beside.is_same_source(), same, "{beside}");
            assert!(beside.to_string().contains(told), "{beside}");
        }
    }
}
