//! Structure of the workspace: its packages, its programs, and their permitted dependencies, down to modules.

mod modules;
mod sources;
mod starts;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::support::programs::{shipped, workspace};

/// Packages in order, each with its permitted dependencies for builds and for tests. The controller, which runs on
/// targets, knows neither simulator nor scenario.
const ARROWS: [(&str, &[&str], &[&str]); 24] = [
    ("hil-origin", &[], &[]),
    ("shared-types", &[], &[]),
    ("hil-session", &["shared-types"], &[]),
    ("hil-codec", &["shared-types"], &[]),
    ("hil-config", &["shared-types", "hil-codec"], &[]),
    (
        "plant-process",
        &[
            "shared-types",
            "hil-session",
            "hil-codec",
            "hil-config",
            "hil-origin",
        ],
        &[],
    ),
    (
        "controller-process",
        &["shared-types", "hil-session", "hil-origin"],
        &[],
    ),
    ("hil-recording", &["shared-types"], &[]),
    (
        "hil-foreign",
        &[
            "shared-types",
            "hil-session",
            "plant-process",
            "controller-process",
        ],
        &[],
    ),
    (
        "hil-port",
        &[
            "shared-types",
            "hil-session",
            "hil-codec",
            "hil-config",
            "plant-process",
            "controller-process",
        ],
        &[],
    ),
    ("hil-target", &["shared-types", "hil-session"], &[]),
    (
        "hil-in-process",
        &[
            "shared-types",
            "hil-session",
            "plant-process",
            "controller-process",
        ],
        &[],
    ),
    (
        "hil-console",
        &["shared-types", "hil-session", "hil-config", "hil-recording"],
        &[],
    ),
    (
        "hil-facts",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "plant-process",
            "hil-recording",
            "hil-target",
            "hil-console",
        ],
        &[],
    ),
    (
        "hil-doctor",
        &["shared-types", "hil-session", "hil-console", "hil-facts"],
        &[],
    ),
    (
        "hil-run",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "plant-process",
            "controller-process",
            "hil-recording",
            "hil-target",
            "hil-in-process",
            "hil-console",
            "hil-facts",
            "hil-doctor",
        ],
        &[],
    ),
    (
        "hil-benchmark",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "plant-process",
            "controller-process",
            "hil-recording",
            "hil-console",
            "hil-facts",
            "hil-doctor",
            "hil-run",
        ],
        &[],
    ),
    (
        "hil-verification",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "plant-process",
            "controller-process",
            "hil-recording",
            "hil-target",
            "hil-console",
            "hil-facts",
            "hil-run",
        ],
        &[],
    ),
    (
        "hil-operating-point",
        &[
            "shared-types",
            "hil-config",
            "plant-process",
            "controller-process",
            "hil-recording",
            "hil-console",
            "hil-facts",
            "hil-run",
        ],
        &[],
    ),
    (
        "hil-views",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "hil-recording",
            "hil-console",
            "hil-facts",
            "hil-verification",
        ],
        &["plant-process", "controller-process"],
    ),
    (
        "hil-campaign",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "hil-recording",
            "hil-console",
            "hil-facts",
            "hil-run",
            "hil-views",
        ],
        &[],
    ),
    (
        "hil-python",
        &[
            "shared-types",
            "hil-session",
            "hil-config",
            "plant-process",
            "controller-process",
            "hil-in-process",
            "hil-console",
            "hil-facts",
            "hil-recording",
            "hil-run",
            "hil-verification",
        ],
        &[],
    ),
    (
        "hil",
        &[
            "hil-origin",
            "shared-types",
            "hil-session",
            "hil-codec",
            "hil-config",
            "hil-recording",
            "hil-target",
            "hil-console",
            "hil-facts",
            "hil-doctor",
            "hil-run",
            "hil-benchmark",
            "hil-verification",
            "hil-operating-point",
            "hil-views",
            "hil-campaign",
        ],
        &[],
    ),
    (
        "tests",
        &[],
        &[
            "shared-types",
            "hil-codec",
            "hil-session",
            "hil-config",
            "plant-process",
            "controller-process",
            "hil-console",
            "hil-facts",
            "hil-doctor",
            "hil-run",
            "hil-benchmark",
            "hil-verification",
            "hil-views",
            "hil",
            "hil-recording",
            "hil-target",
            "hil-campaign",
            "hil-foreign",
            "hil-port",
        ],
    ),
];

/// Packages by which a program asks the operating system, as their names begin; none is in the tree of the contract.
const SYSTEM: [&str; 8] = [
    "rustix",
    "nix",
    "libc",
    "iceoryx2",
    "thread-priority",
    "signal-hook",
    "linux-raw-sys",
    "clap",
];

/// The only packages with `unsafe`: their subject is a foreign interface.
const FOREIGN: [&str; 2] = ["hil-foreign", "hil-python"];

const PROGRAMS: [&str; 6] = [
    "controller-process",
    "hil",
    "hil-fmu",
    "hil-port",
    "hil-target",
    "plant-process",
];

