//! Plants and controllers in C: the same numbers as in Rust, and every mistake reported by name.

mod connected;
mod deeds;
mod inputs;
mod modes;
mod quality;

use std::fmt::Write;
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::Command;

use hil_foreign::c::interface::{
    Controller, Interval, Parameter, Plant, Quality, Rows, Sample, Setup, Signal,
};

use crate::support::board::Board;
use crate::support::harness::{Rig, Run};
use crate::support::programs::{example, program, shipped, skip, works, workspace};
use crate::support::python::succeeds;
use deeds::{deed, misbehaving};

const PENDULUM: &str = "examples/own-plant/pendulum.toml";
pub(crate) const CLEAN: &[&str] = &[];
const SANITIZED: &[&str] = &[
    "-g",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
];

/// Returns `true` if a tool is installed; otherwise the test is reported as skipped.
pub(crate) fn has(tool: &str) -> bool {
    let is_there = works(&[tool, "--version"]);
    if !is_there {
        skip(&format!("there is no `{tool}`"), "HIL_TEST_CC");
    }
    is_there
}

/// Returns the library, built with the programs of the workspace.
fn library() -> PathBuf {
    program("examples").join("libhil_c.a")
}

/// Compiles a C or C++ program with every warning as an error.
pub(crate) fn compiled(
    rig: &Rig,
    compiler: &str,
    source: &str,
    name: &str,
    options: &[&str],
) -> PathBuf {
    let built = rig.path(name);
    let mut command = Command::new(compiler);
    command.args([
        "-O2",
        "-ffp-contract=off",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Werror",
    ]);
    command.arg(if compiler == "g++" {
        "-std=c++11"
    } else {
        "-std=c11"
    });
    command
        .args(options)
        .arg("-I")
        .arg(workspace().join("tools/foreign/include"));
    command.arg(workspace().join(source)).arg(library());
    succeeds(command.args(["-lpthread", "-ldl", "-lm", "-o"]).arg(&built));
    built
}

/// Builds the program of an example with its Makefile, in a copy of its folder.
fn made(rig: &Rig, folder: &str, name: &str) -> PathBuf {
    let copy = copied(rig, folder);
    let mut make = Command::new("make");
    make.arg("-C")
        .arg(&copy)
        .arg(format!("HIL={}", workspace().display()));
    succeeds(make.arg(format!("HIL_LIBRARY={}", library().display())));
    copy.join(name)
}

/// Builds the program of an example with its CMake file.
fn generated(rig: &Rig, folder: &str, name: &str) -> PathBuf {
    let copy = copied(rig, folder);
    let build = copy.join("build");
    let mut cmake = Command::new("cmake");
    cmake.arg("-S").arg(&copy).arg("-B").arg(&build);
    cmake.arg(format!("-DHIL={}", workspace().display()));
    succeeds(cmake.arg(format!("-DHIL_LIBRARY={}", library().display())));
    succeeds(Command::new("cmake").arg("--build").arg(&build));
    build.join(name)
}

fn copied(rig: &Rig, folder: &str) -> PathBuf {
    let copy = rig.path(folder);
    std::fs::create_dir_all(&copy).expect("a folder");
    for entry in std::fs::read_dir(workspace().join("examples").join(folder)).expect("an example") {
        let entry = entry.expect("an entry");
        if entry.file_type().expect("a type").is_file() {
            std::fs::copy(entry.path(), copy.join(entry.file_name())).expect("copied");
        }
    }
    copy
}

fn run_of(rig: &Rig, scenario: &str, plant: &Path, controller: &Path) -> Run {
    let (plant, controller) = (plant.display(), controller.display());
    let programs = format!("--plant-bin {plant} --controller-bin {controller}");
    rig.run(&format!("{scenario} {programs}")).expect(0)
}

