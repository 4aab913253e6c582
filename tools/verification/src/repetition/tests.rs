use hil_config::plan::{FaultAction, FaultEffect, FaultSource, Plan, Profile};
use hil_facts::programs::checked::checked;
use shared_types::describe::Settings;
use shared_types::record::{FaultAccepted, Outcome, RunEnd};

use super::*;
use crate::fixture::{Content, layout, record, recorded};
use crate::rig::{SCENARIO, attachments};

const FAULTS: &str = r#"
[[faults]] # 1: cleared before it takes effect
kind = "bias"
at_s = 0.05
effects = [{ target = "measured.surface_angle_rad", bias = 1.0 }]

[[faults]] # 2: follows that one
kind = "bias"
after = 1
effects = [{ target = "measured.surface_angle_rad", bias = 2.0 }]

[[faults]] # 3: cleared while it acts
kind = "bias"
at_s = 0.01
effects = [{ target = "measured.surface_angle_rad", bias = 3.0 }]

[[faults]] # 4: left alone, follows that one
kind = "bias"
after = 3
effects = [{ target = "measured.surface_angle_rad", bias = 4.0 }]
"#;

fn live(id: u32, trigger: Trigger, skews: &[u64], end: FaultEnd) -> FaultEvent {
    let effect = |skew_steps: &u64| FaultEffect {
        target: "measured.surface_angle_rad".into(),
        skew_steps: *skew_steps,
        profile: Profile::Ramp { duration_s: 0.01 },
        action: FaultAction::Kind {
            parameters: {
                let mut parameters = Settings::default();
                parameters.set("bias", f64::from(id));
                parameters
            },
            list: Vec::new(),
        },
    };
    FaultEvent {
        id,
        name: None,
        kind: "bias".into(),
        source: FaultSource::Cli,
        trigger,
        end,
        effects: skews.iter().map(effect).collect(),
    }
}

fn condition() -> Condition {
    Condition {
        expression: "measured.surface_angle_rad > 1".into(),
        records: 3,
    }
}

fn accepted(step: u64, fault: &FaultEvent) -> Event {
    Event::Accepted(FaultAccepted {
        id: fault.id,
        step,
        fault: serde_json::to_value(fault).expect("JSON"),
    })
}

fn took_hold(id: u32, effect: u32, step: u64) -> Event {
    Event::Fault(FaultBegun {
        id,
        effect,
        step,
        kind: "bias".into(),
        target: "measured.surface_angle_rad".into(),
        parameter: "surface_angle_rad".into(),
        canonical: String::new(),
        wall_only: false,
    })
}

const fn ended(id: u32, effect: u32, step: u64, cleared: bool) -> Event {
    Event::FaultEnded(FaultEnded {
        id,
        effect,
        step,
        cleared,
    })
}

/// Plans a scenario for the programs of a run.
fn again(run: &RecordedScenario, text: &str) -> Plan {
    let programs = &run.recorded;
    let plan = checked(
        text,
        Path::new("x"),
        &programs.plant_program,
        &programs.controller_program,
    );
    plan.expect("a plan")
}

/// Records a run of the scenario with these events.
fn run(events: Vec<Event>) -> Result<RecordedScenario, Failure> {
    let attachments = attachments(format!("{SCENARIO}{FAULTS}"));
    let end = Event::End(RunEnd::new(1, Outcome::Completed));
    let mut contents = vec![Content::Record(record(0, 0.0, 0.0))];
    contents.extend(events.into_iter().chain([end]).map(Content::Event));
    let folder = recorded(&layout(), &contents, attachments);
    RecordedScenario::read(&folder)
}

#[test]
fn live_faults_become_scenario_faults_at_the_steps_at_which_they_took_hold() {
    let now = live(5, Trigger::Now, &[0, 4], FaultEnd::default());
    let never = live(
        6,
        Trigger::Condition(condition()),
        &[0],
        FaultEnd::default(),
    );
    let times = FaultEnd {
        occurrences: Some(2),
        ..FaultEnd::default()
    };
    let late = live(7, Trigger::Condition(condition()), &[2, 0], times.clone());
    let run = run(vec![
        took_hold(3, 0, 10),
        accepted(20, &now),
        took_hold(5, 0, 21),
        took_hold(5, 1, 25),
        ended(3, 0, 30, true),
        accepted(31, &never),
        accepted(32, &late),
        ended(5, 0, 40, true),
        ended(5, 1, 40, true),
        took_hold(7, 1, 60),
        took_hold(7, 0, 62),
        ended(7, 1, 70, false),
        ended(7, 0, 75, false),
        ended(1, 0, 45, true),
    ])
    .expect("a run");
    let text = run.scenario().expect("a scenario");
    for comment in [
        "# Fault 1 of the scenario, `bias`, is left out because ",
        "# Fault 2 of the scenario, `bias`, is left out because ",
        "# Live fault 5, requested before step 20 (0.02 s): at once.",
        "# Live fault 6, requested before step 31 (0.031 s): when `measured.surface_angle_rad > 1` has held for 3 steps; it never took effect.",
        "# Live fault 7, requested before step 32 (0.032 s): when `measured.surface_angle_rad > 1` has held for 3 steps, 2 times.",
    ] {
        assert!(text.contains(comment), "no {comment} in {text}");
    }
    let plan = again(&run, &text);
    let step = |step: u64| Trigger::Step {
        step: Step(step),
        at_s: step as f64 / 1000.0,
    };
    let until = |step| FaultEnd {
        step: Some(Step(step)),
        ..FaultEnd::default()
    };
    let after = Trigger::After {
        event: 1,
        delay_steps: 0,
    };
    let expected = [
        (step(10), until(30), vec![0], 3.0),
        (after, FaultEnd::default(), vec![0], 4.0),
        (step(21), until(40), vec![0, 4], 5.0),
        (step(60), times, vec![2, 0], 7.0),
    ];
    let effects = plan.faults.iter().map(|event| {
        let skews: Vec<u64> = event
            .effects
            .iter()
            .map(|effect| effect.skew_steps)
            .collect();
        let FaultAction::Kind { parameters, .. } = &event.effects[0].action else {
            panic!("a bias");
        };
        let bias = parameters.get("bias").expect("a size");
        (event.trigger.clone(), event.end.clone(), skews, bias)
    });
    assert_eq!(effects.collect::<Vec<_>>(), expected);
}

#[test]
fn an_effect_that_was_cleared_before_its_skew_is_left_out() {
    let event = live(5, Trigger::Now, &[0, 10], FaultEnd::default());
    let events = vec![
        accepted(1, &event),
        took_hold(5, 0, 2),
        ended(5, 0, 8, true),
        ended(5, 1, 8, true),
    ];
    let run = run(events).expect("a run");
    let text = run.scenario().expect("a scenario");
    let plan = again(&run, &text);
    let last = plan.faults.last().expect("the live one");
    assert_eq!((last.effects.len(), last.end.step), (1, Some(Step(8))));
}

#[test]
fn a_run_without_interventions_repeats_as_its_scenario() {
    let run = run(vec![]).expect("a run");
    let text = run.scenario().expect("a scenario");
    let plan = again(&run, &text);
    assert_eq!(plan, run.recorded.plan);
    assert_eq!((run.records, run.outcome), (1, Some(Outcome::Completed)));
}
