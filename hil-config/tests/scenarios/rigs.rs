//! Plants behind a port: no truth, real time only, limits and safe commands of the port.

use std::path::Path;

use hil_config::plan::Plan;
use hil_config::port::Port;
use hil_config::problem::Problem;
use hil_config::scenario::Scenario;
use shared_types::describe::{LawDescription, PlantDescription, PortPlant};
use shared_types::table::Field;

const RIG: &str = r#"schema = 1

[run]
duration_s = 1.0
rate_hz = 100
clock = "realtime"

[plant]
model = "rig"

[plant.limits]
position_m = [-0.5, 0.5]

[controller]
law = "any"

[[requirements]]
name = "near"
formula = "always measured.position_m < 0.4"
"#;

fn plant() -> PlantDescription {
    let safe_force = Field {
        default: Some(-2.0),
        ..Field::signal("force_n", "N", "Force.")
    };
    PlantDescription {
        name: "rig".into(),
        summary: "A rig.".into(),
        parameters: Vec::new(),
        truth: Vec::new(),
        measured: vec![Field::signal("position_m", "m", "Position.")],
        commands: vec![safe_force],
        faults: Vec::new(),
        saves: false,
        state: None,
        port: Some(PortPlant::default()),
    }
}

fn law() -> LawDescription {
    LawDescription {
        name: "any".into(),
        summary: "A law.".into(),
        plants: Vec::new(),
        parameters: Vec::new(),
        model: Vec::new(),
        measured: vec![Field::signal("position_m", "m", "Position.")],
        reference: Vec::new(),
        commands: None,
        internals: Vec::new(),
        saves: false,
        state: None,
        tuning: String::new(),
    }
}

fn checked(text: &str) -> Result<Plan, Vec<Problem>> {
    let scenario = Scenario::parse(text, "rig.toml").expect("TOML");
    scenario
        .check(&[plant()], &[law()], &[])
        .map_err(|problems| problems.0)
}

/// Returns the only problem of a scenario as text.
fn problem(text: &str) -> String {
    let problems = checked(text).expect_err("refused");
    assert_eq!(problems.len(), 1, "{problems:?}");
    problems[0].to_string()
}

#[test]
fn a_rig_has_limits_of_its_readings_and_safe_commands_of_its_port() {
    let plan = checked(RIG).expect("legal");
    let [limit] = plan.plant.limits.as_slice() else {
        panic!("{:?}", plan.plant.limits);
    };
    assert_eq!(
        (limit.signal.as_str(), limit.min, limit.max),
        ("position_m", -0.5, 0.5)
    );
    assert_eq!(plan.plant.safe_command.get("force_n"), Some(-2.0));
    let own = format!("{RIG}\n[plant.safe_command]\nforce_n = 1.0\n");
    let plan = checked(&own).expect("legal");
    assert_eq!(plan.plant.safe_command.get("force_n"), Some(1.0));
}

#[test]
fn a_rig_runs_in_real_time_only() {
    for clock in ["lockstep", "paced"] {
        let text = problem(&RIG.replace("realtime", clock));
        for part in [clock, "behind a port", "clock = \"realtime\""] {
            assert!(text.contains(part), "{text}");
        }
    }
    let text = problem(&RIG.replace("clock = \"realtime\"\n", ""));
    assert!(text.contains("--clock realtime"), "{text}");
}

#[test]
fn the_truth_of_a_rig_is_refused_with_the_measured_signal_to_ask_for() {
    let truth = "truth.position_m";
    let with = |more: &str| format!("{RIG}\n{more}\n");
    for text in [
        RIG.replace("measured.position_m", truth),
        with("[[derived]]\nname = \"d\"\nexpression = \"2 * truth.position_m\""),
        with("[[metrics]]\nname = \"m\"\nexpression = \"max(truth.position_m)\""),
    ] {
        let problem = problem(&text);
        assert!(problem.contains("no truth"), "{text}\n{problem}");
        assert!(problem.contains(truth), "{problem}");
        assert!(problem.contains("measured.position_m"), "{problem}");
    }
    for text in [
        with("[[plots]]\ntitle = \"p\"\nsignals = [\"truth.position_m\"]"),
        with("[panel]\nreadings = [\"truth.position_m\"]"),
    ] {
        let problem = problem(&text);
        assert!(problem.contains(truth), "{problem}");
        assert!(problem.contains("measured.position_m"), "{problem}");
    }
}

#[test]
fn a_limit_of_an_unknown_reading_is_refused_with_the_nearest() {
    let text = problem(&RIG.replace("\nposition_m =", "\npositon_m ="));
    assert!(text.contains("no measured signal `positon_m`"), "{text}");
    assert!(text.contains("`position_m`"), "{text}");
}

const PORT: &str = r#"port = 1
name = "rig"
watchdog = "/dev/watchdog"

[[frames]]
name = "state"
carries = "sample"
fields = [{ signal = "measured.position_m", type = "f64" }]

[[frames]]
name = "drive"
carries = "command"
fields = [
    { signal = "command.force_n", type = "i16", unit = "kN", scale = 0.001, safe = -0.002 },
    { signal = "command.valve", type = "u8", safe = 3 },
]
"#;

fn port(text: &str) -> Result<Port, Vec<Problem>> {
    Port::parse(text, Path::new("rig.port.toml"), None).map_err(|problems| problems.0)
}

#[test]
fn safe_values_are_converted_from_the_unit_of_the_wire() {
    let port = port(PORT).expect("legal");
    assert_eq!(port.safe_row(), Ok(vec![-2.0, 3.0]));
    assert_eq!(port.safety.repeats, 5);
    assert_eq!(port.safety.watchdog.as_deref(), Some("/dev/watchdog"));
}

#[test]
fn commands_without_a_safe_value_are_named() {
    let text = PORT.replace(", safe = 3", "");
    let missing = port(&text).expect("legal").safe_row().expect_err("refused");
    assert!(missing.contains("`command.valve`"), "{missing}");
    assert!(!missing.contains("force_n"), "{missing}");
}

#[test]
fn safe_values_beyond_the_range_or_of_samples_are_refused() {
    for (text, part) in [
        (PORT.replace("safe = 3", "safe = 256"), "0 to 255"),
        (
            PORT.replace("type = \"f64\"", "type = \"f64\", safe = 0"),
            "carries a sample",
        ),
    ] {
        let problems = port(&text).expect_err("refused");
        assert_eq!(problems.len(), 1, "{problems:?}");
        assert!(problems[0].to_string().contains(part), "{}", problems[0]);
    }
}
