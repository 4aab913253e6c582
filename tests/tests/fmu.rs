//! FMUs as plants and controllers: numbers compared with FMPy, descriptions, and misbehaving FMUs.

mod aliases;
mod controllers;
mod deaths;
mod ends;
mod inputs;
mod linear;
mod names;
mod order;
mod shipped;
mod slips;
mod start;
mod states;
mod studies;
mod takeover;
mod tuning;
mod vendor;

use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

use crate::support::fmus::{Entries, REFERENCE, has_compiler, proportional, reference, write};
use crate::support::harness::{Rig, Run};
use crate::support::programs::{program, shipped, skip, workspace};
use crate::support::python::{python, succeeds};

/// Rig with its own temporary folder, so that remains of FMUs are visible.
struct Place {
    rig: Rig,
}

impl Place {
    /// Creates a place, or reports that this machine has no C compiler for FMUs.
    fn new() -> Option<Self> {
        if !has_compiler() {
            skip("there is no C compiler", "HIL_TEST_CC");
            return None;
        }
        let rig = Rig::new();
        std::fs::create_dir(rig.path("temporary")).expect("a folder");
        Some(Self { rig })
    }

    /// Writes an FMU to the test's folder.
    fn fmu(&self, name: &str, entries: &[(String, Vec<u8>)]) -> PathBuf {
        let path = self.rig.path(name);
        write(&path, entries);
        path
    }

    fn run(&self, scenario: &str, arguments: &str) -> Run {
        let scenario = self.rig.write("scenario.toml", scenario);
        let arguments = format!("{} {arguments}", scenario.display());
        let run = self.rig.start_with(self.command(), &arguments).finish();
        self.assert_nothing_unpacked();
        run
    }

    fn hil(&self, arguments: &[&str]) -> Run {
        let mut hil = self.command();
        hil.args(arguments).current_dir(self.rig.path(""));
        let run = self.rig.program(hil);
        self.assert_nothing_unpacked();
        run
    }

    fn command(&self) -> Command {
        let mut hil = self.rig.command(program("hil"));
        hil.env("TMPDIR", self.rig.path("temporary"));
        hil
    }

    fn assert_nothing_unpacked(&self) {
        let left = std::fs::read_dir(self.rig.path("temporary")).expect("there");
        let left: Vec<_> = left.flatten().map(|entry| entry.path()).collect();
        assert_eq!(left, [""; 0].map(PathBuf::from), "left on disk");
    }
}

fn scenario(model: &str, program: &str, rate_hz: f64, steps: f64) -> String {
    let duration_s = steps / rate_hz;
    format!(
        "schema = 1\nname = \"fmu\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = {rate_hz:?}\n[plant]\nmodel = \"{model}\"\nprogram = \"{program}\"\n[controller]\nlaw = \"hold\"\n[controller.hold]\nvalue = 1.0\n"
    )
}

/// Returns faults that give every command of an FMU its own values: another sine for each number, steps for
/// integers.
fn moved(described: &Value, rate_hz: f64) -> String {
    let mut text = String::new();
    let commands = described["description"]["plants"][0]["commands"].as_array();
    for (number, command) in commands.expect("a list").iter().enumerate() {
        let name = command["name"].as_str().expect("a name");
        let at_s = (3.0 + number as f64) / rate_hz;
        let is_float = name.starts_with("Float") || name.starts_with("u_");
        let effect = match (is_float, command["max"].as_f64()) {
            (true, _) => {
                let frequency_hz = rate_hz / (7.0 + number as f64);
                format!("amplitude = 0.7\nfrequency_hz = {frequency_hz:?}")
            }
            (false, Some(1.0)) => "value = 0.0".into(),
            (false, Some(2.0)) => "value = 2.0".into(),
            (false, _) => format!("value = {:?}", 100.0 + number as f64),
        };
        let kind = if is_float {
            "oscillation-additive"
        } else {
            "stuck-at"
        };
        text += &format!(
            "[[faults]]\nkind = \"{kind}\"\nat_s = {at_s:?}\n[[faults.effects]]\ntarget = \"command.{name}\"\n{effect}\n"
        );
    }
    text
}

