//! Runs full of activity: faults that wait, act or are in transition continue across any checkpoint.

use shared_types::random::RandomStream;

use super::assert_goes_on;
use crate::support::harness::Rig;

pub(super) const MOVING: &str = r#"
schema = 1
name = "moving"
[run]
duration_s = 1.0
rate_hz = 1000
seed = 7
[plant]
model = "spring-mass"
[[stimuli]]
target = "position_m"
kind = "sine"
amplitude = 0.01
frequency_hz = 2
"#;

/// Keys of the controller and faults that make it move.
const CASES: [(&str, &str, &str); 13] = [
    ("a slow law", "rate_hz = 500", ""),
    ("a late command", "command_delay_steps = 1", ""),
    (
        "a slow law and a late command",
        "rate_hz = 200\ncommand_delay_steps = 1",
        "",
    ),
    (
        "conditions that must hold for a while",
        "",
        r#"
        { kind = "stuck", when = "truth.position_m > 0.003", for_s = 0.05, until = "truth.velocity_mps < 0", until_for_s = 0.07, effects = [{ target = "measured.velocity_mps" }] },
        "#,
    ),
    (
        "one that follows another, and effects with a skew",
        "",
        r#"
        { name = "first", kind = "bias", at_s = 0.2, effects = [{ target = "measured.position_m", bias = 1e-3 }, { target = "command.force_n", bias = 0.1, skew_s = 0.3 }] },
        { kind = "scale", after = "first", delay_s = 0.25, duration_s = 0.2, effects = [{ target = "reference.position_m", factor = 1.5, profile = { kind = "ramp", duration_s = 0.1 } }] },
        "#,
    ),
    (
        "faults that end after they acted often enough",
        "",
        r#"
        { kind = "spike", at_s = 0.1, occurrences = 3, effects = [{ target = "measured.position_m", amplitude = 0.01, period_s = 0.2, width_s = 0.05 }] },
        { kind = "message-loss", at_s = 0.1, occurrences = 100, effects = [{ target = "link.sample", probability = 0.3 }] },
        "#,
    ),
    (
        "messages under way in both directions",
        "",
        r#"
        { kind = "message-delay", at_s = 0.1, effects = [{ target = "link.sample", steps = 30, profile = { kind = "sine", frequency_hz = 3 } }] },
        { kind = "dropout", at_s = 0.1, effects = [{ target = "measured.velocity_mps", profile = { kind = "intermittent", period_s = 0.01, duty = 0.5 } }] },
        { kind = "message-jitter", at_s = 0.2, effects = [{ target = "link.sample", steps = 20 }] },
        { kind = "message-reordering", at_s = 0.15, effects = [{ target = "link.command", probability = 0.5 }] },
        { kind = "message-duplication", at_s = 0.25, effects = [{ target = "link.command", probability = 0.5, lag_steps = 25 }] },
        { kind = "message-corruption", at_s = 0.3, effects = [{ target = "link.command", probability = 0.2, bits = 3 }] },
        "#,
    ),
    (
        "a medium that was late and is not any more",
        "",
        r#"
        { kind = "message-delay", at_s = 0.1, duration_s = 0.15, effects = [{ target = "link.sample", steps = 60 }] },
        { kind = "message-loss", at_s = 0.12, duration_s = 0.3, effects = [{ target = "link.sample", pattern = [0, 1, 1] }] },
        "#,
    ),
    (
        "a controller that misses steps and takes its time",
        "command_delay_steps = 1",
        r#"
        { kind = "skip", at_s = 0.1, effects = [{ target = "controller", steps = 23, burst = 2, period_steps = 60 }] },
        { kind = "late", at_s = 0.2, effects = [{ target = "controller", busy_us = 1, spread_us = 3 }] },
        "#,
    ),
    (
        "numbers that stand still, come late and come back",
        "",
        r#"
        { kind = "stuck", at_s = 0.1, effects = [{ target = "measured.position_m", profile = { kind = "intermittent", period_s = 0.2, duty = 0.6 } }] },
        { kind = "delay", at_s = 0.15, effects = [{ target = "measured.velocity_mps", steps = 90 }] },
        { kind = "dropout", at_s = 0.2, effects = [{ target = "command.force_n", profile = { kind = "intermittent", period_s = 0.3, duty = 0.5 } }] },
        "#,
    ),
    (
        "signals that are not valid",
        "",
        r#"
        { kind = "dropout", at_s = 0.1, effects = [{ target = "measured.position_m", profile = { kind = "intermittent", period_s = 0.16, duty = 0.5 } }] },
        "#,
    ),
    (
        "noise, twice on one signal",
        "",
        r#"
        { kind = "noise", at_s = 0.1, effects = [{ target = "measured.position_m", standard_deviation = 1e-4 }, { target = "measured.position_m", standard_deviation = 1e-5 }] },
        "#,
    ),
    (
        "parameters that move and heal",
        "",
        r#"
        { kind = "stiffness-loss", at_s = 0.1, duration_s = 0.5, effects = [{ factor = 0.5, profile = { kind = "ramp", duration_s = 0.3 } }] },
        { kind = "noise", at_s = 0.3, effects = [{ target = "parameter.disturbance_n", standard_deviation = 0.1 }] },
        "#,
    ),
];

/// Returns the scenario of a case.
fn moving(controller: &str, faults: &str) -> String {
    format!("faults = [{faults}]\n{MOVING}\n[controller]\nlaw = \"pid\"\n{controller}\n")
}

#[test]
fn waiting_active_and_changing_faults_continue_after_a_checkpoint() {
    for (about, controller, faults) in CASES {
        let rig = Rig::new();
        let path = rig.write("moving.toml", &moving(controller, faults));
        let times_s = [0.1, 0.101, 0.157, 0.208, 0.26, 0.333, 0.471, 0.62, 0.803];
        assert_goes_on(&rig, &path.display().to_string(), &times_s, about);
    }
}

#[test]
fn a_run_can_be_resumed_from_any_step() {
    let rig = Rig::new();
    let all: String = CASES.iter().map(|(.., faults)| *faults).collect();
    let path = rig.write(
        "moving.toml",
        &moving("rate_hz = 500\ncommand_delay_steps = 1", &all),
    );
    let mut random = RandomStream::new(1, "checkpoints");
    let times_s: Vec<f64> = (0..30).map(|_| 1e-3 + 0.998 * random.uniform()).collect();
    let mut steps: Vec<u64> = times_s
        .iter()
        .map(|at_s| (at_s * 1e3).ceil() as u64)
        .collect();
    steps.sort_unstable();
    steps.dedup();
    let times_s: Vec<f64> = steps.iter().map(|step| *step as f64 / 1e3).collect();
    assert_goes_on(
        &rig,
        &path.display().to_string(),
        &times_s,
        "all faults at once",
    );
}
