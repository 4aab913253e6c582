//! Scenario settings for the start of an FMU: tolerance, times, initial values, strings, files and array sizes.

use std::process::Command;

use super::{Place, scenario};
use crate::support::fmus::{Entries, entries, entries_for_fmpy};
use crate::support::harness::Run;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{skip, workspace};
use crate::support::python::{python, succeeds};

/// Outputs of `tests/fmus/starts.c`, in the order of their value references.
const OUTPUTS: [&str; 6] = ["tolerance", "start", "stop", "at", "length", "bytes"];
const RATE_HZ: f64 = 10.0;
const STEPS: u32 = 20;

/// Returns the FMU that outputs its start settings, as entries of its archive.
pub(super) fn starts(version: u32, experiment: &str) -> Entries {
    let mut variables = String::new();
    let mut add = |name: &str, reference: usize, role: &str, start: &str, is_text: bool| {
        let head = format!("name=\"{name}\" valueReference=\"{reference}\" {role}");
        variables += &match (version, is_text) {
            (2, true) => format!("<ScalarVariable {head}><String start=\"\"/></ScalarVariable>"),
            (2, false) => format!("<ScalarVariable {head}><Real {start}/></ScalarVariable>"),
            (_, true) => format!("<String {head}><Start value=\"\"/></String>"),
            (_, false) => format!("<Float64 {head} {start}/>"),
        };
    };
    for (reference, name) in (1..).zip(OUTPUTS) {
        add(name, reference, "causality=\"output\"", "", false);
    }
    let exact = "causality=\"local\" initial=\"exact\"";
    add(
        "body.x",
        7,
        exact,
        "start=\"0\" min=\"-5\" max=\"5\"",
        false,
    );
    add("u", 8, "causality=\"input\"", "start=\"0\"", false);
    let fixed = "causality=\"parameter\" variability=\"fixed\"";
    add("name", 10, fixed, "", true);
    add("table", 11, fixed, "", true);
    add("its name", 10, fixed, "", true);
    let token = if version == 2 {
        "guid"
    } else {
        "instantiationToken"
    };
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"{version}.0\" \
         modelName=\"starts\" {token}=\"starts\"><CoSimulation modelIdentifier=\"starts\"/>{experiment}\
         <ModelVariables>{variables}</ModelVariables><ModelStructure/></fmiModelDescription>"
    );
    entries("starts", version, text.into_bytes(), &[])
}

pub(super) fn starts_scenario(rest: &str) -> String {
    let text = scenario("starts", "starts.fmu", RATE_HZ, f64::from(STEPS));
    let (before, after) = text.split_once("[controller]").expect("a controller");
    format!("{before}locals = [\"body.x\"]\n{rest}\n[controller]{after}")
}

/// Returns the outputs at the end of a run.
pub(super) fn outputs(run: &Run) -> Vec<f64> {
    let recording = Recording::open(&run.recording());
    let last = |name: &&str| {
        *recording
            .column(&format!("truth.{name}"))
            .last()
            .expect("one")
    };
    OUTPUTS.iter().map(last).collect()
}

const SETTINGS: &str = "tolerance = 1e-6\nstart_time_s = 5\nstop_time_s = 100.0\n[plant.initial]\nbody.x = 3\n\
                        [plant.texts]\nname = \"seven b\"\n[plant.files]\ntable = \"data/table.csv\"\n";

#[test]
fn an_fmu_receives_the_scenario_settings_at_its_start() {
    let last_s = f64::from(STEPS - 1) / RATE_HZ;
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("starts.fmu", &starts(version, ""));
        let run = place.run(&starts_scenario(""), "").expect(0);
        assert_eq!(outputs(&run), [-1.0, 0.0, -1.0, last_s, 0.0, 0.0]);

        let experiment = "<DefaultExperiment startTime=\"2\" stopTime=\"2.5\" tolerance=\"1e-3\"/>";
        place.fmu("starts.fmu", &starts(version, experiment));
        let run = place.run(&starts_scenario(""), "").expect(0);
        // As FMPy's `simulate_fmu`, but for a stop time that the run may pass.
        assert_eq!(outputs(&run), [1e-3, 2.0, -1.0, 2.0 + last_s, 0.0, 0.0]);

        std::fs::create_dir(place.rig.path("data")).expect("a folder");
        place.rig.write("data/table.csv", "12345");
        let run = place.run(&starts_scenario(SETTINGS), "").expect(0);
        assert_eq!(outputs(&run), [1e-6, 5.0, 100.0, 5.0 + last_s, 7.0, 5.0]);
        let x = Recording::open(&run.recording()).column("truth.body_x");
        assert_eq!(x[0], 3.0);
        assert!((x[STEPS as usize] - (3.0 + f64::from(STEPS) / RATE_HZ)).abs() < 1e-12);

        let listed = place.hil(&["describe", "starts.fmu"]).expect(0).stdout;
        for line in [
            "initial values that can be set, besides those of inputs (`plant.initial`):\n  body.x\n",
            "  name: it is a text; set it in `texts` or `files`\n",
        ] {
            assert!(listed.contains(line), "{line:?} is not in {listed}");
        }
    }
}

