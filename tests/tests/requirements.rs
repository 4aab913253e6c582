//! Requirements in whole runs: verdict, exit code, and the same results from the recording.

use controller_process::laws;
use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use hil_config::scenario::Scenario;
use plant_process::faults::kinds;
use plant_process::models;
use serde_json::{Value, json};
use shared_types::time::Step;

use crate::support::harness::{Rig, Run};
use crate::support::programs::{shipped, workspace};

const SHORT: &str = "tests/scenarios/leakage.toml";
const SPRING_MASS: &str = "scenarios/spring-mass.toml";

/// Requirements with every operator, over signals of every group. The leakage begins at 1 s.
const REQUIREMENTS: &str = r#"
[[requirements]]
name = "no-angle-beyond-its-stop"
formula = "always(abs(truth.surface_angle_rad) < 0.5)"

[[requirements]]
name = "healthy_force_fight"
formula = "always[0s,999ms](abs(truth.force_fight_n) < 150)"

[[requirements]]
name = "never-a-force-fight"
formula = "always(abs(truth.force_fight_n) < 1000)"

[[requirements]]
name = "commands"
formula = "always(abs(command.actuator1_valve_current_a) < 5 and internal.leakage_estimate1_m3ps_per_sqrt_pa >= 0)"

[[requirements]]
name = "calm-half"
formula = "eventually[0s,1.5s] always[0s,500ms](abs(tracking_error_rad) < 3e-4)"

[[requirements]]
name = "until-it-leaks"
formula = "abs(truth.force_fight_n) < 500 until[500ms,1.5s] parameter.actuator1.leakage_coefficient_m3ps_per_sqrt_pa > 1e-9"

[[requirements]]
name = "aftermath"
formula = "always(once[0s,100ms](rise(parameter.actuator1.leakage_coefficient_m3ps_per_sqrt_pa > 1e-9)) implies abs(truth.force_fight_n) < 20000)"

[[requirements]]
name = "since"
formula = "eventually[1.5s,1.5s](truth.force_fight_n < 1e6 since[0s,1s] sensed.surface_angle_rad > -1)"
"#;

fn with_requirements(rig: &Rig) -> String {
    let path = rig.write("required.toml", &(shipped(SHORT) + REQUIREMENTS));
    path.to_str().expect("plain").into()
}

/// Runs `hil judge --json`; returns its output and its exit code.
fn judge(rig: &Rig, run: &Run, more: &[&str]) -> (Value, Option<i32>) {
    let folder = run.folder.to_str().expect("plain");
    let judged = rig.hil(&[&["judge", folder, "--json"], more].concat());
    (judged.json(), judged.code)
}

#[test]
fn judging_a_recording_reproduces_the_verdicts_of_the_run_bit_by_bit() {
    let rig = Rig::new();
    let scenario = with_requirements(&rig);
    for link in ["iceoryx2", "in-process"] {
        let run = rig.run(&format!("{scenario} --link {link}")).expect(1);
        let summary = run.summary();
        assert_eq!(summary["verdict"], "fail");
        let (judged, code) = judge(&rig, &run, &[]);
        assert_eq!(code, Some(1));
        // Numbers in both are written with all their digits.
        for key in ["metrics", "requirements", "verdict", "scenario"] {
            assert_eq!(judged[key], summary[key], "{key}");
        }
        let requirements = summary["requirements"].as_array().expect("a list");
        assert_eq!(requirements.len(), 8);
        for one in requirements {
            let fails = one["name"] == "never-a-force-fight";
            let expected = if fails { "fail" } else { "pass" };
            assert_eq!(one["verdict"], expected, "{one}");
            assert!(one["robustness"].is_f64(), "{one}");
            assert!(
                one["decided_at_s"].is_f64() && one["at_s"].is_f64(),
                "{one}"
            );
        }
        // The leak at 1 s shows at once and decides; an `always` is decided at the end.
        let decided_at_s = |at: usize| requirements[at]["decided_at_s"].as_f64();
        assert_eq!(decided_at_s(0), Some(2.0));
        assert!(decided_at_s(2).is_some_and(|at_s| at_s > 1.0 && at_s < 1.5));
        let units: Vec<&str> = (requirements.iter().take(5))
            .map(|one| one["unit"].as_str().expect("text"))
            .collect();
        assert_eq!(units, ["rad", "N", "N", "", "rad"]);
    }
}

