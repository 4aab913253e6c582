//! Tables made from a recording: `hil export`, and the Python package that reads the recording itself.
//!
//! Expected values come from independent readers or from a formula.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::harness::{Rig, text};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program, shipped, skip, workspace};
use crate::support::python::{python, succeeds};

const SCENARIO: &str = "tests/scenarios/leakage.toml";
const SHORT: &str = "--set run.duration_s=0.2 --set faults[0].at_s=0.1";

/// Parses a file into its header and its rows of numbers.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).expect("the table is there");
    let mut lines = text.lines();
    let header = lines.next().expect("a header").split(',');
    let row = |line: &str| {
        let cells = line.split(',').map(|cell| cell.parse().expect("a number"));
        cells.collect()
    };
    (header.map(Into::into).collect(), lines.map(row).collect())
}

#[test]
fn an_exported_table_has_the_bits_of_the_recording_and_the_derived_signals() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let path = rig.path("all.csv");
    let (folder, file) = (run.folder.to_str(), path.to_str());
    let (folder, file) = (folder.expect("text"), file.expect("text"));
    let report = rig
        .hil(&["export", folder, "-o", file, "--json"])
        .expect(0)
        .json();
    let (header, rows) = table(&path);
    assert_eq!(
        (&report["file"], &report["rows"]),
        (&file.into(), &2001.into())
    );
    assert_eq!(report["digest"], run.digest());
    assert_eq!(
        report["columns"].as_array().expect("columns").len(),
        header.len()
    );

    let place = |name: &str| header.iter().position(|one| one == name).expect(name);
    let recording = Recording::open(&run.recording());
    let signals: Vec<&String> = (recording.columns.iter())
        .filter(|name| name.contains('.'))
        .collect();
    let derived = place("tracking_error_rad");
    assert_eq!(header.len(), 2 + signals.len() + 1);
    let (truth, reference) = ("truth.surface_angle_rad", "reference.surface_angle_rad");
    let mut compared = 0;
    for (record, row) in recording.records().zip(&rows) {
        assert_eq!(row[0], record.step() as f64);
        assert_eq!(row[1], record.step() as f64 / 10_000.0);
        for name in &signals {
            let expected = recording.value(&record, name);
            let read = row[place(name)];
            assert_eq!(read.to_bits(), expected.to_bits(), "{name}");
        }
        let error = recording.value(&record, truth) - recording.value(&record, reference);
        assert_eq!(row[derived], error, "step {}", record.step());
        compared += 1;
    }
    assert_eq!((compared, rows.len()), (2001, 2001));
}

#[test]
fn a_table_has_the_derived_signals_whatever_else_of_the_run_was_recorded() {
    let rig = Rig::new();
    let whole = shipped("scenarios/spring-mass.toml");
    let sensor = "[[sensors]]\nsignal = \"position_m\"\nscale = 1.0\nlag_hz = 200\n";
    let scenario = rig.write("sensor.toml", &format!("{whole}\n{sensor}"));
    let line = format!("{} --record", scenario.display());
    for patterns in ["*", "truth.* --record reference.*"] {
        let run = rig.run(&format!("{line} {patterns}")).expect(0);
        let path = rig.path("derived.csv");
        let arguments = ["export", text(&run.folder), "-o", text(&path), "--force"];
        rig.hil(&arguments).expect(0);
        let (header, rows) = table(&path);
        let place = |name: &str| header.iter().position(|one| one == name).expect(name);
        let [error, truth, reference] = [
            "tracking_error_m",
            "truth.position_m",
            "reference.position_m",
        ]
        .map(place);
        assert_eq!(rows.len(), 5001);
        for row in &rows {
            assert_eq!(row[error], row[truth] - row[reference], "step {}", row[0]);
        }
    }
}

#[test]
fn a_requirement_judges_an_input_of_a_stage_that_only_a_flag_recorded() {
    let rig = Rig::new();
    let whole = shipped("scenarios/spring-mass.toml");
    let end = whole
        .find("\n[[derived]]")
        .expect("a part behind the stimuli");
    let sensor = "[[sensors]]\nsignal = \"position_m\"\nscale = 1.5\nlag_hz = 50\n";
    let plain = format!("{}\n{sensor}", &whole[..end]);
    let scenario = rig.write("sensor.toml", &plain);
    let requirement = "[[requirements]]\nname = \"small\"\n\
        formula = \"always (sensor.lag_hz.position_m < 1 m)\"\n";
    let other = rig.write("judge.toml", &format!("{plain}\n{requirement}"));
    let run = rig
        .run(&format!("{} --record *", scenario.display()))
        .expect(0);
    let judge = ["judge", text(&run.folder), "--requirements", text(&other)];
    let judged = rig.hil(&judge).expect(0);
    assert!(judged.stdout.contains("small"), "{}", judged.stdout);
}

