//! The law `pid` on the same mass in millimetres and kilonewtons as an FMU, as a plant in C and as one in Rust: one
//! digest, in every mode of running it.

use std::path::{Path, PathBuf};

use super::{CLEAN, compiled, has};
use crate::connect::{RUN, SLIDER};
use crate::support::board::Board;
use crate::support::fmus::{slider, write};
use crate::support::harness::{Rig, Run, text};
use crate::support::programs::program_of_tests;

/// Returns the scenario of [`connect`](crate::connect), integrated in whole steps like the FMU.
fn scenario() -> String {
    let whole_steps = SLIDER.replace("\"slider\"\n", "\"slider\"\nsubsteps = 1\n");
    let arrives = "[[requirements]]\nname = \"arrives\"\nformula = \"eventually (truth.s > 9)\"\n";
    [RUN, &whole_steps, arrives].concat()
}

/// Builds the plant as an FMU and as a program in C.
fn plants(rig: &Rig) -> [PathBuf; 2] {
    let fmu = rig.path("slider.fmu");
    write(&fmu, &slider());
    let in_c = compiled(rig, "cc", "tests/tests/foreign/slider.c", "slider", CLEAN);
    [fmu, in_c]
}

fn run(rig: &Rig, plant: &Path, more: &str) -> Run {
    let scenario = rig.write("connected.toml", &scenario());
    let (scenario, plant) = (scenario.display(), plant.display());
    rig.run(&format!("{scenario} --plant-bin {plant} {more}"))
        .expect(0)
}

#[test]
fn a_connected_law_has_one_digest_on_an_fmu_in_c_and_in_rust() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let in_rust = run(&rig, &program_of_tests("foreign-plant"), "");
    for plant in plants(&rig) {
        let path_text = plant.display().to_string();
        let first = run(&rig, &plant, "");
        assert_eq!(first.digest(), in_rust.digest(), "{path_text}");
        for more in ["", "--pace 10", "--no-record"] {
            assert_eq!(
                run(&rig, &plant, more).digest(),
                first.digest(),
                "{path_text} {more}"
            );
        }
        // Named by a flag and not by the scenario, so the recording names no program.
        let again = rig
            .rerun(&first.folder, &["--plant-bin", &path_text])
            .expect(0)
            .prints(&[&first.digest()]);
        std::fs::remove_dir_all(again.folder).expect("ours");
    }
}

#[test]
fn connections_work_in_real_time_and_on_a_target() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let board = Board::new(&rig);
    for plant in plants(&rig) {
        let path_text = plant.display();
        let here = run(&rig, &plant, "");
        let scenario = rig.path("connected.toml");
        let there = |more: &str| {
            let arguments = format!(
                "{} --plant-bin {path_text} --target me@board {more}",
                scenario.display()
            );
            let there = rig.start_with(board.hil(), &arguments).finish().expect(0);
            assert_eq!(there.summary()["target"]["name"], "me@board");
            there
        };
        for more in ["", "--pace 5"] {
            assert_eq!(there(more).digest(), here.digest(), "{path_text} {more}");
        }
        // The step of a command depends on the machine, but names and units do not.
        for clocked in [
            run(&rig, &plant, "--clock realtime"),
            there("--clock realtime"),
        ] {
            let summary = clocked.summary();
            assert_eq!(summary["clock"], "realtime");
            assert_eq!(
                summary["connections"],
                here.summary()["connections"],
                "{path_text}"
            );
            assert_eq!(summary["connections"][2]["plant_unit"], "kN", "{path_text}");
        }
    }
}

#[test]
fn campaign_cases_have_the_digests_of_connected_runs() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    rig.write("connected.toml", &scenario());
    let study = "schema = 1\nscenario = \"connected.toml\"\nseed = 1\nsampling = \"grid\"\n\
                 [[vary]]\nkey = \"plant.parameters.mass_kg\"\nkind = \"list\"\nvalues = [0.5, 1.0, 2.0]\n";
    let study = rig.write("study.toml", study).display().to_string();
    for plant in plants(&rig) {
        let path_text = plant.display().to_string();
        let folder = rig.path("campaign");
        let folder = folder.to_str().expect("text");
        let plan = [
            "campaign",
            "plan",
            &study,
            "-o",
            folder,
            "--plant-bin",
            &path_text,
        ];
        rig.hil(&plan).expect(0);
        rig.hil(&["campaign", "run", folder]).expect(0);
        for (case, mass_kg) in [0.5, 1.0, 2.0].into_iter().enumerate() {
            let out = format!("{folder}-case-{case}");
            let (number, out) = (case.to_string(), out.as_str());
            // Fails if the digest differs from that of the campaign.
            let expected = ["campaign", "case", folder, &number, "--out", out, "--json"];
            let expected = rig.hil(&expected).expect(0).json();
            std::fs::remove_dir_all(out).expect("ours");
            let alone = run(
                &rig,
                &plant,
                &format!("--set plant.parameters.mass_kg={mass_kg:?}"),
            );
            assert_eq!(
                expected["digest"],
                alone.digest(),
                "{path_text}: case {case}"
            );
        }
        std::fs::remove_dir_all(folder).expect("ours");
    }
}

#[test]
fn margins_are_the_same_on_an_fmu_in_c_and_in_rust() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let path = rig.write("connected.toml", &scenario());
    let margins = |plant: &Path| {
        let probe = ["--frequencies", "0.5..100/20", "--json"];
        let programs = ["--plant-bin", text(plant)];
        let command = ["margins", text(&path)];
        let run = rig.hil(&[&command[..], &programs, &probe].concat());
        run.expect(0).json()
    };
    let in_rust = margins(&program_of_tests("foreign-plant"));
    assert_eq!(in_rust["inputs"][0]["unit"], "kN");
    for plant in plants(&rig) {
        assert_eq!(margins(&plant), in_rust, "{}", plant.display());
    }
}
