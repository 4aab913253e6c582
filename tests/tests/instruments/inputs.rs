//! Inputs of instruments and of their stages: recorded on request, and shown wherever signals are.

use std::path::Path;

use super::{INSTRUMENTS, run, scenario};
use crate::support::harness::{Rig, Run, text};
use crate::support::mcap_reader::Recording;

/// A converter with a sampler and a delay, and a drive with a dead time and a lag.
const CHAINS: &str = r#"
[[sensors]]
signal = "position_m"
rate_hz = 500
delay_s = 0.002
resolution = 1e-4

[[actuators]]
signal = "force_n"
dead_time_s = 0.003
rate_limit_per_s = 50
lag_hz = 100
"#;

/// Returns the names of the recorded signals inside instruments.
fn inside(path: &Path) -> Vec<String> {
    let columns = Recording::open(path).columns;
    let is_inside = |name: &String| name.starts_with("sensor.") || name.starts_with("actuator.");
    columns.into_iter().filter(is_inside).collect()
}

#[test]
fn the_inputs_of_stages_are_recorded_on_request_and_change_nothing_else() {
    let rig = Rig::new();
    scenario(&rig, INSTRUMENTS);
    let plain = run(&rig, &[]);
    assert!(inside(&plain.recording()).is_empty());
    let all = run(&rig, &["--record *"]);
    let names = inside(&all.recording());
    assert_eq!(names.len(), 12 + 3 + 8, "{names:?}");
    for name in [
        "sensor.position_m",
        "sensor.cross_position_m",
        "sensor.noise_density_position_m",
        "sensor.range_position_m",
        "sensor.lag_hz_velocity_mps",
        "actuator.force_n",
        "actuator.rate_hz_force_n",
    ] {
        assert!(names.iter().any(|one| one == name), "no {name}: {names:?}");
    }
    assert_eq!(all.digest(), plain.digest());
    let in_process = run(
        &rig,
        &["--record sensor.* --record truth.* --link in-process"],
    );
    assert_eq!(inside(&in_process.recording()).len(), 12 + 3);
    assert_eq!(in_process.digest(), plain.digest());
    let same = rig.hil(&["compare", text(&plain.folder), text(&all.folder)]);
    same.expect(0);
    let again = rig.rerun(&all.folder, &[]).expect(0);
    assert_eq!(again.digest(), plain.digest());
    rig.hil(&["replay", text(&all.recording())]).expect(0);
    let line = format!(
        "{} --record sensor.lag_hz.force_n",
        rig.path("instruments.toml").display()
    );
    rig.run(&line)
        .expect(2)
        .says(&["no signal of this run matches"]);
}

#[test]
fn a_stage_takes_in_what_the_one_before_it_gives() {
    let rig = Rig::new();
    scenario(&rig, CHAINS);
    let recording = Recording::open(&run(&rig, &["--record *"]).recording());
    let column = |name: &str| recording.column(name);
    let [truth, model] = ["truth.position_m", "sensor.position_m"].map(column);
    let [held, delayed] = ["sensor.delay_s_position_m", "sensor.resolution_position_m"].map(column);
    let sensed = column("sensed.position_m");
    assert!(truth.iter().any(|x| *x > 0.005), "the mass moves");
    let bits = |x: f64| x.to_bits();
    for step in 0..truth.len() {
        assert_eq!(bits(model[step]), bits(truth[step]), "step {step}");
        assert_eq!(
            bits(held[step]),
            bits(truth[step - step % 2]),
            "step {step}"
        );
        assert_eq!(
            bits(delayed[step]),
            bits(held[step.saturating_sub(2)]),
            "step {step}"
        );
        assert!(
            (sensed[step] - delayed[step]).abs() <= 0.5001e-4,
            "step {step}"
        );
    }
    let [command, input] = ["command.force_n", "actuator.force_n"].map(column);
    let [late, limited] = [
        "actuator.rate_limit_per_s_force_n",
        "actuator.lag_hz_force_n",
    ]
    .map(column);
    let last = truth.len() - 1;
    for step in 0..last {
        assert_eq!(bits(input[step]), bits(command[step]), "step {step}");
        assert_eq!(
            bits(late[step]),
            bits(command[step.saturating_sub(3)]),
            "step {step}"
        );
        let before = limited[step.saturating_sub(1)];
        assert!(
            (limited[step] - before).abs() <= 0.05 + 1e-12,
            "step {step}"
        );
    }
    assert!(input[last].is_nan() && late[last].is_nan(), "no command");
}

