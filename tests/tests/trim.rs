//! Equilibria: against closed forms, kept by runs that begin there, and refused by name where there are none.

use std::fs;
use std::path::Path;

use serde_json::Value;
use shared_types::extremes::{larger, smaller};

use crate::foreign::{compiled, has};
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

const SPRING_MASS: &str = "scenarios/spring-mass.toml";

/// Trims into a folder of the rig, and returns the result.
fn trimmed(rig: &Rig, arguments: &[&str]) -> Value {
    let out = rig.path("trimmed").display().to_string();
    let run = rig.hil(&[&["trim"], arguments, &["--out", &out, "--json"]].concat());
    serde_json::from_str(&run.expect(0).stdout).expect("JSON")
}

fn value(trim: &Value, list: &str, name: &str) -> f64 {
    let all = trim[list].as_array().expect("a list");
    let one = all.iter().find(|one| one["name"] == name);
    one.expect("it is there")["value"]
        .as_f64()
        .expect("a number")
}

#[track_caller]
fn assert_near(actual: f64, expected: f64, tolerance: f64) {
    assert!(
        (actual - expected).abs() <= tolerance,
        "{actual} {expected}"
    );
}

/// Returns the range of a signal from a step on.
fn range(run: &Run, name: &str, from: usize) -> (f64, f64) {
    let recording = Recording::open(&run.recording());
    let place = recording.columns.iter().position(|column| column == name);
    let place = place.expect("a column");
    let records = recording.records();
    let values = records
        .skip(from)
        .map(|record| f64::from_bits(record.words[place]));
    values.fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), value| (smaller(least, value), larger(most, value)),
    )
}

#[test]
fn a_force_on_the_spring_has_the_deflection_of_hookes_law_and_the_run_stays_there() {
    let rig = Rig::new();
    let hold = [
        "--set",
        "controller.law=hold",
        "--set",
        "controller.hold.value=5",
    ];
    let trim = trimmed(
        &rig,
        &[&[SPRING_MASS, "--hold", "force_n=5"], &hold[..]].concat(),
    );
    // F / k = 5 N / (100 N/m)
    assert_near(value(&trim, "states", "position_m"), 0.05, 1e-13);
    assert_near(value(&trim, "states", "velocity_mps"), 0.0, 1e-13);
    assert_eq!(
        (&trim["is_stable"], &trim["law"]["refused"]),
        (&true.into(), &Value::Null)
    );
    for state in trim["states"].as_array().expect("a list") {
        let residual = state["residual"].as_f64().expect("a number");
        assert!(residual.abs() < 1e-15, "{state}");
    }
    let checkpoint = trim["checkpoint"].as_str().expect("a path");
    let run = rig.run(&format!("--from {checkpoint} --link in-process"));
    assert_eq!(run.summary()["resumed"]["step"], 1);
    let (least, most) = range(&run, "truth.position_m", 1);
    assert_near(least, 0.05, 1e-13);
    assert_near(most, 0.05, 1e-13);
}

#[test]
fn a_held_position_gives_the_force_and_the_integral_of_the_law() {
    let rig = Rig::new();
    let always = ["--set", "stimuli[0].at_s=0"];
    let held = [
        SPRING_MASS,
        "--hold",
        "position_m=0.01",
        "--free",
        "force_n",
    ];
    let trim = trimmed(&rig, &[&held[..], &always].concat());
    // k x = 100 N/m 0.01 m; the integral times 2000 N/(m s) is all of the force.
    assert_near(value(&trim, "inputs", "force_n"), 1.0, 1e-12);
    let states = &trim["law"]["states"];
    assert_eq!(trim["law"]["refused"], Value::Null, "{trim}");
    assert_near(states[0]["value"].as_f64().expect("a number"), 5e-4, 1e-14);
    let checkpoint = trim["checkpoint"].as_str().expect("a path");
    let run = rig.run(&format!("--from {checkpoint} --link in-process"));
    let (least, most) = range(&run, "truth.position_m", 1);
    assert_near(least, 0.01, 1e-12);
    assert_near(most, 0.01, 1e-12);
    let described = fs::read_to_string(Path::new(checkpoint).join("checkpoint.json"));
    let described: Value = serde_json::from_str(&described.expect("a checkpoint")).expect("JSON");
    assert_eq!(
        described["check"]["text"],
        "not checked: its state is that of hil trim, not of the run"
    );
}