#[test]
fn a_recording_is_judged_by_the_requirements_of_another_scenario() {
    let rig = Rig::new();
    let scenario = with_requirements(&rig);
    let run = rig.run(&format!("{SHORT} --link in-process")).expect(0);
    assert_eq!(run.summary()["requirements"], json!([]));
    let (own, code) = judge(&rig, &run, &[]);
    assert_eq!((&own["verdict"], code), (&json!("pass"), Some(0)));
    let (other, code) = judge(&rig, &run, &["--requirements", &scenario]);
    assert_eq!((&other["verdict"], code), (&json!("fail"), Some(1)));
    assert_eq!(other["requirements"].as_array().map(Vec::len), Some(8));

    let folder = run.folder.to_str().expect("plain");
    let refuse = |scenario: &str, fragments: &[&str]| {
        let judged = rig.hil(&["judge", folder, "--requirements", scenario]);
        judged.expect(2).says(fragments);
    };
    refuse("no/such.toml", &["cannot read no/such.toml"]);
    // The other scenario runs for 20 s, this run for 2 s.
    refuse(
        "scenarios/severe-leakage.toml",
        &["does not fit the run", "the run ends at 2 s"],
    );
    refuse(SPRING_MASS, &["spring-mass"]);
    let text = std::fs::read_to_string(&scenario).expect("it was written");
    let slower = rig.write("slower.toml", &text.replace("= 10000", "= 5000"));
    refuse(
        slower.to_str().expect("plain"),
        &["at 5000 Hz but the run at 10000 Hz"],
    );
}

#[test]
fn a_failed_requirement_is_reported_with_its_formula_and_exit_code_1() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SPRING_MASS} --set controller.law=hold"));
    let run = run.expect(1).prints(&[
        "spring-mass: fail",
        "settles           FAIL",
        "always[4s,5s](abs(tracking_error_m) < 2e-4)",
    ]);
    // The mass stays where it is, 0.01 m from its target.
    let settles = &run.summary()["requirements"][0];
    let robustness = settles["robustness"].as_f64().expect("a number");
    assert!((robustness - (2e-4 - 0.01)).abs() < 1e-12, "{settles}");
    assert_eq!(settles["decided_at_s"], 4.0);
    let judged = rig.hil(&["judge", run.folder.to_str().expect("plain")]);
    judged.expect(1).prints(&["settles           FAIL"]);
}

#[test]
fn a_diverged_run_leaves_uncertain_requirements_undecided() {
    let rig = Rig::new();
    let limited = format!("{SPRING_MASS} --set plant.limits.position_m=[-1.0,0.009]");
    let run = rig.run(&limited).expect(1);
    let summary = run.summary();
    assert_eq!(summary["verdict"], "aborted");
    let settles = &summary["requirements"][0];
    assert_eq!(settles["verdict"], "undecided");
    assert_eq!(settles["robustness"], Value::Null);
    let (judged, code) = judge(&rig, &run, &[]);
    assert_eq!(code, Some(1));
    assert_eq!(judged["verdict"], "aborted");
    assert_eq!(judged["outcome"], "diverged");
    assert_eq!(judged["requirements"], summary["requirements"]);
}

/// Returns the plan of a modified scenario of the workspace, with the built-in laws and plants.
pub(crate) fn plan(scenario: &str, more: &str, changes: &[&str]) -> Plan {
    let plants = Vec::from_iter(models::all().into_iter().map(|plant| plant.description));
    let laws = Vec::from_iter(laws::all().into_iter().map(|law| law.description));
    let kinds = Vec::from_iter(kinds::all().into_iter().map(|kind| kind.description));
    let text = shipped(scenario) + more;
    let scenario = Scenario::parse(&text, workspace().join(scenario)).expect("TOML");
    let checked = scenario.set(changes).check(&plants, &laws, &kinds);
    checked.unwrap_or_else(|problems| panic!("{problems}"))
}

#[test]
fn judging_allocates_nothing() {
    let plan = plan(SHORT, REQUIREMENTS, &[]);
    let plants = models::all();
    let plant = plants
        .iter()
        .find(|plant| plant.description.name == "drhas");
    let laws = laws::all();
    let law = laws.iter().find(|law| law.description.name == "ftsc");
    let law = &law.expect("built in").description;
    let plant = &plant.expect("built in").description;
    let columns = Columns::of(plant, &plan.stimuli, &law.internals);
    let mut evaluation = Evaluation::new(&plan, &columns).expect("known names");
    let mut row = vec![0.0; columns.len()];
    let allocated = allocation_counter::measure(|| {
        for step in 0..=plan.run.steps {
            row.fill(1e-5 * (step % 777) as f64);
            evaluation.observe(Step(step), &row, []);
        }
    });
    assert_eq!(allocated.count_total, 0);
    let values = evaluation.requirements();
    assert!(values.iter().all(|value| value.robustness.is_some()));
}

