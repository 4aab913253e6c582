//! The release programs, built if they are not up to date; with `--profile dev`, those of that profile.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

/// The release programs.
pub(crate) struct Programs {
    /// The path of `hil`.
    pub(crate) hil: PathBuf,
}

impl Programs {
    /// Builds the programs that are not up to date.
    pub(crate) fn built() -> Self {
        let own = std::env::current_exe().expect("a path to this program");
        let target = own.ancestors().nth(3);
        let target = target.expect("it lies in target/release/deps");
        let is_release = own.starts_with(target.join("release"));
        let profile = if is_release { "release" } else { "dev" };
        let status = Command::new(env!("CARGO"))
            .args(["build", "--profile", profile, "--target-dir"])
            .arg(target)
            .args(["-p", "hil", "-p", "plant-process"])
            .args(["-p", "controller-process", "-p", "hil-target"])
            .args(["-p", "hil-foreign"])
            .status()
            .expect("cargo");
        assert!(status.success(), "the programs do not build");
        Self {
            hil: target.join(if is_release {
                "release/hil"
            } else {
                "debug/hil"
            }),
        }
    }

    /// Returns the summary of a run with these arguments.
    pub(crate) fn run(&self, arguments: &[&str]) -> Value {
        let folder = TempDir::new().expect("a folder");
        self.run_in(&folder.path().join("run"), arguments)
    }

    /// Returns the summary of a run that leaves its files in a folder.
    pub(crate) fn run_in(&self, folder: &Path, arguments: &[&str]) -> Value {
        let output = self.command(folder, arguments).output().expect("hil");
        let said = String::from_utf8_lossy(&output.stderr);
        // A run that diverged has a summary too.
        serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|_| panic!("hil run {arguments:?}: {said}"))
    }

    /// Command of a run that prints its summary and leaves its files in a folder.
    pub(crate) fn command(&self, folder: &Path, arguments: &[impl AsRef<OsStr>]) -> Command {
        let mut hil = Command::new(&self.hil);
        hil.args(["run", "--json", "--out"]).arg(folder);
        hil.args(arguments);
        hil
    }
}
