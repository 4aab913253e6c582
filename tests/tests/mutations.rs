//! The explorer of the lockstep machines detects missing guards: each mutant, with one guard removed, fails its
//! tests.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

use crate::support::programs::{build, workspace};

/// Source of the lockstep machines.
const MACHINES: &str = "shared-types/src/lockstep";

/// Mutation: a file of the machines, the original code, and that of the mutant.
type Mutant = (&'static str, &'static str, &'static str);

#[rustfmt::skip] // a table
const MUTANTS: [Mutant; 12] = [
    // A command of any step is applied.
    ("plant.rs", "Some(FrameKind::Command)) if frame_step == *step =>", "Some(FrameKind::Command)) if frame_step <= *step =>"),
    // A message of a lost controller is accepted.
    ("plant.rs", "(_, PlantEvent::Frame(_)) if self.is_alone() => self.ignore(Reason::Lost),", ""),
    // The death of any controller removes the active one.
    ("plant.rs", "if epoch == self.epoch() {", "if epoch <= self.epoch() {"),
    // A repeated sample is answered again.
    (
        "controller.rs",
        "Some(FrameKind::Sample))\n                if frame_step == *step || (may_be_later && frame_step > *step) =>",
        "Some(FrameKind::Sample))\n                if frame_step <= *step || (may_be_later && frame_step > *step) =>",
    ),
    // A repeated command violates the protocol.
    ("plant.rs", "(_, Some(FrameKind::Command)) if frame_step < self.at() =>", "(_, Some(FrameKind::Command)) if false =>"),
    // Waiting for the confirmation of the end has no limit.
    ("plant.rs", "self.late(format!(\"confirm the end after {} steps\", self.steps), *ms)", "PlantAction::Nothing"),
    // The end waits for the confirmation of a lost controller.
    (
        "plant.rs",
        "(State::AwaitConfirmation, PlantEvent::Missed) if self.is_alone() => {",
        "(State::AwaitConfirmation, PlantEvent::Missed) if self.steps == 0 => {",
    ),
    // A step waits for a lost controller.
    ("plant.rs", "self.against_clock || self.is_alone()", "self.against_clock"),
    // A controller is lost twice.
    (
        "plant.rs",
        "let Controller::Active(epoch) = self.controller else {\n            return PlantAction::Nothing;\n        };",
        "let epoch = self.epoch();",
    ),
    // Ignored messages renew the limit of a wait.
    ("plant.rs", "self.newer.0,\n        ])", "self.newer.0 + self.ignored.total(),\n        ])"),
    (
        "controller.rs",
        "Standing([self.state.number(), self.at().0, 0, 0, 0])",
        "Standing([self.state.number(), self.at().0, self.ignored, 0, 0])",
    ),
    // In real time an older command replaces a newer one.
    ("plant.rs", "frame_step < *step && frame_step >= self.newer =>", "frame_step < *step =>"),
];

#[test]
fn the_removal_of_a_guard_is_detected() {
    for (file, old, _) in MUTANTS {
        let text = std::fs::read_to_string(workspace().join(MACHINES).join(file));
        let text = text.expect("it is there");
        assert_eq!(text.matches(old).count(), 1, "{file} has once: {old}");
    }
    let some: Vec<Mutant> = MUTANTS.into_iter().step_by(4).collect();
    assert_detected(&some);
}

mod long {
    #[test]
    #[ignore = "long: .ci/run long"]
    fn the_removal_of_each_guard_is_detected() {
        super::assert_detected(&super::MUTANTS);
    }
}

/// Asserts that the tests of the machines find each of these mutants.
fn assert_detected(mutants: &[Mutant]) {
    let libraries = Libraries::built();
    let original = libraries.explore(None);
    let text = String::from_utf8_lossy(&original.stdout);
    assert!(original.status.success(), "{text}");
    let halves = mutants.split_at(mutants.len() / 2);
    std::thread::scope(|scope| {
        for half in [halves.0, halves.1] {
            let libraries = &libraries;
            scope.spawn(move || {
                for mutant in half {
                    let output = libraries.explore(Some(*mutant));
                    let text = String::from_utf8_lossy(&output.stdout);
                    assert!(!output.status.success(), "survives: {mutant:?}\n{text}");
                    // It fails by a finding, not by a crash.
                    assert!(text.contains("test result: FAILED"), "{mutant:?}\n{text}");
                }
            });
        }
    });
}

/// Libraries that the machines are compiled against: those of this workspace.
struct Libraries {
    folder: PathBuf,
    externs: Vec<String>,
}

impl Libraries {
    fn built() -> Self {
        let mut cargo = build();
        let output = cargo.args(["--message-format", "json"]).output();
        let output = output.expect("cargo can be run");
        assert!(output.status.success(), "{cargo:?}");
        let text = String::from_utf8_lossy(&output.stdout);
        let messages = text
            .lines()
            .filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let mut externs = Vec::new();
        let mut folder = PathBuf::new();
        for message in messages {
            let name = message["target"]["name"].as_str().unwrap_or_default();
            let package = message["package_id"].as_str().unwrap_or_default();
            // Another version is a dependency of some package.
            let is_wanted = match name {
                "shared_types" => true,
                "serde" => package.contains("@1."),
                "thiserror" => package.contains("@2."),
                _ => false,
            };
            // Dependencies of build scripts and macros are not optimised.
            if !is_wanted || message["profile"]["opt_level"] == "0" {
                continue;
            }
            let files = message["filenames"].as_array().into_iter().flatten();
            let mut libraries = files.filter_map(Value::as_str);
            if let Some(library) = libraries.find(|file| file.ends_with(".rlib")) {
                externs.push(format!("{name}={library}"));
                folder = Path::new(library).parent().expect("in a folder").to_owned();
            }
        }
        assert_eq!(externs.len(), 3, "{externs:?}");
        if !folder.ends_with("deps") {
            folder.push("deps");
        }
        Self { folder, externs }
    }

    /// Runs the explorer of the machines, or of a mutant: the long test only if the short ones find nothing.
    fn explore(&self, mutant: Option<Mutant>) -> Output {
        let place = TempDir::with_prefix("hil-mutant-").expect("a temporary folder");
        let machines = place.path().join("lockstep");
        for room in ["plant", "explorer"] {
            std::fs::create_dir_all(machines.join(room)).expect("the folder can be written");
        }
        let source = workspace().join(MACHINES);
        for file in [
            "mod.rs",
            "controller.rs",
            "loss.rs",
            "plant.rs",
            "plant/event.rs",
            "chatter.rs",
            "explorer.rs",
            "explorer/moves.rs",
            "explorer/world.rs",
        ] {
            let mut text = std::fs::read_to_string(source.join(file)).expect("it is there");
            text = text.replace("crate::", "shared_types::");
            text = text.replace("#[cfg(test)]\nmod tests;", "");
            if let Some((_, old, new)) = mutant.filter(|(mutated, ..)| *mutated == file) {
                text = text.replace(old, new);
            }
            std::fs::write(machines.join(file), text).expect("the folder can be written");
        }
        let root = place.path().join("machines.rs");
        std::fs::write(&root, "mod lockstep;").expect("the folder can be written");
        let program = place.path().join("machines");
        let mut rustc = Command::new("rustc");
        rustc.args(["--edition", "2024", "--test", "--cap-lints", "allow"]);
        rustc.args(["-C", "opt-level=2", "-L"]);
        rustc.arg(format!("dependency={}", self.folder.display()));
        for library in &self.externs {
            rustc.args(["--extern", library]);
        }
        rustc.arg("-o").arg(&program).arg(&root);
        let compiled = rustc.output().expect("rustc can be run");
        let message = String::from_utf8_lossy(&compiled.stderr);
        assert!(compiled.status.success(), "{mutant:?}\n{message}");
        let run = |arguments: &[&str]| {
            let output = Command::new(&program).args(arguments).output();
            output.expect("it was just made")
        };
        const LONG: &str = "whatever_happens";
        let short = run(&["--skip", LONG]);
        if short.status.success() {
            run(&[LONG])
        } else {
            short
        }
    }
}
