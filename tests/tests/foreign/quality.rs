//! Invalid and old signals of plants and controllers in C, and programs compiled before there were any.

use std::path::Path;

use super::{CLEAN, PENDULUM, SANITIZED, compiled, has, run_of};
use crate::support::harness::Rig;
use crate::support::programs::{program_of_tests, shipped};
use crate::validity::SCENARIO;

#[test]
fn a_gap_in_c_has_the_digest_of_the_one_in_rust() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let scenario = rig.write("patchy.toml", SCENARIO);
    let digest = |plant: &Path, law: &Path| {
        let (scenario, plant, law) = (scenario.display(), plant.display(), law.display());
        let programs = format!("--plant-bin {plant} --controller-bin {law}");
        let run = rig.run(&format!("{scenario} {programs}"));
        run.expect(1).digest() // one requirement fails on purpose
    };
    let [plant, law] = ["patchy-plant", "watchful-controller"].map(program_of_tests);
    let expected = digest(&plant, &law);
    for (name, options) in [("clean", CLEAN), ("sanitized", SANITIZED)] {
        let source = "tests/tests/foreign/patchy.c";
        let as_plant = [options, &["-DPLANT"]].concat();
        let plant_in_c = compiled(&rig, "cc", source, &format!("plant-{name}"), &as_plant);
        let law_in_c = compiled(&rig, "cc", source, &format!("law-{name}"), options);
        assert_eq!(digest(&plant_in_c, &law_in_c), expected, "{name}");
    }
}

#[test]
fn programs_compiled_with_older_versions_of_the_header_go_on_to_work() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let sources = [
        ("c-plant/pendulum.c", "read", ".advance = advance"),
        ("c-controller/state_feedback.c", "answer", ".step = step"),
    ];
    let programs = |name: &str, change: fn(String, &str, &str) -> String| {
        sources.map(|(source, callback, last)| {
            let text = change(shipped(Path::new("examples").join(source)), callback, last);
            let path = rig.write(&format!("{name}-{callback}.c"), &text);
            let source = path.display().to_string();
            compiled(
                &rig,
                "cc",
                &source,
                &format!("{name}-{callback}"),
                NO_PEDANTRY,
            )
        })
    };
    let [plant, law] = programs("now", |text, _, _| text);
    let expected = run_of(&rig, PENDULUM, &plant, &law).digest();
    for (name, older) in [
        (
            "version-1",
            of_version_1 as fn(String, &str, &str) -> String,
        ),
        ("version-2", of_version_2),
    ] {
        let [plant, law] = programs(name, older);
        let digest = run_of(&rig, PENDULUM, &plant, &law).digest();
        assert_eq!(digest, expected, "{name}");
    }
}

/// Options for a program that casts a number to a function.
const NO_PEDANTRY: &[&str] = &["-Wno-pedantic"];

/// Changes a program to version 1 of the header, which promises nothing behind `end`: whatever is there must not be
/// called.
fn of_version_1(text: String, callback: &str, last: &str) -> String {
    with_beyond(&text, "1u", callback, last)
}

/// Changes a program to version 2 of the header, which promises nothing behind `answer` and `start_commands`.
fn of_version_2(text: String, _callback: &str, last: &str) -> String {
    let own = ".tell_state = measure";
    match text.contains(own) {
        true => (text.replace("HIL_API", "2u")).replace(own, ".tell_state = (void *)1"),
        false => with_beyond(&text, "2u", "tell_state", last),
    }
}

fn with_beyond(text: &str, version: &str, callback: &str, last: &str) -> String {
    let text = text.replace("HIL_API", version);
    let beyond = format!("{last}, .{callback} = (void *)1");
    assert!(text.contains(last), "{text}");
    text.replacen(last, &beyond, 1)
}