#[test]
fn the_start_settings_of_an_fmu_are_part_of_its_recording() {
    let Some(place) = Place::new() else { return };
    place.fmu("starts.fmu", &starts(3, ""));
    std::fs::create_dir(place.rig.path("data")).expect("a folder");
    place.rig.write("data/table.csv", "12345");
    let run = place.run(&starts_scenario(SETTINGS), "").expect(0);
    let folder = run.folder.display().to_string();
    place.hil(&["rerun", &folder, "--out", "again"]).expect(0);
    place.hil(&["judge", &folder]).expect(0);
    place
        .hil(&["scenario", "from", &folder, "-o", "from.toml"])
        .expect(0);
    let output = place
        .hil(&["config", "show", "scenario.toml"])
        .expect(0)
        .stdout;
    place.rig.write("shown.toml", &output);
    for text in ["from.toml", "shown.toml"] {
        let repeated = std::fs::read_to_string(place.rig.path(text)).expect("written");
        let again = place.run(&repeated, "").expect(0);
        assert_eq!(again.digest(), run.digest(), "{text}: {repeated}");
    }
    let other = place.run(
        &starts_scenario(SETTINGS),
        "--set plant.initial.u=4.0 --set plant.tolerance=0.1",
    );
    assert_ne!(other.expect(0).digest(), run.digest());
}

#[test]
fn unsupported_settings_of_an_fmu_are_refused_by_name() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("starts.fmu", &starts(version, ""));
        #[rustfmt::skip] // a table
        let cases = [
            ("tolerance = 0\n", "plant.tolerance"),
            ("tolerance = \"fine\"\n", "plant.tolerance"),
            ("start_time_s = 2\nstop_time_s = 1\n", "`stop_time_s` is 1, which is not after the start at 2"),
            ("[plant.initial]\nbody.y = 1\n", "`initial.body.y` is not a variable of the FMU; nearest: `body.x`"),
            ("[plant.initial]\nbody.x = 6\n", "`initial.body.x` is 6; expected -5 to 5"),
            ("[plant.initial]\nbody.x = \"big\"\n", "plant.initial.body.x"),
            ("[plant.initial]\nat = 1\n", "is calculated by the FMU"),
            ("[plant.initial]\nbody.x = 1\n\"body.x\" = 2\n", "is given twice"),
            ("[plant.texts]\nnames = \"a\"\n", "`texts.names` is not a variable of the FMU; nearest: `name`"),
            ("[plant.texts]\nname = 1\n", "plant.texts.name"),
            ("[plant.files]\ntable = \"none.csv\"\n", "none.csv, which does not exist"),
            ("[plant.files]\nname = \"a\"\n[plant.texts]\nname = \"a\"\n", "is given as a text and as a file"),
            (
                "[plant.texts]\nname = \"a\"\n\"its name\" = \"b\"\n",
                "`texts.its name` is \"b\" and `texts.name` is \"a\", but both name the same variable",
            ),
            ("[plant.texts]\nits__name = \"a\"\n\"its name\" = \"b\"\n", "but both name the same variable"),
            ("start_time_s = 2\nstop_time_s = 2.5\n", "`stop_time_s` is 2.5 s, but a run of 2 s that starts at 2 s lasts until 4 s"),
            ("[plant.structural]\nn = 2\n", "`structural.n` is not a structural parameter of the FMU; it has none"),
            ("[plant.structural]\nn = -2\n", "plant.structural.n"),
        ];
        for (rest, fragment) in cases {
            place
                .run(&starts_scenario(rest), "")
                .expect(2)
                .says(&[fragment]);
        }
    }
    let Some(place) = Place::new() else { return };
    let text =
        scenario("spring-mass", "x", 100.0, 10.0).replace("program = \"x\"", "tolerance = 0.1");
    place
        .run(&text, "")
        .expect(2)
        .says(&["is not an FMU, so `plant.tolerance` has no effect"]);
}

