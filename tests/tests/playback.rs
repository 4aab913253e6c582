//! Files played back: as reference signals of a run, and as signals of its expressions.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::support::harness::{Rig, Run, names, text};
use crate::support::programs::workspace;

/// The paper's plant under FTSC, which needs five derivatives, for half a second.
fn hydraulic(rig: &Rig, name: &str, stimulus: &str) -> String {
    let scenario = format!(
        "schema = 1\n[run]\nduration_s = 0.5\nrate_hz = 10000\n[plant]\nmodel = \"drhas\"\n\
         [controller]\nlaw = \"ftsc\"\n\
         [[stimuli]]\ntarget = \"surface_angle_rad\"\n{stimulus}\n"
    );
    text(&rig.write(name, &scenario)).into()
}

/// Runs a scenario into a folder of the test.
fn run(rig: &Rig, scenario: &str, folder: &str, options: &[&str]) -> Run {
    let folder = rig.path(folder);
    let line = [&["run", scenario, "--out", text(&folder)], options].concat();
    let run = rig.hil(&line);
    Run { folder, ..run }
}

const REFERENCE: &str = "column = \"reference.surface_angle_rad\"\n\
    derivatives = [\"reference.surface_angle_d1_radps\", \"reference.surface_angle_d2_radps2\", \
    \"reference.surface_angle_d3_radps3\", \"reference.surface_angle_d4_radps4\", \
    \"reference.surface_angle_d5_radps5\"]\n";

#[test]
fn a_run_whose_references_are_played_back_has_the_digest_of_the_first() {
    let rig = Rig::new();
    let first = run(
        &rig,
        &hydraulic(&rig, "first.toml", "kind = \"paper\""),
        "first",
        &[],
    )
    .expect(0);
    for (ending, options) in [("csv", ""), ("parquet", "--format=parquet")] {
        let file = rig.path(&format!("flight.{ending}"));
        let export = [
            "export",
            text(&first.folder),
            "-o",
            text(&file),
            "--signal",
            "reference.*",
        ];
        let options: Vec<&str> = options.split_terminator(' ').collect();
        rig.hil(&[&export[..], &options].concat()).expect(0);
    }
    for file in ["first/run.mcap", "flight.csv", "flight.parquet"] {
        for interpolation in ["linear", "hold"] {
            let keys = format!(
                "kind = \"table\"\nfile = \"{file}\"\n{REFERENCE}interpolation = \"{interpolation}\""
            );
            let scenario = hydraulic(&rig, "second.toml", &keys);
            let options = ["--link", "in-process", "--no-record"];
            let name = format!("{interpolation}-{}", file.replace(['/', '.'], "-"));
            let second = run(&rig, &scenario, &name, &options).expect(0);
            assert_eq!(second.digest(), first.digest(), "{file}, {interpolation}");
        }
    }
    // Two processes, and the run's own scenario, which no longer needs the file.
    let keys = format!("kind = \"table\"\nfile = \"first/run.mcap\"\n{REFERENCE}");
    let third = run(&rig, &hydraulic(&rig, "third.toml", &keys), "third", &[]).expect(0);
    assert_eq!(third.digest(), first.digest());
    fs::remove_dir_all(&first.folder).expect("removed");
    rig.rerun(&third.folder, &[])
        .expect(0)
        .prints(&["same digest"]);
    let own = third.folder.join("scenario.toml");
    let fourth = run(&rig, text(&own), "fourth", &["--no-record"]).expect(0);
    assert_eq!(fourth.digest(), third.digest());
    rig.assert_nothing_left();
}

#[test]
fn a_law_that_needs_derivatives_flies_a_csv() {
    let rig = Rig::new();
    let mut csv = String::from("\u{feff}\"time (ms)\";\"elevator (deg)\";note\r\n");
    for row in 0..=50 {
        let time_s = f64::from(row) / 100.0;
        let angle = 2.0 * (1.0 - libm::cos(std::f64::consts::TAU * time_s));
        let _ = write!(csv, "{};{angle:.6};ok\r\n", 10 * row);
    }
    rig.write("flight.csv", &csv);
    let keys = "kind = \"table\"\nfile = \"flight.csv\"\ncolumn = \"elevator\"\n";
    let linear = hydraulic(&rig, "linear.toml", keys);
    rig.hil(&["config", "check", &linear])
        .expect(2)
        .says(&["surface_angle_d2_radps2", "interpolation = \"cubic\""]);
    let cubic = hydraulic(
        &rig,
        "cubic.toml",
        &format!("{keys}interpolation = \"cubic\""),
    );
    let metric = "[[metrics]]\nname = \"error_rad\"\n\
        expression = \"max_abs(truth.surface_angle_rad - reference.surface_angle_rad)\"\n";
    let with_metric = fs::read_to_string(&cubic).expect("the scenario") + metric;
    fs::write(&cubic, with_metric).expect("written");
    let run = run(&rig, &cubic, "run", &["--no-record"]).expect(0);
    let error = run.summary()["metrics"][0]["value"]
        .as_f64()
        .expect("a number");
    // A hundredth of 4 deg.
    assert!(error < 7e-4, "{error}");
}