#[test]
fn a_pendulum_in_c_has_the_digest_of_the_one_in_rust() {
    if !has("cc") || !has("make") {
        return;
    }
    let rig = Rig::new();
    let (plant, law) = (example("own-plant"), example("own-controller"));
    // With gains that change at some time, at once and on a ramp.
    let scenario = rig.path("tuned.toml");
    let text = shipped(PENDULUM);
    let changes = "\n[[changes]]\nat_s = 0.5\nset.controller.state-feedback.angle_nm_per_rad = 12.0\n\
                   \n[[changes]]\nat_s = 1.0\nramp_s = 0.3\nset.controller.state-feedback.rate_nm_s_per_rad = 4.0\n";
    std::fs::write(&scenario, text + changes).expect("written");
    let scenario = scenario.display().to_string();
    let pendulum = |rig: &Rig, plant: &Path, law: &Path| run_of(rig, &scenario, plant, law);
    let expected = pendulum(&rig, &plant, &law).digest();
    assert_ne!(expected, run_of(&rig, PENDULUM, &plant, &law).digest());
    let plant_in_c = made(&rig, "c-plant", "pendulum");
    let law_in_c = made(&rig, "c-controller", "state_feedback");
    assert_eq!(pendulum(&rig, &plant_in_c, &law).digest(), expected);
    assert_eq!(pendulum(&rig, &plant, &law_in_c).digest(), expected);
    assert_eq!(pendulum(&rig, &plant_in_c, &law_in_c).digest(), expected);
    let board = Board::new(&rig);
    let (plant_in_c, law_in_c) = (plant_in_c.display(), law_in_c.display());
    let programs = format!("--plant-bin {plant_in_c} --controller-bin {law_in_c}");
    let there = format!("{scenario} {programs} --target me@board --pace 5");
    let there = rig.start_with(board.hil(), &there).finish().expect(0);
    assert_eq!(there.digest(), expected, "with the law on another machine");
    for source in ["c-plant/pendulum.c", "c-controller/state_feedback.c"] {
        let text = shipped(Path::new("examples").join(source));
        assert!(text.lines().count() < 60, "{source}");
    }
}

#[test]
fn cmake_builds_the_examples_and_their_runs_can_be_resumed() {
    if !has("cc") || !has("cmake") {
        return;
    }
    let rig = Rig::new();
    let plant = generated(&rig, "c-plant", "pendulum");
    let described = succeeds(rig.command(&plant).arg("--describe"));
    assert!(described.contains("\"saves\": true"), "{described}");
    let law = generated(&rig, "c-controller", "state_feedback");
    let described = succeeds(rig.command(&law).arg("--describe"));
    assert!(described.contains("\"state-feedback\""), "{described}");
    // Under `hold`, which every program can run and which can be saved.
    let changes = "--set controller.law=hold --set plant.parameters.initial_angle_rad=1e-6";
    let (plant, law) = (plant.display(), law.display());
    let run = format!("{PENDULUM} {changes} --plant-bin {plant} --controller-bin {law}");
    let whole = rig.run(&format!("{run} --checkpoint-at 0.5"));
    let whole = whole.expect(0);
    let from = format!("--from {}/checkpoint-500", whole.folder.display());
    let rest = rig.run(&from).expect(0);
    assert_eq!(rest.digest(), whole.digest());
}

#[test]
fn a_program_in_cpp_includes_the_header() {
    if !has("g++") {
        return;
    }
    let rig = Rig::new();
    let still = compiled(
        &rig,
        "g++",
        "tests/tests/foreign/includes.cpp",
        "still",
        CLEAN,
    );
    let scenario = rig.write(
        "still.toml",
        "schema = 1\nname = \"still\"\n[run]\nduration_s = 0.1\nrate_hz = 100\n\
         [plant]\nmodel = \"still\"\n[controller]\nlaw = \"hold\"\n\
         [[requirements]]\nname = \"stands\"\nformula = \"always (truth.x_m == 1)\"\n",
    );
    let (scenario, still) = (scenario.display(), still.display());
    rig.run(&format!("{scenario} --plant-bin {still}"))
        .expect(0);
}

#[test]
fn both_sides_pass_the_sanitizers_and_a_row_overrun_is_detected() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = compiled(
        &rig,
        "cc",
        "examples/c-plant/pendulum.c",
        "pendulum",
        SANITIZED,
    );
    let source = "examples/c-controller/state_feedback.c";
    let law = compiled(&rig, "cc", source, "state_feedback", SANITIZED);
    let run = run_of(&rig, PENDULUM, &plant, &law);
    for side in ["plant", "controller"] {
        let log = run.folder.join(format!("{side}.log"));
        let log = std::fs::read_to_string(log).unwrap_or_default();
        assert!(
            !log.contains("Sanitizer") && !log.contains("runtime error"),
            "{log}"
        );
    }
    let overruns = misbehaving(&rig, "misbehaving-plant", SANITIZED);
    deed(&rig, "plant", &overruns, 0).expect(0);
    let run = deed(&rig, "plant", &overruns, 10).expect(3);
    let log = std::fs::read_to_string(run.folder.join("plant.log")).expect("a log");
    assert!(log.contains("heap-buffer-overflow"), "{log}");
}

