//! Valid faults and their meaning.

use std::fs;

use hil_config::plan::{
    Condition, FaultAction, FaultEffect, FaultEnd, FaultEvent, Move, Profile, Trigger,
};
use hil_config::scenario::Scenario;
use shared_types::describe::{Operation, Settings};
use shared_types::time::Step;

use crate::descriptions::{self, Checked};
use crate::{base_with_faults, only, plan};

pub(crate) const EFFECT: &str =
    "effects = [{ target = \"measured.surface_angle_rad\", bias = 0.1 }]";

fn settings(values: &[(&str, f64)]) -> Settings {
    let mut settings = Settings::default();
    for (name, value) in values {
        settings.set(name, *value);
    }
    settings
}

/// Returns the events of the base with these faults.
pub(crate) fn faults(text: &str) -> Vec<FaultEvent> {
    plan(&base_with_faults(text)).faults
}

/// Returns the first event with these keys.
pub(crate) fn event(keys: &str) -> FaultEvent {
    let other = format!("[[faults]]\nname = \"other\"\nkind = \"bias\"\nat_s = 0.1\n{EFFECT}\n");
    faults(&format!(
        "[[faults]]\nkind = \"bias\"\n{keys}\n{EFFECT}\n{other}"
    ))
    .remove(0)
}

/// Returns the only effect of an event of this kind at 0.5 s.
fn effect(kind: &str, keys: &str) -> FaultEffect {
    let text = format!("[[faults]]\nkind = \"{kind}\"\nat_s = 0.5\n[[faults.effects]]\n{keys}");
    faults(&text).remove(0).effects.remove(0)
}

fn condition(expression: &str, records: u64) -> Condition {
    Condition {
        expression: expression.into(),
        records,
    }
}

#[test]
fn an_event_takes_effect_at_its_trigger() {
    let step = |step, at_s| Trigger::Step {
        step: Step(step),
        at_s,
    };
    let after = |delay_steps| Trigger::After {
        event: 2,
        delay_steps,
    };
    let when = |records| Trigger::Condition(condition("large", records));
    for (keys, expected) in [
        ("at_s = 0.0001", step(1, 0.0001)),
        ("at_step = 1999", step(1999, 1.999)),
        ("when = \"large\"", when(1)),
        ("when = \"large\"\nfor_s = 0", when(1)),
        ("when = \"large\"\nfor_s = 0.0011", when(2)),
        ("when = \"large\"\nfor_s = 1.999", when(1999)),
        ("after = \"other\"", after(0)),
        ("after = 2\ndelay_s = 0.25", after(250)),
        ("after = \"other\"\ndelay_steps = 7", after(7)),
    ] {
        assert_eq!(event(keys).trigger, expected, "{keys}");
    }
}

#[test]
fn an_event_ends_at_its_first_end() {
    for (keys, expected) in [
        ("", FaultEnd::default()),
        (
            "duration_s = 0.0011",
            FaultEnd {
                after_steps: Some(2),
                ..FaultEnd::default()
            },
        ),
        (
            // Longer than the run: it stays.
            "duration_s = 1e15",
            FaultEnd {
                after_steps: Some(1 << 40),
                ..FaultEnd::default()
            },
        ),
        (
            "end_s = 2",
            FaultEnd {
                step: Some(Step(2000)),
                ..FaultEnd::default()
            },
        ),
        (
            "duration_steps = 9\nend_step = 501\noccurrences = 3\nuntil = \"not large\"\nuntil_for_s = 0.01",
            FaultEnd {
                step: Some(Step(501)),
                after_steps: Some(9),
                occurrences: Some(3),
                condition: Some(condition("not large", 10)),
            },
        ),
    ] {
        assert_eq!(
            event(&format!("at_s = 0.5\n{keys}")).end,
            expected,
            "{keys}"
        );
    }
}

#[test]
fn conditions_may_name_everything_in_a_record() {
    for name in [
        "truth.force_fight_n",
        "measured.surface_angle_rad",
        "reference.surface_angle_d2_radps2",
        "command.actuator1_valve_current_a",
        "applied.actuator1_valve_current_a",
        "internal.fault_detected",
        "sensed.surface_angle_rad",
        "stimulus.load_n",
        "parameter.actuator1.bulk_modulus_pa",
        "error_rad",
    ] {
        let expected = Trigger::Condition(condition(name, 1));
        assert_eq!(event(&format!("when = \"{name}\"")).trigger, expected);
    }
}

