//! The Python package: its wheel, as somebody without a compiler installs it, and its types.
//!
//! `tests/python` has the tests of its functions.

use std::os::unix::fs::symlink;
use std::process::Command;

use crate::support::harness::Rig;
use crate::support::programs::{demanded, path_from, program, shipped, skip, target, workspace};
use crate::support::python::{python, succeeds};

/// Limit of the wheel's size in bytes.
const WHEEL_LIMIT_BYTES: u64 = 31_500_000;

/// Prints where the program is, and the digest of the README's first scenario.
const README_SCENARIO: &str = r#"
import hil
from hil.programs import find

run = hil.run("scenarios/severe-leakage.toml", out="run")
with hil.Session("scenarios/severe-leakage.toml", set={"run.duration_s": 0.1, "faults": [], "metrics": [], "requirements": []}) as session:
    session.step_to()
    assert session.step_index == 1000
print(find(), run.digest, len(run["truth.surface_angle_rad"]), len(run["tracking_error_rad"]))
"#;

#[test]
fn the_wheel_runs_the_scenario_of_the_readme_in_an_empty_environment() {
    if !demanded("HIL_TEST_PYTHON") {
        let why = "this test installs packages from the network";
        return skip(why, "HIL_TEST_PYTHON");
    }
    let rig = Rig::new();
    let readme = shipped("README.md");
    let command = (readme.lines())
        .find_map(|line| line.strip_prefix("$ tools/python/build"))
        .map(|rest| format!("tools/python/build{rest}"))
        .expect("the README has the command that installs the wheel");
    let digest = (readme.lines())
        .find_map(|line| line.trim().strip_prefix("digest "))
        .expect("the README has a digest");

    // A clone in a path with a space, whose programs are those under test.
    let clone = rig.path("a clone");
    std::fs::create_dir_all(clone.join("target")).expect("a folder");
    for name in ["tools", "scenarios", "LICENSE-APACHE", "LICENSE-MIT"] {
        symlink(workspace().join(name), clone.join(name)).expect("a link");
    }
    let programs = program("hil");
    let programs = programs.parent().expect("a folder");
    symlink(programs, clone.join("target/release")).expect("a link");
    let environment = rig.path("environment");
    succeeds(
        rig.command("python3")
            .args(["-m", "venv"])
            .arg(&environment),
    );
    let inside = |name: &str| {
        let mut command = rig.command(name);
        command
            .current_dir(&clone)
            .env("PATH", path_from(&environment.join("bin")))
            .env("PIP_DISABLE_PIP_VERSION_CHECK", "1")
            .env_remove("CARGO_TARGET_DIR")
            .env_remove("HIL_BIN")
            .env_remove("PYTHONPATH");
        command
    };
    // The programs are built already.
    succeeds(inside("bash").env("CARGO", "true").args(["-euc", &command]));

    let wheels = std::fs::read_dir(clone.join("target/wheels")).expect("a folder of wheels");
    let wheels: Vec<_> = wheels.map(|wheel| wheel.expect("a wheel")).collect();
    assert_eq!(wheels.len(), 1, "{wheels:?}");
    let name = wheels[0].file_name();
    let name = name.to_str().expect("text");
    assert!(
        name.starts_with("hil-0.1.0-cp39-abi3-manylinux_2_"),
        "{name}"
    );
    let size = wheels[0].metadata().expect("a file").len();
    assert!(size < WHEEL_LIMIT_BYTES, "{name} has {size} bytes");

    let output = succeeds(inside("python").args(["-c", README_SCENARIO]));
    let words: Vec<&str> = output.trim().rsplitn(4, ' ').collect();
    assert_eq!(words[..3], ["200001", "200001", digest], "{output}");
    assert!(
        words[3].starts_with(environment.to_str().expect("text")),
        "{output}"
    );
    let listing = succeeds(inside("hil").args(["describe", "drhas"]));
    assert!(listing.contains("surface_angle_rad"), "{listing}");
    rig.assert_nothing_left();
}

#[test]
fn the_version_of_the_python_package_is_that_of_the_workspace() {
    let version = |path: &str| {
        let text = shipped(path);
        let line = text.lines().find(|line| line.starts_with("version = "));
        line.expect("a version").to_owned()
    };
    assert_eq!(
        version("tools/python/pyproject.toml"),
        version("Cargo.toml")
    );
}

#[test]
fn the_python_package_passes_mypy() {
    let Some(python) = python("mypy, mcap, numpy, polars") else {
        let why = "python3 with mypy, mcap, numpy and polars is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let mut mypy = Command::new(python);
    mypy.args(["-m", "mypy", "--cache-dir"])
        .arg(target().join("mypy/package"));
    succeeds(mypy.current_dir(workspace().join("tools/python")));
}

#[test]
fn the_python_package_passes_pyright() {
    let pyright = target().join("node/node_modules/pyright/index.js");
    if Command::new("node").arg("--version").output().is_err() || !pyright.exists() {
        let why = "node or pyright of tests/node is not installed; `.ci/run tools` installs it";
        return skip(why, "HIL_TEST_NODE");
    }
    let Some(python) = python("mcap, numpy, pandas, polars, pyarrow") else {
        let why = "python3 with mcap, numpy, pandas, polars and pyarrow is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let mut node = Command::new("node");
    node.arg(pyright).arg("--pythonpath").arg(python);
    succeeds(node.current_dir(workspace().join("tools/python")));
}
