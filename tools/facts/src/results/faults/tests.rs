use hil_config::plan::{Condition, FaultAction, FaultEffect, FaultEnd, Profile};
use serde_json::json;
use shared_types::describe::Settings;

use super::*;

fn event(id: u32, source: FaultSource, trigger: Trigger, targets: &[&str]) -> FaultEvent {
    let effect = |target: &&str| FaultEffect {
        target: (*target).into(),
        skew_steps: 0,
        profile: Profile::Step,
        action: FaultAction::Kind {
            parameters: Settings::default(),
            list: Vec::new(),
        },
    };
    FaultEvent {
        id,
        name: None,
        kind: "bias".into(),
        source,
        trigger,
        end: FaultEnd::default(),
        effects: targets.iter().map(effect).collect(),
    }
}

fn at(step: u64, at_s: f64) -> Trigger {
    Trigger::Step {
        step: Step(step),
        at_s,
    }
}

fn begun(id: u32, effect: u32, step: u64) -> FaultBegun {
    FaultBegun {
        id,
        effect,
        step,
        kind: "bias".into(),
        target: "measured.x_m".into(),
        parameter: "x_m".into(),
        canonical: String::new(),
        wall_only: false,
    }
}

fn size(id: u32, effect: u32, step: Option<u64>, acted_steps: u64) -> FaultEffectSize {
    FaultEffectSize {
        id,
        effect,
        kind: "bias".into(),
        target: "measured.x_m".into(),
        parameter: "x_m".into(),
        step,
        ended_step: None,
        acted_steps,
        max_effect: 0.5 * acted_steps as f64,
        unit: "m".into(),
    }
}

fn rate() -> Rate {
    Rate::new(1000.0).expect("a rate")
}

#[test]
fn a_summary_reports_size_end_and_source_of_every_fault() {
    let live = event(2, FaultSource::Cli, Trigger::Now, &["command.u_n"]);
    let log = FaultLog {
        accepted: vec![LiveFault {
            step: 40,
            event: live,
        }],
        begun: vec![begun(1, 0, 10), begun(1, 1, 12), begun(2, 0, 41)],
        ended: vec![FaultEnded {
            id: 2,
            effect: 0,
            step: 60,
            cleared: true,
        }],
        sizes: Some(vec![
            size(1, 0, Some(10), 5),
            size(1, 1, Some(12), 0),
            size(2, 0, Some(41), 1),
        ]),
        ..FaultLog::default()
    };
    let scenario = [event(
        1,
        FaultSource::Scenario,
        at(10, 0.0095),
        &["measured.x_m", "measured.v"],
    )];
    let faults = log.faults(&scenario, rate());
    let expected = json!([
        {
            "event": 1, "kind": "bias", "source": "scenario", "requested_at_s": 0.0095, "effective_step": 10,
            "effects": [
                {"target": "measured.x_m", "parameter": "x_m", "effective_step": 10, "ended_step": null, "max_effect": 2.5, "unit": "m", "acted_steps": 5},
                {"target": "measured.v", "parameter": "x_m", "effective_step": 12, "ended_step": null, "max_effect": 0.0, "unit": "m", "acted_steps": 0, "no_effect": true}
            ]
        },
        {
            "event": 2, "kind": "bias", "source": "cli", "requested_at_s": 0.04, "accepted_step": 40, "effective_step": 41,
            "effects": [
                {"target": "command.u_n", "parameter": "x_m", "effective_step": 41, "ended_step": 60, "cleared": true, "max_effect": 0.5, "unit": "m", "acted_steps": 1}
            ]
        }
    ]);
    assert_eq!(serde_json::to_value(&faults).expect("JSON"), expected);
    assert_eq!(
        faults[0].describe(),
        "fault 1 bias at step 10, measured.x_m 2.5 m, measured.v NO EFFECT"
    );
    assert_eq!(
        faults[1].describe(),
        "fault 2 bias (live) at step 41, command.u_n 0.5 m (cleared at step 60)"
    );
}

#[test]
fn a_fault_that_never_took_hold_says_why() {
    let condition = |records| {
        Trigger::Condition(Condition {
            expression: "truth.x_m > 1".into(),
            records,
        })
    };
    let after = |event| Trigger::After {
        event,
        delay_steps: 7,
    };
    let log = FaultLog {
        begun: vec![begun(9, 0, 3)],
        ended: vec![FaultEnded {
            id: 6,
            effect: 0,
            step: 2,
            cleared: true,
        }],
        sizes: Some(vec![]),
        ..FaultLog::default()
    };
    for (id, trigger, reason) in [
        (1, at(500, 0.5), "the run ended before step 500"),
        (2, condition(1), "`truth.x_m > 1` never held"),
        (
            3,
            condition(20),
            "`truth.x_m > 1` never held for 20 steps in a row",
        ),
        (4, after(1), "fault 1, which it follows, never took effect"),
        (5, after(9), "the run ended within 7 steps after fault 9"),
        (6, at(500, 0.5), "it was cleared earlier"),
    ] {
        let fault = &log.faults(&[event(id, FaultSource::Scenario, trigger, &["x"])], rate())[0];
        assert_eq!(
            (fault.effective_step, fault.reason.as_deref()),
            (None, Some(reason))
        );
        assert_eq!(
            fault.describe(),
            format!("fault {id} bias never took effect: {reason}")
        );
    }
}

#[test]
fn without_the_plants_last_word_sizes_are_unknown() {
    let log = FaultLog {
        begun: vec![begun(1, 0, 10)],
        ..FaultLog::default()
    };
    let fault = &log.faults(
        &[event(1, FaultSource::Scenario, at(10, 0.01), &["x"])],
        rate(),
    )[0];
    let effect = &fault.effects[0];
    assert_eq!(
        (effect.max_effect, effect.acted_steps, effect.no_effect),
        (None, None, false)
    );
    assert_eq!(
        fault.describe(),
        "fault 1 bias at step 10, x of unknown size"
    );
}