#[test]
fn every_reference_fmu_gives_the_numbers_of_fmpy() {
    let Some(place) = Place::new() else { return };
    let mut runs = Vec::new();
    for (model, version, rate_hz) in REFERENCE {
        let name = format!("{model}{version}.fmu");
        let path = place.fmu(&name, &reference(model, version));
        let described = place.hil(&["describe", "--json", &name]).expect(0).json();
        let text = scenario(model, &name, rate_hz, 40.0) + &moved(&described, rate_hz);
        let run = place.run(&text, "").expect(0);
        let summary = run.summary();
        for hash in ["blake3", "host_blake3"] {
            assert!(described[hash].is_string(), "{model} {version}");
            assert_eq!(summary["plant"][hash], described[hash], "{model} {version}");
        }
        runs.push((path, run.folder, rate_hz));
    }
    let Some(python) = python("fmpy, numpy, mcap") else {
        return skip("Python has no `fmpy`", "HIL_TEST_FMPY");
    };
    // All in one interpreter: its imports take longer than a comparison.
    let mut compare = Command::new(python);
    compare.arg(workspace().join("tests/python/compare_fmu.py"));
    for (path, folder, rate_hz) in &runs {
        compare.arg(path).arg(folder).arg(rate_hz.to_string());
    }
    let output = succeeds(&mut compare);
    assert_eq!(output.lines().count(), REFERENCE.len(), "{output}");
    for ((model, version, _), output) in REFERENCE.iter().zip(output.lines()) {
        assert!(output.starts_with("0 of "), "{model} {version}: {output}");
        assert_eq!(
            *model == "Resource",
            output.contains(", 0 of"),
            "{model} {version}: {output}"
        );
    }
}

#[test]
fn a_description_lists_direct_feedthrough_and_omissions() {
    let Some(place) = Place::new() else { return };
    place.fmu("f.fmu", &reference("Feedthrough", 3));
    let text = place.hil(&["describe", "f.fmu"]).expect(0).stdout;
    for line in [
        "FMI 3.0 co-simulation, made by Reference FMUs (development build)",
        "advances in steps of 0.1 s; the period of a run must be a multiple of this",
        "  Int32_output on Int32_input",
        "  Binary_input: it is a binary and keeps its start value",
        "  String_output: it is a text",
    ] {
        assert!(
            text.lines().any(|one| one == line),
            "{line:?} is not in:\n{text}"
        );
    }
    place.fmu("p.fmu", &proportional());
    place
        .hil(&["describe", "p.fmu", "--as", "controller"])
        .expect(0)
        .prints(&["law proportional for any plant"]);
    // A program can be described as well.
    let plant = program("plant-process");
    place
        .hil(&["describe", plant.to_str().expect("text")])
        .expect(0)
        .prints(&["plant spring-mass: "]);
}

#[test]
fn parameters_and_rates_are_checked_before_anything_runs() {
    let Some(place) = Place::new() else { return };
    place.fmu("ball.fmu", &reference("BouncingBall", 3));
    let text = scenario("BouncingBall", "ball.fmu", 1000.0, 1000.0);
    let refused = |arguments: &str, fragment: &str| {
        place.run(&text, arguments).expect(2).says(&[fragment]);
    };
    refused("--set plant.parameters.e=0.4", "0.5 to 1");
    refused("--set plant.parameters.f=0.4", "has no parameter `f`");
    refused("--set run.rate_hz=1500", "fixed step of 0.001 s");
    refused(
        "--set plant.locals=[\"none*\"]",
        "no inner signal of the FMU matches \"none*\"",
    );
    place.fmu("p.fmu", &proportional());
    let text = scenario("proportional", "p.fmu", 10.0, 10.0);
    place
        .run(&text, "--set plant.parameters.gain_n_per_m=2000")
        .expect(2)
        .says(&["the gain is too large for this drive"]);
    place
        .run(&scenario("spring-mass", "p.fmu", 10.0, 10.0), "")
        .expect(2)
        .says(&["proportional"]);
}