/// Returns the FMU whose arrays have the size of its structural parameter, as entries of its archive.
fn sized() -> Entries {
    let array = |name: &str, reference: u32, role: &str| {
        format!(
            "<Float64 name=\"{name}\" valueReference=\"{reference}\" {role}><Dimension valueReference=\"1\"/></Float64>"
        )
    };
    let variables = [
        "<UInt64 name=\"n\" valueReference=\"1\" causality=\"structuralParameter\" variability=\"fixed\" start=\"3\" \
         min=\"1\" max=\"5\"/>"
            .to_owned(),
        "<UInt64 name=\"n2\" valueReference=\"1\" causality=\"structuralParameter\" variability=\"fixed\" start=\"3\" \
         min=\"1\" max=\"5\"/>"
            .to_owned(),
        array("k", 2, "causality=\"parameter\" variability=\"fixed\" start=\"1 2 3\""),
        array("u", 3, "causality=\"input\" start=\"0\""),
        array("y", 4, "causality=\"output\""),
    ];
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" modelName=\"sized\" \
         instantiationToken=\"sized\"><CoSimulation modelIdentifier=\"sized\"/><ModelVariables>{}</ModelVariables>\
         <ModelStructure><Output valueReference=\"4\" dependencies=\"\"/></ModelStructure></fmiModelDescription>",
        variables.concat()
    );
    entries_for_fmpy("sized", 3, text.into_bytes(), &[])
}

#[test]
fn array_sizes_come_from_the_scenario_and_numbers_agree_with_fmpy() {
    let Some(place) = Place::new() else { return };
    let fmu = place.fmu("sized.fmu", &sized());
    let text = |n: u32, parameters: &str| {
        let text = scenario("sized", "sized.fmu", 10.0, 10.0);
        let (before, after) = text.split_once("[controller]").expect("a controller");
        format!(
            "{before}[plant.structural]\nn = {n}\n[plant.parameters]\n{parameters}[controller]{after}"
        )
    };
    let mut runs = vec![place.run(&text(3, ""), "").expect(0)];
    // There are no start values for another size.
    let missing = ["`plant.parameters.k__1` is missing"];
    place.run(&text(2, ""), "").expect(2).says(&missing);
    let gains = "k__1 = 0.5\nk__2 = 0.25\n";
    runs.push(place.run(&text(2, gains), "").expect(0));
    let recording = Recording::open(&runs[1].recording());
    for (signal, gain) in [("y__1", 0.5), ("y__2", 0.25)] {
        // The law `hold` commands 1.
        let expected: Vec<f64> = (0..=10_u8)
            .map(|step| f64::from(step) * (gain + 1.0))
            .collect();
        assert_eq!(recording.column(&format!("measured.{signal}")), expected);
    }
    for (text, fragment) in [
        (text(6, gains), "`structural.n` is 6; expected 1 to 5"),
        (
            text(2, gains).replace("n = 2", "m = 2"),
            "`structural.m` is not a structural parameter of the FMU; it has `n`",
        ),
        (
            text(2, gains).replace("n = 2", "n = 2\nn2 = 3"),
            "`structural.n` is 2 and `structural.n2` is 3, but both name the same variable",
        ),
    ] {
        place.run(&text, "").expect(2).says(&[fragment]);
    }
    let by_alias = place.run(&text(2, gains).replace("n = 2", "n2 = 2"), "");
    let by_alias = Recording::open(&by_alias.expect(0).recording());
    assert_eq!(
        by_alias.column("measured.y__1"),
        recording.column("measured.y__1")
    );
    let folder = runs[1].folder.display().to_string();
    place.hil(&["rerun", &folder, "--out", "again"]).expect(0);

    let Some(python) = python("fmpy, numpy, mcap") else {
        return skip("Python has no `fmpy`", "HIL_TEST_FMPY");
    };
    let mut compare = Command::new(python);
    compare.arg(workspace().join("tests/python/compare_fmu.py"));
    for run in &runs {
        compare.arg(&fmu).arg(&run.folder).arg("10");
    }
    let words = succeeds(&mut compare);
    let expected =
        "0 of 33 numbers differ, 3 of 3 outputs move\n0 of 22 numbers differ, 2 of 2 outputs move";
    assert_eq!(words.trim(), expected);
}