#[test]
fn new_c_projects_build_run_and_have_a_test() {
    if !has("cc") || !has("make") {
        return;
    }
    let rig = Rig::new();
    for (what, name) in [("plant", "cart"), ("controller", "steer")] {
        let place = rig.path("");
        rig.hil_in(&place, &["new", what, name, "--lang", "c"])
            .expect(0);
        let folder = rig.path(name);
        let make = |goal: &str| {
            let mut make = Command::new("make");
            make.arg("-C").arg(&folder).arg(goal);
            succeeds(make.arg(format!("HIL_LIBRARY={}", library().display())))
        };
        let output = make("test");
        assert!(output.contains(": ok"), "{output}");
        make(name);
        let scenario = format!("{name}.toml");
        rig.hil_in(&folder, &["run", &scenario, "--out", "runs/a"])
            .expect(0);
        let makefile = std::fs::read_to_string(folder.join("Makefile")).expect("it was made");
        let way = makefile
            .split_once("HIL ?= ")
            .and_then(|(_, rest)| rest.lines().next());
        let way = way.expect("a path of the framework");
        assert!(way.starts_with("../"), "{way}");
        assert!(
            folder
                .join(way)
                .join("tools/foreign/include/hil.h")
                .is_file(),
            "{way}"
        );
    }
    rig.hil(&["new", "scenario", "gust", "--lang", "c"])
        .expect(2)
        .says(&["--lang"]);
}

/// C source that fails to compile if a struct of the header differs from that of Rust.
macro_rules! same {
    ($text:ident, $name:literal, $type:ty, $($field:ident),+) => {
        writeln!($text, "_Static_assert(sizeof({0}) == {1}, \"{0}\");", $name, size_of::<$type>()).expect("text");
        $(
            let place = offset_of!($type, $field);
            let field = stringify!($field);
            writeln!($text, "_Static_assert(offsetof({0}, {field}) == {place}, \"{0}.{field}\");", $name).expect("text");
        )+
    };
}

#[test]
fn the_structs_of_the_header_match_those_of_rust() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let mut text = String::from("#include <hil.h>\n");
    same!(
        text,
        "hil_parameter",
        Parameter,
        name,
        unit,
        description,
        initial,
        min,
        max,
        flags
    );
    same!(
        text,
        "hil_signal",
        Signal,
        name,
        unit,
        description,
        min,
        max
    );
    same!(text, "hil_parameters", Rows<Parameter>, rows, count);
    same!(text, "hil_signals", Rows<Signal>, rows, count);
    same!(text, "hil_interval", Interval, start_s, length_s, substeps);
    same!(text, "hil_setup", Setup, parameters, model, period_s);
    same!(
        text,
        "hil_sample",
        Sample,
        time_s,
        measured,
        reference,
        valid,
        held_steps
    );
    same!(
        text,
        "hil_quality",
        Quality,
        measured_invalid,
        reference_invalid,
        age_steps
    );
    same!(
        text,
        "hil_plant",
        Plant,
        api,
        name,
        summary,
        version,
        parameters,
        truth,
        measured,
        commands,
        size,
        start,
        retune,
        measure,
        tell_truth,
        advance,
        saved_size,
        save,
        restore,
        end,
        read,
        start_commands,
        state,
        tell_state,
        take_state
    );
    same!(
        text,
        "hil_controller",
        Controller,
        api,
        name,
        summary,
        version,
        plant,
        parameters,
        model,
        measured,
        reference,
        commands,
        internals,
        size,
        start,
        step,
        retune,
        tuning,
        saved_size,
        save,
        restore,
        end,
        answer,
        state,
        tell_state,
        take_state
    );
    let source = rig.write("same.c", &text);
    let mut cc = Command::new("cc");
    cc.args(["-std=c11", "-fsyntax-only", "-I"]);
    succeeds(
        cc.arg(workspace().join("tools/foreign/include"))
            .arg(source),
    );
}