/// The teaching plant for a second, with a table as its reference.
fn teaching(rig: &Rig, name: &str, more: &str) -> String {
    let scenario = format!(
        "schema = 1\n[run]\nduration_s = 1.0\nrate_hz = 1000\n[plant]\nmodel = \"spring-mass\"\n\
         [controller]\nlaw = \"pid\"\n{more}\n"
    );
    text(&rig.write(name, &scenario)).into()
}

#[test]
fn a_long_table_is_kept_once_in_the_run_and_found_wherever_the_run_goes() {
    let rig = Rig::new();
    let mut csv = String::from("time_us,note,position_m\n");
    for row in 0..1_050_000_u32 {
        let _ = writeln!(csv, "{row},,{:?}", 0.01 * libm::sin(f64::from(row) * 1e-5));
    }
    rig.write("long.csv", &csv);
    let table = "file = \"long.csv\"\ncolumn = \"position\"";
    let more = format!(
        "[[stimuli]]\ntarget = \"position_m\"\nkind = \"table\"\n{table}\n\
         [[derived]]\nname = \"flown_m\"\n{table}\n"
    );
    let scenario = teaching(&rig, "long.toml", &more);
    let first = run(&rig, &scenario, "first", &["--checkpoint-at", "0.5"]).expect(0);
    let check = &first.summary()["checkpoints"][0]["check"]["text"];
    assert_eq!(check, "exact for 100 steps");
    let tables = names(&first.folder.join("tables"));
    assert_eq!(tables.len(), 1, "{tables:?}");
    let name = tables.first().expect("a table");
    let bytes = fs::read(first.folder.join("tables").join(name)).expect("the table");
    assert_eq!(bytes.len(), 24 + 16 * 1_050_000);
    assert_eq!(*name, format!("{}.points", blake3::hash(&bytes).to_hex()));
    let effective = fs::read_to_string(first.folder.join("scenario.toml")).expect("a scenario");
    assert!(effective.len() < 20_000, "{} bytes", effective.len());
    assert_eq!(effective.matches(name.as_str()).count(), 2);
    fs::remove_file(rig.path("long.csv")).expect("removed");

    let in_process = run(
        &rig,
        text(&first.folder.join("scenario.toml")),
        "again-in-process",
        &["--link", "in-process"],
    );
    assert_eq!(in_process.expect(0).digest(), first.digest());
    let (moved, digest) = (rig.path("moved"), first.digest());
    fs::rename(&first.folder, &moved).expect("moved");
    rig.rerun(&moved, &[]).expect(0).prints(&["same digest"]);
    let from = format!("--from {}", moved.join("checkpoint-500").display());
    let continued = rig.run(&from).expect(0);
    assert_eq!(continued.digest(), digest);
    rig.hil(&["replay", text(&moved)]).expect(0);
    let table = rig.path("flown.csv");
    rig.hil(&[
        "export",
        text(&moved),
        "-o",
        text(&table),
        "--signal",
        "flown_m",
    ])
    .expect(0);
    let exported = fs::read_to_string(&table).expect("a table");
    assert_eq!(exported.lines().count(), 1002);

    damage(&moved.join("tables").join(name));
    rig.hil(&["rerun", text(&moved)])
        .expect(2)
        .says(&["the content has changed"]);
    rig.assert_nothing_left();
}

fn damage(path: &Path) {
    let mut bytes = fs::read(path).expect("the table");
    bytes[1000] ^= 1;
    fs::write(path, bytes).expect("written");
}

#[test]
fn a_bound_may_be_what_was_measured_on_the_rig() {
    let rig = Rig::new();
    let scenario = |name: &str, limit: f64| {
        rig.write(
            "rig.csv",
            &format!("t;limit [mm]\n0;{limit}\n0.5;{limit}\n1;{}\n", limit / 2.0),
        );
        let more = "[[stimuli]]\ntarget = \"position_m\"\nkind = \"step\"\nafter = 0.01\n\
            [[derived]]\nname = \"limit_m\"\nfile = \"rig.csv\"\ncolumn = \"limit\"\n\
            [[derived]]\nname = \"room_m\"\nexpression = \"limit_m - truth.position_m\"\n\
            [[metrics]]\nname = \"least_room_m\"\nexpression = \"min(room_m)\"\n\
            [[requirements]]\nname = \"within\"\nformula = \"always(truth.position_m <= limit_m)\"\n\
            [[faults]]\nkind = \"bias\"\nwhen = \"limit_m < 40 mm\"\n\
            [[faults.effects]]\ntarget = \"measured.position_m\"\nbias = 1e-4\n";
        teaching(&rig, name, more)
    };
    let wide = run(&rig, &scenario("wide.toml", 60.0), "wide", &[]).expect(0);
    // Falls from 60 mm at 0.5 s to 30 mm at 1 s: it is below 40 mm behind step 833, which the next step sees.
    assert_eq!(wide.summary()["faults"][0]["effective_step"], 835);
    let room = wide.summary()["metrics"][0]["value"]
        .as_f64()
        .expect("a number");
    assert!(room > 0.0 && room < 0.06, "{room}");
    let narrow = run(&rig, &scenario("narrow.toml", 2.0), "narrow", &[]).expect(1);
    // The judgement from the recording needs no file: the numbers stand in the run's own scenario.
    fs::remove_file(rig.path("rig.csv")).expect("removed");
    for (run, code) in [(&wide, 0), (&narrow, 1)] {
        rig.hil(&["judge", text(&run.folder)]).expect(code);
    }
}