#[test]
fn a_kind_acts_on_every_target_of_its_class() {
    for (kind, keys, targets) in [
        (
            "bias",
            "bias = 1",
            &[
                "measured.surface_angle_rad",
                "reference.load_n",
                "reference.surface_angle_d5_radps5",
                "command.actuator2_valve_current_a",
                "parameter.actuator2.bulk_modulus_pa",
            ][..],
        ),
        ("dropout", "", &["command.actuator1_valve_current_a"]),
        ("message-loss", "", &["link.sample", "link.command"]),
        ("late", "busy_us = 1", &["controller", "plant"]),
        ("skip", "steps = 1", &["controller"]),
    ] {
        for target in targets {
            let effect = effect(kind, &format!("target = \"{target}\"\n{keys}"));
            assert_eq!(effect.target, *target);
        }
    }
}

#[test]
fn omitted_parameters_of_a_kind_have_their_defaults() {
    let action = |parameters: &[(&str, f64)], list: &[f64]| FaultAction::Kind {
        parameters: settings(parameters),
        list: list.to_vec(),
    };
    for (kind, keys, expected) in [
        (
            "message-loss",
            "target = \"link.sample\"",
            action(&[("probability", 1.0)], &[]),
        ),
        (
            "message-loss",
            "target = \"link.sample\"\nprobability = 0.5\npattern = [1, 0, 1]",
            action(&[("probability", 0.5)], &[1.0, 0.0, 1.0]),
        ),
        (
            "late",
            "target = \"plant\"\nbusy_us = 20\nhistogram = [[10, 1], [20.5, 3]]",
            action(
                &[("busy_us", 20.0), ("spread_us", 0.0)],
                &[10.0, 1.0, 20.5, 3.0],
            ),
        ),
    ] {
        assert_eq!(effect(kind, keys).action, expected, "{keys}");
    }
}

#[test]
fn a_fault_of_the_plant_moves_all_its_parameters() {
    let expected = FaultEffect {
        target: "actuator2".into(),
        skew_steps: 0,
        profile: Profile::Step,
        action: FaultAction::Move {
            sizes: settings(&[("factor", 0.5)]),
            moves: vec![
                Move {
                    parameter: "actuator2.leakage_coefficient_m3ps_per_sqrt_pa".into(),
                    operation: Operation::Set,
                    by: 1e-3,
                },
                Move {
                    parameter: "actuator2.bulk_modulus_pa".into(),
                    operation: Operation::Scale,
                    by: 0.5,
                },
            ],
        },
    };
    assert_eq!(effect("burst", "actuator = 2"), expected);
}

/// A scenario of the teaching plant, whose fault has no selector.
fn softening(change: &str) -> String {
    format!(
        "schema = 1\nrun = {{ duration_s = 1, rate_hz = 100 }}\nplant.model = \"spring-mass\"\n\
         controller.law = \"hold\"\n[[faults]]\nkind = \"softening\"\nat_s = 0.5\n\
         effects = [{{ change_n_per_m = {change} }}]"
    )
}

#[test]
fn a_fault_without_a_selector_acts_on_the_plant() {
    let effect = plan(&softening("-40")).faults.remove(0).effects.remove(0);
    assert_eq!(effect.target, "plant");
    let moves = vec![Move {
        parameter: "stiffness_n_per_m".into(),
        operation: Operation::Add,
        by: -40.0,
    }];
    let sizes = settings(&[("change_n_per_m", -40.0)]);
    assert_eq!(effect.action, FaultAction::Move { sizes, moves });
    let text = only(crate::problems(&softening("-101"))).to_string();
    assert!(
        text.contains("`stiffness_n_per_m` would become 100 + -101 = -1"),
        "{text}"
    );
}

#[test]
fn a_fault_on_parameters_that_are_not_faultable_is_refused() {
    let mut plants = descriptions::plants();
    for field in &mut plants[1].parameters {
        field.faultable = false;
    }
    let problems = crate::parse(&softening("1"))
        .and_then(|scenario| scenario.check(&plants, &descriptions::laws(), &[]))
        .expect_err("not faultable");
    assert_eq!(problems.0.len(), 1, "{problems}");
    assert!(
        problems.to_string().contains("changes `stiffness_n_per_m`"),
        "{problems}"
    );
}

