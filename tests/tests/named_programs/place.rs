//! Folder with programs and a scenario that names them.

use std::path::PathBuf;

use crate::support::harness::{Rig, Run};
use crate::support::programs::{example, shipped};

/// The pendulum's scenario and its two programs in the test's folder, with the programs named by the scenario.
pub(super) struct Place {
    pub(super) rig: Rig,
    pub(super) scenario: PathBuf,
    pub(super) plant: PathBuf,
    pub(super) law: PathBuf,
}

impl Place {
    pub(super) fn new() -> Self {
        let rig = Rig::new();
        std::fs::create_dir(rig.path("bin")).expect("a folder");
        let (plant, law) = (rig.path("bin/plant"), rig.path("bin/law"));
        std::fs::copy(example("own-plant"), &plant).expect("copied");
        std::fs::copy(example("own-controller"), &law).expect("copied");
        let machine = rustix::system::uname();
        let machine = machine.machine().to_str().expect("plain text").to_owned();
        let scenario = rig.write(
            "own.toml",
            &naming(
                "\"bin/plant\"",
                &format!("{{ {machine} = \"bin/law\", pdp11 = \"nowhere\" }}"),
            ),
        );
        Self {
            rig,
            scenario,
            plant,
            law,
        }
    }

    pub(super) fn run(&self, arguments: &str) -> Run {
        let scenario = self.scenario.display();
        self.rig.run(&format!("{scenario} {arguments}"))
    }

    /// Records a run.
    pub(super) fn recorded(&self) -> Run {
        self.run("").expect(0)
    }

    /// Runs a command on a recorded run, writing to a folder of its own.
    pub(super) fn on(&self, run: &Run, arguments: &[&str]) -> Run {
        let folder = run.folder.to_str().expect("plain text");
        let [command, rest @ ..] = arguments else {
            panic!("a command")
        };
        self.rig.hil(&[&[*command, folder], rest].concat())
    }

    pub(super) fn rerun(&self, run: &Run, name: &str, arguments: &[&str]) -> Run {
        let out = self.rig.path(name);
        let out = ["--out", out.to_str().expect("plain text")];
        self.on(run, &[&["rerun"], &out[..], arguments].concat())
    }
}

/// Returns the pendulum's scenario with these programs.
pub(super) fn naming(plant: &str, controller: &str) -> String {
    let shipped = shipped("examples/own-plant/pendulum.toml");
    let lines = shipped.lines().filter(|line| !line.starts_with("program"));
    let mut text = String::new();
    for line in lines {
        text += line;
        text.push('\n');
        match line {
            "[plant]" => text += &format!("program = {plant}\n"),
            "[controller]" => text += &format!("program = {controller}\n"),
            _ => {}
        }
    }
    text
}