#[test]
fn an_exported_stimulus_is_its_formula() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let path = rig.path("stimulus.csv");
    let arguments = ["--signal", "stimulus.surface_angle_rad", "--from", "50ms"];
    let more = ["--every", "7", "-o", path.to_str().expect("text")];
    let run = run.folder.to_str().expect("text");
    rig.hil(&[&["export", run][..], &arguments, &more].concat())
        .expect(0);
    let (header, rows) = table(&path);
    assert_eq!(header, ["step", "time_s", "stimulus.surface_angle_rad"]);
    assert_eq!(rows.len(), 1 + 1500 / 7);
    for (number, row) in rows.iter().enumerate() {
        let [step, t, angle_rad] = row[..] else {
            panic!("{row:?}");
        };
        assert_eq!(step, (500 + 7 * number) as f64);
        // The deflection command of the paper.
        let swing_rad = libm::atan(0.2 * libm::sin(2.0 * std::f64::consts::PI * t));
        let expected = swing_rad * (1.0 - libm::exp(-0.1 * t * t * t));
        assert!(
            (angle_rad - expected).abs() < 1e-15,
            "{angle_rad} and {expected} at {t} s"
        );
    }
}

#[test]
fn failed_exports_state_the_reason_and_the_remedy() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let run = run.folder.to_str().expect("text");
    let export = |arguments: &[&str]| rig.hil(&[&["export", run], arguments].concat());
    export(&["--signal", "truth.surface_angel_rad"])
        .expect(2)
        .says(&[
            "has no signal",
            "nearest: `truth.surface_angle_rad`",
            "--list",
        ]);
    export(&["--every", "0"]).expect(2);
    export(&["-o", "/dev/full", "--format", "csv"])
        .expect(3)
        .says(&["cannot write /dev/full", "No space left"]);
    let listed = export(&["--list"]).expect(0).stdout;
    let units = ["truth.surface_angle_rad", "tracking_error_rad"].map(|name| {
        let line = listed.lines().find(|line| line.starts_with(name));
        line.and_then(|line| line.split_ascii_whitespace().nth(1))
    });
    assert_eq!(units, [Some("rad"); 2]);
    let chosen = export(&["--list", "--signal", "truth.surface_*"])
        .expect(0)
        .stdout;
    let fits = |line: &&str| line.starts_with("truth.surface_");
    let expected: Vec<&str> = listed.lines().filter(fits).collect();
    assert!(expected.len() > 1);
    let names = |lines: &str| -> Vec<String> {
        let names = lines.lines().filter_map(|line| line.split(' ').next());
        names.map(str::to_owned).collect()
    };
    assert_eq!(names(&chosen), names(&expected.join("\n")));
    export(&["--list", "--signal", "truth.surface_angel_rad"])
        .expect(2)
        .says(&["has no signal", "nearest: `truth.surface_angle_rad`"]);
}

#[test]
fn a_closed_pipe_is_not_a_failure() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let mut hil = (rig.command(program("hil")))
        .arg("export")
        .arg(&run.folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("hil can be run");
    let mut begin = [0; 7];
    let mut pipe = hil.stdout.take().expect("piped");
    pipe.read_exact(&mut begin).expect("a header");
    assert_eq!(&begin, b"step,ti");
    drop(pipe);
    // It cannot wait for anything: every write fails from now on.
    let output = hil.wait_with_output().expect("hil ends");
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
}

#[test]
fn python_reads_the_same_bits_from_recording_csv_and_parquet() {
    let Some(python) = python("mcap, numpy, pandas, pyarrow") else {
        let why = "python3 with mcap, numpy, pandas and pyarrow is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let folder = run.folder.to_str().expect("text");
    let paths = ["table.csv", "table.parquet"].map(|name| rig.path(name));
    for path in &paths {
        let path = path.to_str().expect("text");
        rig.hil(&["export", folder, "--validity", "-o", path])
            .expect(0);
    }
    let script = workspace().join("tests/python/compare_export.py");
    let output = succeeds(Command::new(python).arg(script).arg(folder).args(&paths));
    assert!(output.contains("20001 steps of 98 signals"), "{output}");
}
