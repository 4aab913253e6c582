//! Folders created by `hil new`. The book's pages show what they build and run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::harness::{Rig, Run, names};
use crate::support::programs::{LINES, finish, target, workspace};

/// Runs `hil` in the test's folder.
fn hil(rig: &Rig, line: &str) -> Run {
    let words: Vec<&str> = line.split(' ').collect();
    rig.hil_in(&rig.path(""), &words)
}

/// Builds a new crate, reusing the builds of the framework by the crates of `examples`.
fn build(folder: &Path) {
    let outside = target().join("examples-outside");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--offline"]).current_dir(folder);
    finish(
        cargo
            .env("CARGO_BUILD_BUILD_DIR", outside)
            .env(LINES.0, LINES.1)
            .env_remove("CARGO_TARGET_DIR"),
    );
}

#[test]
fn a_new_folder_refers_to_the_framework_by_a_relative_path() {
    let rig = Rig::new();
    let report = hil(&rig, "new plant cart --json").expect(0).json();
    assert_eq!(report["folder"], "cart");
    let files = report["files"].as_array().expect("files");
    let cart = rig.path("cart");
    assert!(
        files
            .iter()
            .all(|file| cart.join(file.as_str().expect("text")).is_file())
    );
    let expected = [
        ".cargo",
        ".gitignore",
        "Cargo.lock",
        "Cargo.toml",
        "README.md",
        "cart.toml",
        "src",
    ];
    assert_eq!(names(&cart), expected.map(String::from).into());
    for file in files {
        let file = file.as_str().expect("text");
        let text = fs::read_to_string(cart.join(file)).expect("text");
        let absolute = workspace().display().to_string();
        let has_absolute = text
            .replace(&format!("..{absolute}"), "")
            .contains(&absolute);
        let has_gap = ["@NAME@", "@KIND@", "@FRAMEWORK@"]
            .iter()
            .any(|gap| text.contains(gap));
        assert!(!has_gap && !has_absolute, "{file}:\n{text}");
    }
    let package = fs::read_to_string(cart.join("Cargo.toml")).expect("text");
    let path = package
        .split_once("shared-types = { path = \"")
        .expect("a path")
        .1;
    let path = cart.join(path.split_once('"').expect("its end").0);
    let same = |path: PathBuf| path.canonicalize().expect("it is there");
    assert_eq!(same(path), same(workspace().join("shared-types")));
}

#[test]
fn nothing_is_built_in_the_clone_and_a_makefile_takes_a_path_with_a_space() {
    let rig = Rig::new();
    let clone = rig.path("my clone");
    for package in [
        "plant-process",
        "controller-process",
        "shared-types",
        "tools/foreign",
    ] {
        fs::create_dir_all(clone.join(package)).expect("made");
        fs::write(clone.join(package).join("Cargo.toml"), "").expect("written");
    }
    fs::write(clone.join("Cargo.lock"), "version = 4\n").expect("written");
    for (line, file) in [
        ("new plant cart --framework", ".cargo/config.toml"),
        ("new plant crane --lang c --framework", "Makefile"),
    ] {
        let mut words: Vec<&str> = line.split(' ').collect();
        words.push("my clone");
        rig.hil_in(&rig.path(""), &words).expect(0);
        let text = fs::read_to_string(rig.path(words[2]).join(file)).expect("text");
        match file {
            "Makefile" => assert!(text.contains("HIL ?= ../my clone\n"), "{text}"),
            _ => assert!(
                !text.contains("clone") && text.contains("{cargo-cache-home}"),
                "{text}"
            ),
        }
    }
    let library = |variable: &str, folder: &str| {
        let mut make = Command::new("make");
        make.args(["-n", "crane"]).current_dir(rig.path("crane"));
        make.env_remove("CARGO_TARGET_DIR").env_remove("HIL");
        let output = make.env(variable, folder).output().expect("make runs");
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    fs::create_dir_all(clone.join("tools/foreign/include")).expect("made");
    fs::write(clone.join("tools/foreign/include/hil.h"), "").expect("written");
    let shared = library("CARGO_TARGET_DIR", "/shared folder");
    assert!(
        shared.contains("--target-dir \"/shared folder\" "),
        "{shared}"
    );
    let own = library("UNUSED", "");
    assert!(
        own.contains("--target-dir \"../my clone/target\" "),
        "{own}"
    );
}

#[test]
fn a_new_scenario_passes_its_requirements() {
    let rig = Rig::new();
    hil(&rig, "new scenario gust").expect(0);
    let folder = rig.path("gust");
    rig.hil_in(&folder, &["run", "gust.toml", "--out", "runs/a"])
        .expect(0);
    let weak = [
        "run",
        "gust.toml",
        "--set",
        "controller.pid.integral_n_per_m_s=0",
    ];
    rig.hil_in(&folder, &weak).expect(1);
}

#[test]
fn two_folders_of_the_same_name_have_separate_programs() {
    let rig = Rig::new();
    let described = ["first", "second"].map(|place| {
        fs::create_dir(rig.path(place)).expect("made");
        hil(&rig, &format!("new controller {place}/steer")).expect(0);
        let code = rig.path(&format!("{place}/steer/src/main.rs"));
        let text = fs::read_to_string(&code).expect("code");
        let other = text.replace("Takes a mass to a position.", place);
        assert_ne!(text, other);
        fs::write(code, other).expect("written");
        rig.path(&format!("{place}/steer"))
    });
    // Alternating: a fresh build of one must not be taken for the other.
    for folder in described.iter().chain(&described) {
        build(folder);
        let mut program = rig.command(folder.join("target/debug/steer"));
        let output = program.arg("--describe").output().expect("it runs");
        let output: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let place = folder.parent().and_then(Path::file_name).expect("a name");
        assert_eq!(output["laws"][0]["summary"].as_str(), place.to_str());
    }
}

#[test]
fn impossible_projects_are_refused_and_nothing_is_left() {
    let rig = Rig::new();
    rig.write("there", "mine");
    for (line, expected) in [
        ("new plant Cart", "`Cart`"),
        ("new plant 2cart", "`2cart`"),
        ("new plant cart-", "`cart-`"),
        ("new plant ..", "end with the name"),
        ("new plant spring-mass", "`spring-mass`"),
        ("new controller pid", "`pid`"),
        ("new controller loop", "`loop`"),
        ("new scenario there", "already exists"),
        ("new scenario no/such/gust", "cannot create no/such/gust"),
        (
            "new plant cart --framework .",
            "is not a clone of the framework",
        ),
        ("new plant cart --framework nowhere", "nowhere"),
    ] {
        let run = hil(&rig, line).expect(2);
        assert!(
            run.stderr.contains(expected) && run.stdout.is_empty(),
            "{line}: {}",
            run.stderr
        );
        assert_eq!(names(&rig.path("")), ["there".to_owned()].into(), "{line}");
    }
}
