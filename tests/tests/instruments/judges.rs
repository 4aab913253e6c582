//! Whole runs with instruments against independent programs.

use std::process::Command;

use crate::support::harness::{Rig, text};
use crate::support::programs::{skip, workspace};
use crate::support::python::{python, succeeds};

/// A mass at rest, whose sensor has the three errors of a gyro.
const ERRORS: &str = r#"
schema = 1
name = "errors"
run = { duration_s = 200.0, rate_hz = 1000 }
plant = { model = "spring-mass" }
controller = { law = "hold" }

[[sensors]]
signal = "position_m"
bias_sigma = "5 mm"
bias_tau_s = 0.5
bias_walk = "3 mm/sqrt(s)"
noise_density = "0.2 mm/sqrt(Hz)"
"#;

#[test]
fn allantools_finds_the_coefficients_of_a_sensor_in_its_recording() {
    let Some(python) = python("allantools, numpy") else {
        let why = "python3 with allantools and numpy is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let scenario = rig.write("errors.toml", ERRORS);
    let line = format!(
        "{} --record sensor.* --record sensed.* --link in-process",
        scenario.display()
    );
    let run = rig.run(&line).expect(0);
    let table = rig.path("errors.csv");
    let signals = ["--signal", "sensor.*", "--signal", "sensed.position_m"];
    let export = ["export", text(&run.folder), "-o", text(&table)];
    rig.hil(&[&export[..], &signals].concat()).expect(0);
    let script = workspace().join("tests/python/allan_of_sensors.py");
    let output = succeeds(Command::new(python).arg(script).arg(&table));
    assert!(
        output.contains("27 deviations of 200001 samples"),
        "{output}"
    );
}
