//! Packages of npm that tests use, as `tests/node/package-lock.json` pins them.

use std::path::PathBuf;
use std::process::Command;

use super::programs::{demanded, target, workspace};
use super::python::succeeds;

/// Returns the folder with the packages, which are installed if demanded; `None` if this one is missing.
pub(crate) fn node_packages(package: &str) -> Option<PathBuf> {
    let folder = target().join("node");
    let node = Command::new("node").arg("--version").output();
    if node.is_ok() && folder.join("node_modules").join(package).exists() {
        return Some(folder);
    }
    if !demanded("HIL_TEST_NODE") {
        return None;
    }
    std::fs::create_dir_all(&folder).expect("a folder");
    for file in ["package.json", "package-lock.json"] {
        let from = workspace().join("tests/node").join(file);
        std::fs::copy(from, folder.join(file)).expect("copied");
    }
    let mut npm = Command::new("npm");
    succeeds(
        npm.args([
            "ci",
            "--ignore-scripts",
            "--no-audit",
            "--no-fund",
            "--prefix",
        ])
        .arg(&folder),
    );
    Some(folder)
}