#[test]
fn a_tunable_parameter_can_be_faulted_and_a_fixed_one_cannot() {
    let Some(place) = Place::new() else { return };
    place.fmu("f.fmu", &reference("Feedthrough", 3));
    let fault = |parameter: &str| {
        format!(
            "[[faults]]\nkind = \"bias\"\nat_s = 1.0\n[[faults.effects]]\ntarget = \"parameter.{parameter}\"\nbias = 0.5\n"
        )
    };
    let text = scenario("Feedthrough", "f.fmu", 10.0, 20.0);
    let fixed = text.clone() + &fault("Float64_fixed_parameter");
    place.run(&fixed, "").expect(2);
    let run = place
        .run(&(text + &fault("Float64_tunable_parameter")), "")
        .expect(0);
    assert_eq!(run.summary()["faults"][0]["effective_step"], 10);
}

#[test]
fn a_run_resumed_from_a_checkpoint_equals_the_uninterrupted_one() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("v.fmu", &reference("VanDerPol", version));
        let text = scenario("VanDerPol", "v.fmu", 100.0, 400.0);
        let straight = place.run(&text, "--checkpoint-at 2").expect(0);
        let from = straight.folder.join("checkpoint-200");
        let out = place.rig.path("resumed");
        let [from, to] = [&from, &out].map(|path| path.to_str().expect("text"));
        let resumed = place.hil(&["run", "--from", from, "--out", to]).expect(0);
        let resumed = Run {
            folder: out,
            ..resumed
        };
        let digest = |run: &Run| run.summary()["digest"].clone();
        assert_eq!(digest(&straight), digest(&resumed));
    }
}

#[test]
fn an_error_in_a_step_is_reported_with_the_last_message() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let text = scenario("proportional", "p.fmu", 10.0, 10.0);
    for (trouble, code, fragment) in [
        (1, 3, "the valve model divides by zero"),
        (2, 3, "SIGABRT"),
        (3, 3, "plant ended before the run was over"),
        (4, 1, "the step is too long"),
        (5, 3, "answered DoStep with Error: the pump cavitates"),
        (6, 3, "answered DoStep with Fatal: the memory is corrupt"),
        (7, 1, "ended the simulation"),
        (8, 3, "`count` is an integer beyond 2^53"),
        (9, 1, "force_n = NaN is not a finite number"),
        (10, 3, "returned early from a step"),
    ] {
        let run = place.run(&text, &format!("--set plant.parameters.trouble={trouble}"));
        assert_eq!(run.code, Some(code), "{trouble}: {}", run.stderr);
        let expected = format!("{}{}", run.stdout, run.stderr);
        assert!(expected.contains(fragment), "{trouble}: {expected}");
        let log = std::fs::read_to_string(run.folder.join("plant.log")).unwrap_or_default();
        assert!(
            !log.contains("freed after") && !log.contains("terminated after"),
            "{log}"
        );
    }
}

#[test]
fn an_fmu_is_a_controller() {
    let Some(place) = Place::new() else { return };
    let fmu = place.fmu("p.fmu", &proportional());
    let arguments = format!(
        "--controller-bin {} --set controller.law=proportional --set run.duration_s=1",
        fmu.display()
    );
    let text = shipped("scenarios/spring-mass.toml");
    let text = text
        .split("[controller.pid]")
        .next()
        .expect("the begin")
        .to_owned()
        + "[[stimuli]]\ntarget = \"position_m\"\nkind = \"step\"\nat_s = 0.5\nafter = 0.01\n\
           [[changes]]\nat_s = 0.7\nset.controller.proportional.gain_n_per_m = 250.0\n";
    let run = place.run(&text, &arguments).expect(0);
    let out = place.rig.path("table.csv");
    let arguments = [
        "export",
        run.folder.to_str().expect("text"),
        "-o",
        out.to_str().expect("text"),
    ];
    let signals = [
        "measured.position_m",
        "reference.position_m",
        "command.force_n",
    ];
    let signals = signals.iter().flat_map(|name| ["--signal", name]);
    place
        .hil(&arguments.into_iter().chain(signals).collect::<Vec<_>>())
        .expect(0);
    let table = std::fs::read_to_string(out).expect("written");
    let mut moved = 0;
    for (step, line) in table.lines().skip(1).take(1000).enumerate() {
        let gain = if step < 700 { 100.0 } else { 250.0 };
        let row: Vec<f64> = line
            .split(',')
            .map(|cell| cell.parse().expect("a number"))
            .collect();
        let [.., measured, reference, command] = row[..] else {
            panic!("{line}")
        };
        assert_eq!(command, gain * (reference - measured), "{line}");
        moved += usize::from(command != 0.0);
    }
    assert!(moved > 400, "{moved}");
}

