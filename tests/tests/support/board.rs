//! Board for the controller: a target reached by `ssh`, simulated on this machine.
//!
//! The `ssh` of a [`Board`] is a script that runs the remote command here, with a home of its own. Everything
//! except the network and its keys is real.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::harness::Rig;
use crate::support::programs::{path_from, program, workspace};

/// Board in a test's folder.
pub(crate) struct Board {
    home: PathBuf,
    bin: PathBuf,
}

impl Board {
    /// Creates a board that is reached without trouble.
    pub(crate) fn new(rig: &Rig) -> Self {
        Self::reached_by(rig, "export SSH_CONNECTION='127.0.0.1 1 127.0.0.1 2'")
    }

    /// Creates a board whose `ssh` runs these commands before the remote command, with the host's name in `$host`.
    pub(crate) fn reached_by(rig: &Rig, first: &str) -> Self {
        let (home, bin) = (rig.path("home"), rig.path("bin"));
        for folder in [&home, &bin] {
            std::fs::create_dir_all(folder).expect("a folder");
        }
        let path_text = home.display();
        rig.script(
            "bin/ssh",
            &format!(
                "#!/bin/sh\n\
                 while [ \"$1\" != -- ]; do shift; done\n\
                 host=$2; command=$3\n\
                 export HOME={path_text}\nunset XDG_CACHE_HOME\n\
                 {first}\n\
                 exec /bin/sh -c \"$command\"\n"
            ),
        );
        Self { home, bin }
    }

    /// Returns a `hil` that uses this board's `ssh`.
    pub(crate) fn hil(&self) -> Command {
        let mut hil = Command::new(program("hil"));
        hil.env("PATH", path_from(&self.bin))
            .current_dir(workspace());
        hil
    }

    /// Returns the folder of cached programs on the board.
    pub(crate) fn cache(&self) -> PathBuf {
        self.home.join(".cache/hil-target")
    }

    /// Returns the IDs of processes that run a cached program with this first argument.
    pub(crate) fn processes(&self, argument: &str) -> Vec<u32> {
        let own = self.cache();
        let own = own.to_str().expect("plain text");
        let processes = std::fs::read_dir("/proc")
            .expect("/proc is there")
            .flatten();
        let pids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
        let runs = |pid: &u32| {
            let line = std::fs::read(Path::new("/proc").join(pid.to_string()).join("cmdline"));
            let line = line.unwrap_or_default();
            let mut words = line.split(|byte| *byte == 0).map(String::from_utf8_lossy);
            words.next().is_some_and(|program| program.starts_with(own))
                && words.next().is_some_and(|first| first == argument)
        };
        pids.filter(runs).collect()
    }
}