#[test]
fn a_law_that_leaves_the_equilibrium_is_named() {
    let rig = Rig::new();
    // Its reference is 0 at the point.
    let trim = trimmed(
        &rig,
        &[
            SPRING_MASS,
            "--hold",
            "position_m=0.01",
            "--free",
            "force_n",
        ],
    );
    assert_near(value(&trim, "inputs", "force_n"), 1.0, 1e-12);
    let reason = trim["law"]["refused"].as_str().expect("a reason");
    assert!(reason.contains("is off by"), "{reason}");
}

#[test]
fn what_stands_in_the_way_of_an_equilibrium_is_named() {
    let rig = Rig::new();
    let out = rig.path("none").display().to_string();
    let trim =
        |arguments: &[&str]| rig.hil(&[&["trim", SPRING_MASS, "--out", &out], arguments].concat());
    trim(&["--hold", "force_n=5", "position_m=0.02"])
        .expect(1)
        .says(&["no equilibrium", "--free", "`position_m`"]);
    trim(&["--hold", "velocity_mps=1", "--free", "force_n"])
        .expect(1)
        .says(&[
            "no equilibrium",
            "`position_m`",
            "hold fewer or other values",
        ]);
    assert!(!Path::new(&out).exists(), "nothing is left");
    for (arguments, words) in [
        (&["--hold", "force=5"][..], "did you mean force_n"),
        (&["--hold", "force_n"], "expected SIGNAL=VALUE"),
        (&["--hold", "force_n=inf"], "is not a number"),
        (
            &["--hold", "force_n=1", "--free", "force_n"],
            "both in --hold and in --free",
        ),
        (&["--free", "position_m"], "the plant has no such number"),
        (&["--at", "0"], "a checkpoint has a past"),
        (&["--at", "-1"], "--at -1 is too early"),
    ] {
        trim(arguments).expect(2).says(&[words]);
    }
}

#[test]
fn an_equilibrium_that_is_not_stable_is_found_and_named() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = compiled(&rig, "cc", "examples/c-plant/pendulum.c", "pendulum", &[]);
    let plant = plant.display().to_string();
    let scenario = "schema = 1\nname = \"up\"\n[run]\nduration_s = 0.1\nrate_hz = 1000\n[plant]\nmodel = \"pendulum\"\n[controller]\nlaw = \"hold\"\n";
    let scenario = rig.write("up.toml", scenario).display().to_string();
    let trim = trimmed(&rig, &[&scenario, "--plant-bin", &plant]);
    assert_near(value(&trim, "states", "angle_rad"), 0.0, 1e-12);
    assert_eq!(trim["is_stable"], false);
    // l a'' = g a - c a'/(m l): the upright pendulum falls with this rate.
    let (c, w) = (0.05 / 0.25, 9.80665 / 0.5);
    let fall = -c / 2.0 + libm::sqrt(c * c / 4.0 + w);
    let largest = trim["largest_eigenvalue"].as_f64().expect("a number");
    assert_near(largest, libm::exp(1e-3 * fall), 1e-9);
}

#[test]
fn an_equilibrium_in_large_units_is_found() {
    let rig = Rig::new();
    let large = [
        SPRING_MASS,
        "--hold",
        "position_m=0.02",
        "--free",
        "force_n",
        "--set",
        "plant.parameters.mass_kg=1e6",
        "--set",
        "plant.parameters.stiffness_n_per_m=1e9",
        "--set",
        "plant.parameters.damping_n_s_per_m=1e6",
    ];
    // F = k x
    assert_near(
        value(&trimmed(&rig, &large), "inputs", "force_n"),
        2e7,
        1e-6,
    );
}

#[test]
fn far_out_the_rounding_of_a_position_is_neither_a_motion_nor_an_integrator() {
    let rig = Rig::new();
    for far in ["1e8", "1e9"] {
        let held = format!("position_m={far}");
        let far_out = [SPRING_MASS, "--hold", &held, "--free", "force_n"];
        let trim = trimmed(&rig, &far_out);
        std::fs::remove_dir_all(rig.path("trimmed")).expect("it is there");
        // F = k x, and both modes decay with c / (2 m) = 1 per second.
        let force_n = value(&trim, "inputs", "force_n");
        assert!((force_n / (100.0 * far.parse::<f64>().expect("a number")) - 1.0).abs() < 1e-12);
        let largest = trim["largest_eigenvalue"].as_f64().expect("a number");
        assert_near(largest, libm::exp(-1e-3), 1e-9);
        assert_eq!(
            (&trim["is_stable"], &trim["undetermined"]),
            (&true.into(), &Value::Array(Vec::new()))
        );
        assert!(trim["later_residual"].as_f64() < Some(1e-9), "{trim}");
    }
}

