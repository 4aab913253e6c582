//! Scenarios through the public interface: valid and faulty ones, and their results.

mod analyses;
mod bad;
mod bad_faults;
mod bad_plots;
mod bad_requirements;
mod bus;
mod chains;
mod conditions;
mod connect;
mod dates;
mod descriptions;
mod evaluation;
mod expressions;
mod faults;
mod faults_shown;
mod flags;
mod floods;
mod good;
mod growth;
mod inputs;
mod instruments;
mod live_faults;
mod monitors;
mod points;
mod ports;
mod programs;
mod quantities;
mod rigs;
mod schema;
mod shipped;
mod show;
mod tables;
mod units;
mod waveforms;

use hil_config::plan::Plan;
use hil_config::problem::{Problem, Problems};
use hil_config::scenario::Scenario;

use descriptions::Checked;

/// Valid scenario that uses every part of the format.
const BASE: &str = r#"schema = 1
name = "base"
description = "every part of the format"

[run]
duration_s = 2.0
rate_hz = 1000
seed = 7
clock = "lockstep"
pace = 1.0

[realtime]
plant_core = 2
controller_core = 3
recorder_core = 0
priority = 80
lock_memory = true
prefault = false
dma_latency_us = 20
wait = "spin"

[plant]
model = "drhas"
substeps = 2

[plant.parameters]
piston_mass_kg = 50
actuator2.piston_mass_kg = 60.0

[plant.limits]
surface_angle_rad = [-0.4, 0.4]

[controller]
law = "ftsc"
rate_hz = 500
command_delay_steps = 1

[controller.ftsc]
gain_per_s = 10.0

[controller.pid]
gain_a_per_m = 80.0

[controller.model]
surface.inertia_kg_m2 = 13.0

[[stimuli]]
target = "surface_angle_rad"
kind = "sine"
amplitude = 0.1
frequency_hz = 1.0

[[stimuli]]
target = "load_n"
kind = "step"
at_s = 0.5
after = 2.0

[[faults]]
kind = "leakage"
at_s = 1.0

[[faults.effects]]
actuator = 1
coefficient_m3ps_per_sqrt_pa = 5e-7
speed_per_s = 10.0

[[faults.effects]]
actuator = 2
coefficient_m3ps_per_sqrt_pa = 0
speed_per_s = 0.5
skew_s = 0.25

[[derived]]
name = "error_rad"
expression = "truth.surface_angle_rad - reference.surface_angle_rad"

[[derived]]
name = "large"
expression = "abs(error_rad) > 0.1 and not internal.fault_detected > 0"

[[metrics]]
name = "max_abs_error_rad"
expression = "max_abs(error_rad)"
windows_s = [[0, 1], [1.0, 2]]

[[metrics]]
name = "share_large"
expression = "mean(large) / 1"

[[requirements]]
name = "stays-small"
description = "the surface stays near its middle"
formula = "always(abs(truth.surface_angle_rad) < 0.2)"
unit = "rad"
id = "T-12.3"
verifies = ["SYS_7", "SYS-8.1"]

[[plots]]
title = "Error"
signals = ["error_rad", "internal.fault_detected"]
laws = ["ftsc"]
scale = "log"
lines = [0.1, 0.2]

[[plots]]
title = "Surface"
signals = ["truth.surface_angle_rad"]

[panel]
window_s = 2
readings = ["error_rad", "internal.*"]
tune = ["reference.*"]
inject = ["leakage --actuator 1"]
"#;

fn parse(text: &str) -> Result<Scenario, Problems> {
    Scenario::parse(text, "folder/base.toml")
}

fn check(text: &str) -> Result<Plan, Problems> {
    parse(text)?.checked()
}

/// Returns the plan of a valid text.
fn plan(text: &str) -> Plan {
    check(text).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

/// Returns the problems of a faulty text.
fn problems(text: &str) -> Vec<Problem> {
    match check(text) {
        Ok(_) => panic!("nothing found wrong in\n{text}"),
        Err(problems) => problems.0,
    }
}

/// Returns the one problem of a list.
#[track_caller]
fn only(problems: Vec<Problem>) -> Problem {
    let [problem] = <[Problem; 1]>::try_from(problems).expect("one problem");
    problem
}

/// Returns the base with other faults.
fn base_with_faults(faults: &str) -> String {
    let begin = BASE.find("[[faults]]").expect("faults");
    let end = BASE.find("[[derived]]").expect("what follows them");
    format!("{}{faults}\n{}", &BASE[..begin], &BASE[end..])
}

/// Returns the base with another second stimulus.
fn with_stimulus(keys: &str) -> String {
    let step = "kind = \"step\"\nat_s = 0.5\nafter = 2.0";
    base_with(step, keys)
}

/// Returns the base with one piece of text replaced.
fn base_with(from: &str, to: &str) -> String {
    assert_eq!(BASE.matches(from).count(), 1, "`{from}` stands once");
    BASE.replacen(from, to, 1)
}