#[test]
fn a_profile_replaces_that_of_the_plants_fault() {
    let leak = "actuator = 1\ncoefficient_m3ps_per_sqrt_pa = 1e-7\n";
    #[rustfmt::skip] // a table
    let cases = [
        ("speed_per_s = 3", Profile::Exponential { speed_per_s: 3.0 }),
        ("profile = { kind = \"step\" }", Profile::Step),
        ("profile = { kind = \"ramp\", duration_s = 2 }", Profile::Ramp { duration_s: 2.0 }),
        ("profile = { kind = \"exponential\", speed_per_s = 4 }", Profile::Exponential { speed_per_s: 4.0 }),
        ("profile = { kind = \"pulse\", duration_s = 0.5 }", Profile::Pulse { duration_s: 0.5 }),
        ("profile = { kind = \"intermittent\", period_s = 0.5, duty = 0.25 }", Profile::Intermittent { period_s: 0.5, duty: 0.25 }),
        (
            "profile = { kind = \"table\", time_s = [0, 1], values = [0, 1] }",
            Profile::Table {
                time_s: vec![0.0, 1.0],
                values: vec![0.0, 1.0],
            },
        ),
    ];
    for (keys, expected) in cases {
        assert_eq!(
            effect("leakage", &format!("{leak}{keys}")).profile,
            expected
        );
    }
    // A sine would fall below the healthy 0, so a signal is the target.
    let sine = "target = \"reference.load_n\"\nprofile = { kind = \"sine\", frequency_hz = 2 }";
    let expected = Profile::Sine {
        frequency_hz: 2.0,
        phase_rad: 0.0,
    };
    assert_eq!(effect("dropout", sine).profile, expected);
}

#[test]
fn a_skew_counts_from_the_requested_time() {
    for (trigger, skew, expected) in [
        ("at_s = 0.0005", "skew_s = 0.0005", 0), // 1 ms is step 1, as is 0.5 ms
        ("at_s = 0.0005", "skew_s = 0.0006", 1),
        ("at_step = 1", "skew_s = 0.0006", 1),
        ("at_s = 0.5", "skew_steps = 3", 3),
        ("when = \"large\"", "skew_s = 0.0011", 2),
    ] {
        let text = format!(
            "[[faults]]\nkind = \"dropout\"\n{trigger}\n\
             effects = [{{ target = \"reference.load_n\", {skew} }}]"
        );
        let actual = faults(&text)[0].effects[0].skew_steps;
        assert_eq!(actual, expected, "{trigger}, {skew}");
    }
}

#[test]
fn numbers_can_come_from_a_file_beside_the_scenario() {
    let read = |effect: &str, csv: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("x.csv"), csv).expect("a file");
        let path = folder.path().join("base.toml");
        let text = format!(
            "[[faults]]\nkind = \"late\"\nat_s = 0.5\n[[faults.effects]]\ntarget = \"plant\"\nbusy_us = 1\n{effect}"
        );
        fs::write(&path, base_with_faults(&text)).expect("a file");
        let scenario = Scenario::read(&path).expect("TOML");
        let plan = scenario.checked();
        plan.map(|mut plan| plan.faults.remove(0).effects.remove(0))
            .map_err(|problems| problems.to_string())
    };
    let histogram = "histogram = { file = \"x.csv\" }";
    for csv in ["busy_us,weight\n10,1\n\n# late\n20.5, 3\n", "10,1\n20.5,3"] {
        let FaultAction::Kind { list, .. } = read(histogram, csv).expect(csv).action else {
            panic!("a kind");
        };
        assert_eq!(list, [10.0, 1.0, 20.5, 3.0]);
    }
    for (csv, piece) in [
        ("busy_us,weight\n", "the file has no rows"),
        ("10,1\nbusy_us,weight\n", "x.csv:2:1"),
        ("10,1,2\n", "2 numbers separated by commas"),
        ("10,nan\n", "not a row"),
    ] {
        let problem = read(histogram, csv).expect_err(csv);
        assert!(problem.contains(piece), "{problem}");
    }
    let misspelt = "histogram = { file = \"x.csv\", fill = 1 }";
    let problem = read(misspelt, "10,1").expect_err("no such key");
    assert!(problem.contains("unknown key `fill` in `faults[0].effects[0].histogram`"));
    let profile = "profile = { kind = \"table\", file = \"x.csv\" }";
    let expected = Profile::Table {
        time_s: vec![0.0, 1.0],
        values: vec![0.5, 1.0],
    };
    let course = read(profile, "time_s,value\n0,0.5\n1,1").expect("points");
    assert_eq!(course.profile, expected);
}