#[test]
fn a_force_that_is_a_hundredth_off_is_no_equilibrium_however_slow_the_mass() {
    let rig = Rig::new();
    let slow = [
        "trim",
        SPRING_MASS,
        "--hold",
        "position_m=0.01",
        "force_n=1.01",
        "--set",
        "plant.parameters.mass_kg=1000",
        "--set",
        "run.rate_hz=20000",
    ];
    rig.hil(&slow).expect(1).says(&["no equilibrium"]);
}

#[test]
fn a_law_behind_an_actuator_is_not_said_to_hold_the_equilibrium() {
    let rig = Rig::new();
    let actuator = "\n[[actuators]]\nsignal = \"force_n\"\nrange = [-0.5, 0.5]\n";
    let scenario = rig.write("limited.toml", &(shipped(SPRING_MASS) + actuator));
    let scenario = scenario.to_str().expect("plain");
    let trim = trimmed(
        &rig,
        &[scenario, "--hold", "position_m=0.01", "--free", "force_n"],
    );
    let refused = trim["law"]["refused"].as_str().expect("a reason");
    assert!(refused.contains("[[actuators]]"), "{refused}");
}

#[test]
fn a_law_behind_a_biased_sensor_is_not_said_to_hold_the_equilibrium() {
    let rig = Rig::new();
    let bias = "\n[[faults]]\nkind = \"bias\"\nat_s = 0.1\n[[faults.effects]]\ntarget = \"measured.position_m\"\nbias = 0.002\n";
    let scenario = rig.write("biased.toml", &(shipped(SPRING_MASS) + bias));
    let scenario = scenario.to_str().expect("plain");
    let held = ["--hold", "position_m=0.01", "--free", "force_n"];
    let trim = trimmed(&rig, &[&[scenario, "--at", "1"], &held[..]].concat());
    let refused = trim["law"]["refused"].as_str().expect("a reason");
    let fault = "fault 1 (bias) acts on measured.position_m, between plant and law, with which";
    assert!(refused.contains(fault), "{refused}");
}

#[test]
fn an_equilibrium_beyond_a_limit_names_the_number_and_the_limit() {
    let rig = Rig::new();
    let more = "\n[plant.limits]\nposition_m = [-0.02, 0.02]\n\n[[sensors]]\nsignal = \"position_m\"\nrange = [-0.01, 0.01]\n";
    let scenario = rig.write("limited.toml", &(shipped(SPRING_MASS) + more));
    let scenario = scenario.to_str().expect("plain");
    let held = [scenario, "--hold", "position_m=0.03", "--free", "force_n"];
    let trim = trimmed(&rig, &held);
    let exceeded = trim["exceeded"].as_array().expect("a list");
    let kinds: Vec<_> = exceeded.iter().map(|one| &one["of"]).collect();
    assert_eq!(kinds, ["plant", "sensor"], "{trim}");
    assert_eq!(exceeded[0]["name"], "position_m");
    assert_eq!(exceeded[0]["max"], 0.02);
    // The run from there ends at the limit, as the text says.
    let checkpoint = trim["checkpoint"].as_str().expect("a path");
    let run = rig.run(&format!("--from {checkpoint} --link in-process"));
    run.expect(1).prints(&["outside -0.02 to 0.02 m"]);
    let out = rig.path("again").display().to_string();
    let text = rig.hil(&[&["trim"], &held[..], &["--out", &out]].concat());
    let text = text.expect(0).stdout;
    for line in [
        " m is outside -0.02 to 0.02 m: a run ends there",
        " m is outside -0.01 to 0.01 m: its sensor saturates there",
    ] {
        assert!(text.contains(line), "{text}");
    }
    let inside = [scenario, "--hold", "position_m=0.005", "--free", "force_n"];
    let out = rig.path("inside").display().to_string();
    let inside = rig.hil(&[&["trim"], &inside[..], &["--out", &out, "--json"]].concat());
    let inside: Value = serde_json::from_str(&inside.expect(0).stdout).expect("JSON");
    assert_eq!(inside["exceeded"], Value::Array(Vec::new()));
}