/// Returns the run of a scenario whose expressions name inputs of stages.
fn judged(rig: &Rig, arguments: &str) -> Run {
    let judged = format!(
        "{CHAINS}
[[derived]]
name = \"sensor_error_m\"
expression = \"sensed.position_m - sensor.position_m\"
[[metrics]]
name = \"converter_error_m\"
expression = \"max_abs(sensed.position_m - sensor.resolution.position_m)\"
[[requirements]]
name = \"limited\"
formula = \"always[0, 0.9] abs(actuator.lag_hz.force_n) < 100\"
[[faults]]
kind = \"bias\"
when = \"sensor.position_m > 0.004\"
[[faults.effects]]
target = \"measured.velocity_mps\"
bias = 0.01
[[plots]]
title = \"Drive\"
signals = [\"actuator.force_n\", \"applied.force_n\"]
"
    );
    scenario(rig, &judged);
    run(rig, &[arguments])
}

#[test]
fn expressions_faults_and_views_use_what_a_stage_takes_in() {
    let rig = Rig::new();
    let first = judged(&rig, "--checkpoint-at 0.5");
    let mut names = inside(&first.recording());
    names.sort_unstable();
    let expected = [
        "actuator.force_n",
        "actuator.lag_hz_force_n",
        "sensor.position_m",
        "sensor.resolution_position_m",
    ];
    assert_eq!(names, expected);
    let summary = first.summary();
    assert_eq!(summary["verdict"], "pass");
    let error_m = summary["metrics"][0]["value"].as_f64().expect("a number");
    assert!(error_m > 0.4e-4 && error_m <= 0.5001e-4, "{error_m}");
    assert_eq!(summary["metrics"][0]["unit"], "m");
    // The fault begins a step after the first record at which its condition holds.
    let position = Recording::open(&first.recording()).column("sensor.position_m");
    let begins = position.iter().position(|x| *x > 0.004).expect("it moves") + 1;
    assert_eq!(summary["faults"][0]["effective_step"], begins);
    // A continuation records what its past did: 3 stages of the sensor and 3 of the actuator with all.
    for (more, count) in [("", 4), (" --record *", 6)] {
        let straight = run(&rig, &[&format!("--checkpoint-at 0.5{more}")]);
        let from = straight.folder.join("checkpoint-500");
        let resumed = rig.run(&format!("--from {}", from.display())).expect(0);
        assert_eq!(resumed.digest(), first.digest());
        assert_eq!(inside(&resumed.recording()).len(), count);
    }

    let export = rig.path("inside.csv");
    let signal = ["--signal", "sensor.*", "--signal", "sensor_error_m"];
    let export_arguments = ["export", text(&first.folder), "-o", text(&export)];
    rig.hil(&[&export_arguments[..], &signal].concat())
        .expect(0);
    let header = std::fs::read_to_string(&export).expect("written");
    let header = header.lines().next().expect("a header");
    for name in [
        "sensor.position_m",
        "sensor.resolution_position_m",
        "sensor_error_m",
    ] {
        assert!(header.contains(name), "{header}");
    }
    let page = rig.path("report.html");
    rig.hil(&["report", text(&first.folder), "-o", text(&page)])
        .expect(0);
    let page = std::fs::read_to_string(page).expect("written");
    assert!(page.contains("actuator.force_n"), "the plot of the drive");
    let layout = rig.path("layout.json");
    rig.hil(&[
        "layout",
        text(&first.folder),
        "foxglove",
        "-o",
        text(&layout),
    ])
    .expect(0);
    let layout = std::fs::read_to_string(layout).expect("written");
    assert!(layout.contains("actuator.force_n"), "the plot of the drive");
}

#[test]
fn live_views_show_what_a_stage_takes_in() {
    let rig = Rig::new();
    let path = scenario(&rig, CHAINS);
    let running = rig.start(&format!(
        "{} --record * --pause-at 0.5 --wait-limit 60",
        path.display()
    ));
    rig.until_held_at(500);
    let values = rig
        .in_session("get sensor.delay_s.position_m actuator.force_n --json")
        .expect(0)
        .json();
    let signals = values["signals"].as_array().expect("a list");
    assert_eq!(signals.len(), 2, "{values}");
    let bias = "inject bias measured.position_m 1e-5 --when sensor.position_m>-1";
    rig.in_session(bias).expect(0);
    rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    assert_eq!(run.summary()["faults"][0]["effective_step"], 500);
}

#[test]
fn an_unknown_stage_is_answered_with_those_that_there_are() {
    let rig = Rig::new();
    let line = "[[derived]]\nname = \"x_m\"\nexpression = \"sensor.lag_hz.position_m\"";
    let path = scenario(&rig, &format!("{CHAINS}{line}"));
    let refused = rig.hil(&["config", "check", text(&path)]).expect(2);
    refused.says(&["sensor.lag_hz.position_m", "nearest", "sensor."]);
}