fn packages() -> Vec<Value> {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--no-deps",
            "--offline",
            "--format-version",
            "1",
        ])
        .current_dir(workspace())
        .output()
        .expect("cargo can be run");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    packages.clone()
}

fn text(value: &Value) -> &str {
    value.as_str().expect("text")
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

#[test]
fn the_workspace_has_the_listed_packages() {
    let entries: BTreeSet<String> = packages()
        .iter()
        .map(|package| text(&package["name"]).to_owned())
        .collect();
    let expected = ARROWS.iter().map(|(name, ..)| (*name).to_owned());
    assert_eq!(entries, expected.collect());
}

#[test]
fn each_package_depends_only_on_packages_listed_before_it() {
    let names = ARROWS.map(|(name, ..)| name);
    for (place, (name, built, tested)) in ARROWS.iter().enumerate() {
        for on in built.iter().chain(*tested) {
            let is_above = names[..place].contains(on);
            assert!(is_above, "{name} depends on {on}, which is not above it");
        }
    }
}

#[test]
fn packages_depend_on_these_packages_and_no_others() {
    let names = ARROWS.map(|(name, ..)| name);
    for package in packages() {
        let name = text(&package["name"]);
        let (_, built, tested) = (ARROWS.iter())
            .find(|(known, ..)| *known == name)
            .expect("a known package");
        let (mut when_built, mut when_tested) = (BTreeSet::new(), BTreeSet::new());
        for dependency in list(&package["dependencies"]) {
            let on = text(&dependency["name"]);
            let is_dev = dependency["kind"] == "dev";
            if names.contains(&on) {
                let all = if is_dev {
                    &mut when_tested
                } else {
                    &mut when_built
                };
                all.insert(on);
            }
        }
        assert_eq!(when_built, built.iter().copied().collect(), "{name}");
        let extra = when_tested.difference(&when_built).copied();
        let extra: BTreeSet<&str> = extra.collect();
        assert_eq!(extra, tested.iter().copied().collect(), "{name}");
    }
}

#[test]
fn the_contract_needs_no_package_for_the_operating_system() {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--package", "shared-types", "--edges", "normal"])
        .args([
            "--prefix",
            "none",
            "--format",
            "{lib}",
            "--offline",
            "--locked",
        ])
        .current_dir(workspace())
        .output()
        .expect("cargo can be run");
    let tree = String::from_utf8(tree.stdout).expect("cargo prints text");
    let packages: BTreeSet<&str> = tree.lines().collect();
    assert!(packages.contains("shared_types") && packages.contains("zerocopy"));
    for package in packages {
        let is_system = |system: &&str| package.replace('_', "-").starts_with(*system);
        let system = SYSTEM.iter().find(|system| is_system(system));
        assert_eq!(system, None, "{package} is in the tree of shared-types");
    }
}

#[test]
fn there_are_six_programs() {
    let packages = packages();
    let targets = packages
        .iter()
        .flat_map(|package| list(&package["targets"]));
    let programs: BTreeSet<&str> = targets
        .filter(|target| list(&target["kind"]).contains(&Value::from("bin")))
        .map(|target| text(&target["name"]))
        .collect();
    assert_eq!(programs, BTreeSet::from(PROGRAMS));
}

#[test]
fn every_package_but_one_forbids_unsafe_code() {
    let root = shipped("Cargo.toml");
    assert!(root.contains("\nunsafe_code = \"forbid\"\n"));
    for package in packages() {
        let path = text(&package["manifest_path"]);
        let manifest = std::fs::read_to_string(path).expect("a manifest");
        if FOREIGN.contains(&text(&package["name"])) {
            let lints = [
                "unsafe_code = \"allow\"\n",
                "unsafe_op_in_unsafe_fn = \"deny\"\n",
                "undocumented_unsafe_blocks = \"warn\"\n",
            ];
            assert!(lints.iter().all(|lint| manifest.contains(lint)), "{path}");
            continue;
        }
        assert!(
            manifest.contains("[lints]\nworkspace = true\n"),
            "{path} does not take the lints of the workspace"
        );
    }
}

#[test]
fn each_readme_states_callers_and_limits() {
    for package in packages() {
        let manifest = Path::new(text(&package["manifest_path"]));
        let folder = manifest.parent().expect("a folder");
        let is_contract =
            ["shared-types", "hil-session", "hil-codec"].contains(&text(&package["name"]));
        if !is_contract && !folder.starts_with(workspace().join("tools")) {
            continue;
        }
        let readme = std::fs::read_to_string(folder.join("README.md"));
        let readme = readme.unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        let title = format!("# {}\n", text(&package["name"]));
        for part in [&*title, "\n## Callers\n", "\n## Never\n"] {
            assert!(readme.contains(part), "{}: {part:?}", folder.display());
        }
        assert!(readme.lines().count() <= 40, "{}", folder.display());
        assert!(!package["description"].is_null(), "{}", folder.display());
    }
}