#[test]
fn what_the_scenario_still_changes_after_the_point_is_listed() {
    let rig = Rig::new();
    let more = r#"
[[faults]]
kind = "stiffness-loss"
at_s = 1.0
duration_s = 0.5
[[faults.effects]]
factor = 0.5

[[faults]]
kind = "push"
when = "truth.position_m > 0.5"
[[faults.effects]]
force_n = 1.0

[[changes]]
at_s = 2.0
set = { "plant.parameters.damping_n_s_per_m" = 3.0 }
"#;
    let scenario = rig.write("later.toml", &(shipped(SPRING_MASS) + more));
    let scenario = scenario.to_str().expect("plain");
    let at = |at_s: &str| {
        let out = rig.path(at_s).display().to_string();
        let trim = ["trim", scenario, "--at", at_s, "--out", &out, "--json"];
        let trim: Value = serde_json::from_str(&rig.hil(&trim).expect(0).stdout).expect("JSON");
        serde_json::from_value::<Vec<String>>(trim["still_to_come"].clone()).expect("a list")
    };
    let condition = "fault 2 (push) begins when truth.position_m > 0.5";
    let change = "change 1 of plant.parameters.damping_n_s_per_m begins at 2 s";
    let first = ["fault 1 (stiffness-loss) begins at 1 s", condition, change];
    assert_eq!(at("0.5"), first);
    let second = ["fault 1 (stiffness-loss) ends at 1.5 s", condition, change];
    assert_eq!(at("1.2"), second);
    assert_eq!(at("2.5"), [condition]);
}

#[test]
fn a_fault_whose_condition_has_held_is_not_still_to_come() {
    let rig = Rig::new();
    let push = |when: &str, more: &str| {
        let fault = format!(
            "\n[[faults]]\nkind = \"push\"\nwhen = \"{when}\"\n{more}[[faults.effects]]\nforce_n = 1.0\n"
        );
        let scenario = rig.write("pushed.toml", &(shipped(SPRING_MASS) + &fault));
        let scenario = scenario.to_str().expect("plain");
        let trim = trimmed(&rig, &[scenario, "--at", "0.4"]);
        std::fs::remove_dir_all(rig.path("trimmed")).expect("it is there");
        trim["still_to_come"].clone()
    };
    let always = "truth.position_m > -1";
    assert_eq!(push(always, ""), Value::Array(Vec::new()));
    // The first record decides, so the fault begins at step 1.
    let end = ["fault 1 (push) ends at 1.001 s"];
    assert_eq!(push(always, "duration_s = 1.0\n"), serde_json::json!(end));
    let never = "truth.position_m > 100";
    let begin = ["fault 1 (push) begins when truth.position_m > 100"];
    assert_eq!(push(never, ""), serde_json::json!(begin));
}

#[test]
fn a_list_in_front_of_the_scenario_leaves_the_scenario_alone() {
    let rig = Rig::new();
    for (place, words) in [
        &[
            "--hold",
            "position_m=0.01",
            "--free",
            "force_n",
            SPRING_MASS,
        ][..],
        &[
            "--free",
            "force_n",
            "--hold",
            "position_m=0.01",
            SPRING_MASS,
        ],
        &[
            "--free",
            "force_n",
            "--hold",
            "position_m=0.01",
            "velocity_mps=0",
            SPRING_MASS,
        ],
        &[
            "--hold",
            "position_m=0.01",
            SPRING_MASS,
            "--free",
            "force_n",
        ],
    ]
    .into_iter()
    .enumerate()
    {
        let out = rig.path(&place.to_string()).display().to_string();
        let trim = rig.hil(&[&["trim"], words, &["--out", &out, "--json"]].concat());
        let trim: Value = serde_json::from_str(&trim.expect(0).stdout).expect("JSON");
        assert_near(value(&trim, "inputs", "force_n"), 1.0, 1e-12);
    }
    let none = rig.hil(&["trim", "--free", "force_n"]);
    none.expect(2).says(&["the scenario is missing"]);
}