/// Runs a table of the scenario through every way in which a run can be had again.
fn every_way_repeats(rig: &Rig, name: &str, [file, column]: [&str; 2], scale: f64) {
    let table =
        format!("file = \"{file}\"\ncolumn = \"{column}\"\nend = \"hold\"\nscale = {scale}");
    let more = format!(
        "[[stimuli]]\ntarget = \"position_m\"\nkind = \"table\"\n{table}\n\
         [[derived]]\nname = \"flown_m\"\n{table}\n\
         [[sensors]]\nsignal = \"position_m\"\nbits = 12\nrange = [-0.1, 0.1]\nnoise_sigma = \"1 LSB\"\n\
         [[requirements]]\nname = \"near\"\nformula = \"always(abs(truth.position_m - flown_m) < 1)\"\n"
    );
    let scenario = teaching(rig, &format!("{name}.toml"), &more);
    let first = run(rig, &scenario, name, &["--checkpoint-at", "0.5"]).expect(0);
    let (digest, folder) = (first.digest(), first.folder.clone());
    let check = &first.summary()["checkpoints"][0]["check"]["text"];
    assert_eq!(check, "exact for 100 steps", "{name}");
    let again = run(
        rig,
        &scenario,
        &format!("{name}-one"),
        &["--link", "in-process"],
    );
    assert_eq!(again.expect(0).digest(), digest, "{name} in one process");
    let from = rig.run(&format!(
        "--from {}",
        folder.join("checkpoint-500").display()
    ));
    assert_eq!(from.expect(0).digest(), digest, "{name} from a checkpoint");
    rig.hil(&["rerun", text(&folder), "--no-record"])
        .expect(0)
        .prints(&["same digest"]);
    rig.hil(&["replay", text(&folder)])
        .expect(0)
        .prints(&["same: 1000 answers"]);
    let study = format!(
        "schema = 1\nname = \"study\"\nscenario = \"{name}.toml\"\ncases = 3\nseed = 1\n\
         [[vary]]\nkey = \"stimuli[0].scale\"\nkind = \"uniform\"\nmin = {}\nmax = {}\n",
        0.5 * scale,
        1.5 * scale
    );
    let study = rig.write(&format!("{name}-study.toml"), &study);
    let campaign = rig.path(&format!("{name}-campaign"));
    rig.hil(&["campaign", "plan", text(&study), "-o", text(&campaign)])
        .expect(0);
    rig.hil(&["campaign", "run", text(&campaign)]).expect(0);
    let case = rig.path(&format!("{name}-case"));
    rig.hil(&[
        "campaign",
        "case",
        text(&campaign),
        "1",
        "--out",
        text(&case),
    ])
    .expect(0)
    .says(&["reproduced the campaign's digest"]);
}

#[test]
fn a_run_repeats_from_every_kind_of_table() {
    let rig = Rig::new();
    let mut dates = String::from("when,position [mm]\n");
    let mut long = String::from("time_us,position_m\n");
    for row in 0..100_u32 {
        let x = 10.0 * libm::sin(f64::from(row) * 0.1);
        let _ = writeln!(dates, "2026-11-28 05:59:{:02}.{:02}+01:00,{x:?}", 59, row);
    }
    for row in 0..1_050_000_u32 {
        let _ = writeln!(long, "{row},{:?}", 0.01 * libm::sin(f64::from(row) * 1e-5));
    }
    rig.write("dates.csv", &dates);
    rig.write("long.csv", &long);
    every_way_repeats(&rig, "dates", ["dates.csv", "position"], 1.0);
    every_way_repeats(
        &rig,
        "recording",
        ["dates/run.mcap", "truth.position_m"],
        1.0,
    );
    let parquet = rig.path("table.parquet");
    let recording = rig.path("dates/run.mcap");
    rig.hil(&[
        "export",
        text(&recording),
        "-o",
        text(&parquet),
        "--signal",
        "truth.*",
    ])
    .expect(0);
    every_way_repeats(&rig, "parquet", ["table.parquet", "truth.position_m"], 1.0);
    every_way_repeats(&rig, "long", ["long.csv", "position"], 1.0);
    // Messages of ROS 2.
    fs::copy(
        workspace().join("tests/golden/flight.mcap"),
        rig.path("flight.mcap"),
    )
    .expect("a copy");
    every_way_repeats(&rig, "messages", ["flight.mcap", "/imu.rate.x"], 0.01);
    rig.assert_nothing_left();
}