/// Returns entries with the content of one of them replaced.
fn with(mut entries: Entries, name: &str, change: impl FnOnce(Vec<u8>) -> Vec<u8>) -> Entries {
    let entry = entries
        .iter_mut()
        .find(|(found, _)| found.contains(name))
        .expect("there");
    entry.1 = change(std::mem::take(&mut entry.1));
    entries
}

#[test]
fn broken_and_hostile_archives_are_refused_and_nothing_is_left() {
    let Some(place) = Place::new() else { return };
    let sound = reference("Dahlquist", 3);
    let text = |from: &'static str, to: &'static str| {
        move |bytes: Vec<u8>| {
            String::from_utf8(bytes)
                .expect("text")
                .replace(from, to)
                .into_bytes()
        }
    };
    let and = |name: &str| [sound.clone(), vec![(name.into(), b"x".to_vec())]].concat();
    let bomb = "<!DOCTYPE d [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;\">]>\n<fmiModelDescription";
    let library = "Dahlquist.so";
    #[rustfmt::skip] // a table
    let cases = [
        (and("../../outside"), "does not name a file inside the archive"),
        (and("/etc/outside"), "does not name a file inside the archive"),
        (vec![], "too short"),
        (sound[1..].to_vec(), "the archive has no modelDescription.xml"),
        (sound[..1].to_vec(), "the FMU has no library for"),
        (with(sound.clone(), ".xml", text("<fmiModelDescription", bomb)), "document type"),
        (with(sound.clone(), ".xml", text("\"3.0\"", "\"1.0\"")), "only FMI 2.0 and 3.0 are supported"),
        (with(sound.clone(), ".xml", |bytes| { bytes[..bytes.len() / 2].to_vec() }), "modelDescription.xml"),
        (with(sound.clone(), library, |_| b"no library".to_vec()), "the FMU's library cannot be loaded"),
        (with(sound.clone(), ".xml", text("instantiationToken=\"{", "instantiationToken=\"{0")), "refuses to be instantiated"),
        (
            with(sound.clone(), library, |_| {
                let other = reference("Dahlquist", 2);
                other[1].1.clone()
            }),
            "no function `fmi3GetVersion`",
        ),
    ];
    for (entries, fragment) in cases {
        place.fmu("hostile.fmu", &entries);
        if entries.is_empty() {
            place.rig.write("hostile.fmu", "PK");
        }
        let run = place.run(&scenario("Dahlquist", "hostile.fmu", 10.0, 10.0), "");
        let run = run.expect(2).says(&[fragment]);
        assert!(!run.folder.exists(), "nothing was started");
    }
}

#[test]
fn an_fmu_that_others_can_write_is_not_run() {
    use std::os::unix::fs::PermissionsExt;
    let Some(place) = Place::new() else { return };
    let path = place.fmu("d.fmu", &reference("Dahlquist", 3));
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o666)).expect("ours");
    place
        .run(&scenario("Dahlquist", "d.fmu", 10.0, 10.0), "")
        .expect(2)
        .says(&["can be written by others"]);
}

#[test]
fn a_recorded_run_of_an_fmu_is_repeated_with_its_local_signals() {
    let Some(place) = Place::new() else { return };
    place.fmu("d.fmu", &reference("Dahlquist", 2));
    let text = scenario("Dahlquist", "d.fmu", 10.0, 20.0);
    let run = place
        .run(&text, "--set plant.locals=[\"der(*)\"]")
        .expect(0);
    let folder = run.folder.to_str().expect("text");
    let listed = place.hil(&["export", folder, "--list"]).expect(0).stdout;
    assert!(listed.contains("truth.der__x"), "{listed}");
    let again = place.rig.path("again");
    place
        .hil(&["rerun", folder, "--out", again.to_str().expect("text")])
        .expect(0);
}
