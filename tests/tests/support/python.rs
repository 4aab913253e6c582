//! Python interpreter for tests that check results with an independent implementation.

use std::path::PathBuf;
use std::process::{Command, Output};

use crate::support::programs::{demanded, target, workspace};

/// Returns a Python with these modules: the machine's, or if demanded one made for it.
pub(crate) fn python(modules: &str) -> Option<PathBuf> {
    // Located without importing, which takes a second for some.
    let look = "import sys, importlib.util as u; sys.exit(None in map(u.find_spec, sys.argv[1:]))";
    let has_modules = |python: &PathBuf| {
        let mut looked_up = Command::new(python);
        looked_up.args(["-c", look]).args(modules.split(", "));
        let output = looked_up.output();
        output.is_ok_and(|output| output.status.success())
    };
    let own = PathBuf::from("python3");
    let environment = target().join("python");
    let made = environment.join("bin/python");
    if let Some(python) = [own, made.clone()].into_iter().find(has_modules) {
        return Some(python);
    }
    if !demanded("HIL_TEST_PYTHON") {
        return None;
    }
    let mut venv = Command::new("python3");
    succeeds(venv.args(["-m", "venv"]).arg(&environment));
    let requirements = workspace().join("tests/python/requirements.txt");
    let mut pip = Command::new(&made);
    succeeds(pip.args(["-m", "pip", "install", "-r"]).arg(requirements));
    Some(made)
}

/// Runs a command that must succeed; returns its output.
pub(crate) fn succeeds(command: &mut Command) -> String {
    let output = command.output();
    let Output {
        status,
        stdout,
        stderr,
    } = output.unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let text = String::from_utf8_lossy(&stderr);
    assert!(status.success(), "{command:?}:\n{text}");
    String::from_utf8_lossy(&stdout).into_owned()
}
