//! Faults that are admitted and cleared during the run.

use std::sync::atomic::Ordering;

use hil_config::expression::Columns;
use hil_config::plan::{FaultAction, FaultEvent, FaultSource, Trigger};
use shared_types::describe::{Operation, Settings};
use shared_types::time::Step;

use super::kinds::COUNTED;
use super::rig::*;
use crate::faults::{Admitted, ArmedFault};

const A: &str = "measured.a_m";

impl Rig {
    fn prepare(&self, event: FaultEvent) -> Box<ArmedFault> {
        let armed = self.builder.build(event, &Columns::from(&self.layout));
        Box::new(armed.expect("a fault that can be"))
    }

    fn admit(&mut self, events: Vec<FaultEvent>) -> Result<Vec<Admitted>, String> {
        let armed = events
            .into_iter()
            .map(|event| self.prepare(event))
            .collect();
        self.layer.admit(armed, Step(self.next))
    }
}

fn plus(id: u32, trigger: Trigger) -> FaultEvent {
    event(id, "plus", trigger, &[on(A, 1.0)])
}

#[test]
fn a_live_fault_begins_at_the_announced_step() {
    let condition = when("sensed.a_m >= 0", 2);
    // Admitted before step 5. The scenario's fault 1 began at 2, its fault 2 will at 9.
    let cases = [
        (Trigger::Now, Some(5), None, 5),
        (at(5), Some(5), None, 5),
        (at(8), Some(8), None, 8),
        (
            Trigger::Condition(condition),
            None,
            Some("`sensed.a_m >= 0` to hold for 2 consecutive records"),
            6,
        ),
        (after(1, 4), Some(6), None, 6),
        (after(1, 1), Some(5), None, 5),
        (
            after(2, 1),
            None,
            Some("1 steps after fault 2 takes effect"),
            10,
        ),
        (after(2, 0), None, Some("fault 2 to take effect"), 9),
    ];
    for (trigger, step, waits_for, begin) in cases {
        let b = |id, step| event(id, "plus", at(step), &[on("measured.b_m", 1.0)]);
        let mut rig = Rig::new(&[b(1, 2), b(2, 9)]);
        rig.run(5);
        rig.events.clear();
        let label = format!("{trigger:?}");
        let admitted = rig.admit(vec![plus(3, trigger)]).expect("it can be");
        let expected = Admitted {
            id: 3,
            kind: "plus".into(),
            step: step.map(Step),
            waits_for: waits_for.map(Into::into),
        };
        assert_eq!(admitted, [expected], "{label}");
        rig.run(7);
        rig.events.retain(|report| report.0 == 3);
        assert_eq!(rig.events, [(3, 0, begin, '+')], "{label}");
    }
}

#[test]
fn a_fault_in_the_past_is_refused_and_none_is_admitted() {
    let mut rig = Rig::new(&[]);
    rig.run(7);
    let result = rig.admit(vec![plus(1, Trigger::Now), plus(2, at(6))]);
    let expected =
        "step 6 (0.6 s) is past, because the run is at step 7 (0.7 s); choose a later time";
    assert_eq!(result, Err(expected.into()));
    assert_eq!(rig.each(2, |passed| passed.sample[0]), [7.0, 8.0]);
    assert!(rig.layer.states().is_empty());
}

#[test]
fn the_faults_of_one_request_begin_together() {
    let mut rig = Rig::new(&[]);
    rig.run(3);
    let pair = [on(A, 1.0), on("measured.b_m", 2.0)];
    let events = vec![
        event(1, "plus", Trigger::Now, &pair),
        event(2, "times", after(1, 0), &[on(A, 10.0)]),
    ];
    rig.admit(events).expect("they can be");
    assert_eq!(rig.step().sample, [40.0, 12.0, 5.0]);
    assert_eq!(rig.events, [(1, 0, 3, '+'), (1, 1, 3, '+'), (2, 0, 3, '+')]);
}

#[test]
fn a_live_fault_acts_like_the_same_fault_of_a_scenario() {
    let noisy = |id, trigger| event(id, "dice", trigger, &[on(A, 0.0), skewed(1, on(A, 0.0))]);
    let mut scenario = Rig::new(&[noisy(1, at(4)), noisy(2, at(4))]);
    let mut live = Rig::new(&[]);
    let expected = scenario.run(9);
    let mut actual = live.run(3);
    live.admit(vec![noisy(8, at(4))]).expect("it can be");
    actual.extend(live.run(1));
    live.admit(vec![noisy(9, Trigger::Now)]).expect("it can be");
    actual.extend(live.run(5));
    assert_eq!(actual, expected);
}