/// Runs the teaching plant for 1 s, with a fault on one target from `at_s` to 0.6 s. Its requirements are easy:
/// only missing values fail them.
fn left_out(rig: &Rig, kind: &str, target: &str, at_s: f64) -> Run {
    let text = format!(
        r#"
schema = 1
run = {{duration_s = 1.0, rate_hz = 100}}
plant.model = "spring-mass"
controller.law = "pid"
[[stimuli]]
target = "position_m"
kind = "step"
after = 0.1
[[faults]]
kind = "{kind}"
at_s = {at_s}
end_s = 0.6
[[faults.effects]]
target = "{target}"
[[requirements]]
name = "measured"
formula = "always(abs(measured.position_m) < 1e6)"
[[requirements]]
name = "command"
formula = "always(abs(command.force_n) < 1e6)"
[[requirements]]
name = "applied"
formula = "always(abs(applied.force_n) < 1e6)"
[[metrics]]
name = "mean_m"
expression = "mean(measured.position_m)"
[[metrics]]
name = "mean_n"
expression = "mean(command.force_n)"
"#
    );
    let path = rig.write("left-out.toml", &text);
    rig.run(path.to_str().expect("plain"))
}

#[test]
fn values_removed_by_a_fault_fail_requirements_and_are_excluded_from_means() {
    let rig = Rig::new();
    let sensor = "measured.position_m";
    for (kind, target, at_s, failing, skipped) in [
        ("dropout", sensor, 0.2, "measured", [40, 1]),
        // A controller that never received a sample.
        ("message-loss", "link.sample", 0.0, "measured", [60, 1]),
        // The final record has none of the commands.
        ("dropout", "command.force_n", 0.2, "command", [0, 41]),
        ("message-loss", "link.command", 0.0, "command", [0, 61]),
        // Late and wrong values exist.
        ("message-loss", "link.sample", 0.2, "", [0, 1]),
        ("stuck", sensor, 0.2, "", [0, 1]),
    ] {
        let run = left_out(&rig, kind, target, at_s).expect(i32::from(!failing.is_empty()));
        let summary = run.summary();
        for one in summary["requirements"].as_array().expect("a list") {
            let fails = one["name"] == failing;
            let expected = if fails { "fail" } else { "pass" };
            assert_eq!(one["verdict"], expected, "{kind} on {target}: {one}");
            // Minus infinity is not a JSON number.
            assert_eq!(one["robustness"].is_null(), fails, "{one}");
            let first_s = if fails { at_s } else { 0.0 };
            assert!(one["at_s"].as_f64() >= Some(first_s), "{one}");
        }
        let metrics = summary["metrics"].as_array().expect("a list");
        let entries: Vec<u64> = metrics
            .iter()
            .map(|one| one["skipped"].as_u64().unwrap_or(0))
            .collect();
        assert_eq!(entries, skipped, "{kind} on {target}");
        let (judged, _) = judge(&rig, &run, &[]);
        for key in ["metrics", "requirements", "verdict"] {
            assert_eq!(judged[key], summary[key], "{kind} on {target}: {key}");
        }
    }
}

#[test]
fn validity_is_a_requirement_by_itself() {
    let rig = Rig::new();
    let text = r#"
[[faults]]
kind = "dropout"
at_s = 1.0
duration_s = 0.1
[[faults.effects]]
target = "measured.position_m"

[[requirements]]
name = "alone"
formula = "always(valid(measured.position_m))"
[[requirements]]
name = "compared"
formula = "always(valid(measured.position_m) > 0.5)"
[[requirements]]
name = "lately"
formula = "always once[0s,150ms] valid(measured.position_m)"
[[requirements]]
name = "lost"
formula = "eventually(not valid(measured.position_m) and valid(measured.velocity_mps))"
"#;
    let scenario = rig.write("dropout.toml", &(shipped(SPRING_MASS) + text));
    let scenario = scenario.to_str().expect("plain");
    let run = rig.run(&format!("{scenario} --link in-process")).expect(1);
    let summary = run.summary();
    let all = summary["requirements"].as_array().expect("a list");
    let of = |name: &str| {
        let one = all.iter().find(|one| one["name"] == name);
        let one = one.expect("it is there");
        [&one["verdict"], &one["robustness"], &one["at_s"]].map(Value::clone)
    };
    assert_eq!(of("alone"), [json!("fail"), json!(-0.5), json!(1.0)]);
    assert_eq!(of("alone"), of("compared"));
    assert_eq!(of("lately")[0], "pass");
    assert_eq!(of("lost")[0], "pass");
}