#[test]
fn cleared_faults_end_at_the_next_step_with_an_event_each() {
    for (id, ids, reports) in [
        (Some(1), vec![1], vec![(1, 0, 4, 'x')]),
        (Some(2), vec![2], vec![(2, 0, 4, 'x'), (2, 1, 4, 'x')]),
        (Some(3), vec![3], vec![(3, 0, 4, 'x')]),
        (
            None,
            vec![1, 2, 3],
            vec![
                (1, 0, 4, 'x'),
                (2, 0, 4, 'x'),
                (2, 1, 4, 'x'),
                (3, 0, 4, 'x'),
            ],
        ),
        // One that is over, and one that does not exist.
        (Some(4), vec![], vec![]),
        (Some(5), vec![], vec![]),
    ] {
        let mut rig = Rig::new(&[
            event(1, "x", at(1), &[moving(&[("gain", Operation::Add, 1.0)])]),
            event(
                2,
                "plus",
                at(1),
                &[on(A, 1.0), skewed(5, on("measured.b_m", 1.0))],
            ),
            event(3, "lost", at(6), &[on("link.sample", 0.0)]),
            until(
                lasting(1),
                event(4, "plus", at(1), &[on("reference.r_m", 1.0)]),
            ),
        ]);
        rig.run(4);
        rig.events.clear();
        assert_eq!(rig.layer.clear(id, Step(4)), ids);
        let passed = rig.run(4);
        let (is_cleared, value) = (|number| ids.contains(&number), passed[3].sample[1]);
        for (k, passed) in (4..).zip(&passed) {
            assert_eq!(
                passed.parameters[1],
                if is_cleared(1) { 10.0 } else { 11.0 }
            );
            assert_eq!(passed.retuned, is_cleared(1) && k == 4);
            let late = if is_cleared(3) || k < 6 { 0 } else { k - 5 };
            assert_eq!(passed.sample_age_steps, late);
            let expected_value = f64::from(k - late) + if is_cleared(2) { 0.0 } else { 1.0 };
            assert_eq!(passed.sample[0], expected_value);
        }
        assert_eq!(
            value,
            if is_cleared(3) && !is_cleared(2) {
                11.0
            } else {
                10.0
            }
        );
        rig.events.retain(|reports| reports.3 == 'x');
        assert_eq!(rig.events, reports, "{id:?}");
        assert_eq!(rig.layer.clear(id, Step(8)), [0; 0], "all of it is gone");
    }
}

#[test]
fn a_follower_of_a_fault_cleared_before_its_beginning_never_begins() {
    let mut rig = Rig::new(&[plus(1, at(5)), plus(2, after(1, 1))]);
    rig.run(2);
    rig.layer.clear(Some(1), Step(2));
    let result = rig.admit(vec![plus(3, Trigger::Now), plus(4, after(1, 0))]);
    let expected = "fault 1 ended before it took effect, so nothing can follow it";
    assert_eq!(result, Err(expected.into()));
    rig.run(8);
    assert_eq!(rig.events, [(1, 0, 2, 'x')]);

    // Once it has begun, its follower begins too.
    let mut rig = Rig::new(&[plus(1, at(2)), plus(2, after(1, 3))]);
    rig.run(3);
    rig.layer.clear(Some(1), Step(3));
    rig.run(5);
    assert_eq!(rig.events, [(1, 0, 2, '+'), (1, 0, 3, 'x'), (2, 0, 5, '+')]);
}

#[test]
fn the_states_describe_what_each_fault_does_and_waits_for() {
    let live = FaultEvent {
        source: FaultSource::Cli,
        ..plus(5, at(9))
    };
    let mut rig = Rig::new(&[
        until(lasting(1), plus(1, at(0))),
        plus(2, at(1)),
        event(3, "plus", at(2), &[skewed(4, on(A, 1.0))]),
        plus(4, Trigger::Condition(when("sensed.a_m > 100", 1))),
    ]);
    rig.run(3);
    rig.admit(vec![live, plus(6, after(4, 2))])
        .expect("they can be");
    let states: Vec<_> = rig
        .layer
        .states()
        .into_iter()
        .map(|state| {
            (
                state.id,
                state.source,
                state.state,
                state.waits_for.unwrap_or_default(),
            )
        })
        .collect();
    let actual: Vec<_> = states
        .iter()
        .map(|(id, source, state, waits)| (*id, &source[..], &state[..], &waits[..]))
        .collect();
    assert_eq!(
        actual,
        [
            (1, "scenario", "ended", ""),
            (2, "scenario", "active", ""),
            (3, "scenario", "waiting", "step 6"),
            (4, "scenario", "waiting", "`sensed.a_m > 100` to hold"),
            (5, "cli", "waiting", "step 9"),
            (
                6,
                "scenario",
                "waiting",
                "2 steps after fault 4 takes effect"
            ),
        ]
    );
    assert_eq!(rig.layer.states()[1].effects[0].acted_steps, 2);
}

#[test]
fn an_ended_fault_releases_its_resources_but_keeps_its_report() {
    const MANY: u32 = 200;
    let mut effect = on("link.sample", 0.0);
    effect.action = FaultAction::Kind {
        parameters: Settings::default(),
        list: Vec::new(),
    };
    let mut rig = Rig::new(&[plus(1, at(3)), plus(2, after(MANY + 1, 1))]);
    for id in 3..=MANY {
        let counted = event(id, "counted", Trigger::Now, std::slice::from_ref(&effect));
        // Each kind of end in turn: by itself, cleared while it acts, cleared while it waits.
        let counted = match id % 3 {
            0 => until(lasting(1), counted),
            1 => counted,
            _ => FaultEvent {
                trigger: Trigger::Condition(when("sensed.a_m < 0", 1)),
                ..counted
            },
        };
        rig.admit(vec![counted]).expect("it can be");
        rig.run(1);
        if id % 3 != 0 {
            assert_eq!(rig.layer.clear(Some(id), Step(rig.next)), [id]);
        }
        rig.run(1);
        let there = COUNTED.load(Ordering::Relaxed);
        assert!(there <= 2, "{there} of the first {id}");
    }
    let states = rig.layer.states();
    assert_eq!(states.len(), MANY as usize);
    assert!(states[2..].iter().all(|state| state.state == "ended"));
    assert_eq!(rig.size(3, 0).step, Some(0));
    assert_eq!(rig.size(3, 0).ended_step, Some(1));
    assert_eq!(rig.size(5, 0).step, None);
    // Living faults are unaffected.
    assert!(rig.events.contains(&(1, 0, 3, '+')));
    let last = event(MANY + 1, "plus", Trigger::Now, &[on("measured.b_m", 1.0)]);
    rig.admit(vec![last]).expect("it can be");
    let k = rig.next as f64;
    let values = rig.each(2, |passed| passed.sample[0]);
    assert_eq!(values, [k + 1.0, k + 3.0]);
}
