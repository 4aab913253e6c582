//! Triggers, ends, skew and their order.

use hil_config::plan::{FaultAction, FaultEffect, FaultEnd, FaultEvent, Profile, Trigger};
use shared_types::describe::{Operation, Settings};
use shared_types::record::Event;
use shared_types::time::Step;

use super::rig::*;

const A: &str = "measured.a_m";

fn plus(id: u32, trigger: Trigger) -> FaultEvent {
    event(id, "plus", trigger, &[on(A, 1.0)])
}

#[test]
fn each_trigger_fires_at_its_step() {
    // `sensed.a_m` of record k is k, so `>= 3` holds first in record 3 and acts at step 4.
    let cases = [
        (at(0), 0),
        (at(5), 5),
        (Trigger::Condition(when("sensed.a_m >= 3", 1)), 4),
        (Trigger::Condition(when("sensed.a_m >= 3", 4)), 7),
        (
            Trigger::Condition(when("twice >= 9 and parameter.gain == 10", 1)),
            6,
        ),
        (Trigger::Condition(when("sensed.a_m != 2", 3)), 6),
        (Trigger::Condition(when("stimulus.r_m == 5", 1)), 1),
        (after(7, 0), 2),
        (after(7, 3), 5),
    ];
    for (trigger, step) in cases {
        let label = format!("{trigger:?}");
        let other = event(7, "plus", at(2), &[skewed(9, on("measured.b_m", 1.0))]);
        let mut rig = Rig::new(&[plus(1, trigger), other]);
        let values = rig.each(9, |passed| passed.sample[0]);
        for (k, value) in (0..).zip(values) {
            let expected = k as f64 + if k >= step { 1.0 } else { 0.0 };
            assert_eq!(value, expected, "{label} at {k}");
        }
        assert_eq!(rig.events, [(1, 0, step, '+')], "{label}");
    }
}

#[test]
fn each_end_leaves_its_step_healthy() {
    let none = FaultEnd::default;
    let condition = |expression, records| FaultEnd {
        condition: Some(when(expression, records)),
        ..none()
    };
    #[rustfmt::skip] // a table
    let cases = [
        (FaultEnd { step: Some(Step(5)),..none() }, 5),
        (lasting(4), 6),
        // Evaluated from record 2 on, the first one with the fault.
        (condition("stimulus.r_m == 5", 1), 3),
        (condition("stimulus.r_m == 5", 3), 5),
        (condition("measured.a_m == 5", 1), 5),
        // The first of several.
        (FaultEnd { step: Some(Step(7)),..lasting(6) }, 7),
        (FaultEnd { step: Some(Step(9)),..condition("sensed.a_m >= 5", 1) }, 6),
    ];
    for (end, step) in cases {
        let label = format!("{end:?}");
        let mut rig = Rig::new(&[until(end, plus(1, at(2)))]);
        let values = rig.each(10, |passed| passed.sample[0]);
        for (k, value) in (0..).zip(values) {
            let expected = k as f64 + if (2..step).contains(&k) { 1.0 } else { 0.0 };
            assert_eq!(value, expected, "{label} at {k}");
        }
        assert_eq!(rig.events, [(1, 0, 2, '+'), (1, 0, step, '-')], "{label}");
        let size = rig.size(1, 0);
        assert_eq!(
            (size.step, size.ended_step, size.acted_steps),
            (Some(2), Some(step), step - 2)
        );
    }
}

#[test]
fn occurrences_are_runs_of_steps_at_which_a_number_changed() {
    let twice = FaultEnd {
        occurrences: Some(2),
        ..FaultEnd::default()
    };
    let effects = [
        on_and_off(2, on(A, 1.0)),
        on_and_off(1, on("parameter.gain", 1.0)),
        on("measured.b_m", 1.0),
    ];
    let mut rig = Rig::new(&[until(twice, event(1, "plus", at(1), &effects))]);
    let passed = rig.each(10, |passed| (passed.sample[0], passed.parameters[1]));
    let signal: Vec<f64> = passed.iter().map(|passed| passed.0).collect();
    assert_eq!(signal, [0.0, 2.0, 3.0, 3.0, 4.0, 6.0, 7.0, 7.0, 8.0, 9.0]);
    let parameter: Vec<f64> = passed.iter().map(|passed| passed.1).collect();
    assert_eq!(parameter[..7], [10.0, 11.0, 10.0, 11.0, 10.0, 10.0, 10.0]);
    // Each is over at the step after the one that showed it. An effect that never pauses never ends.
    assert_eq!(rig.events[3..], [(1, 1, 5, '-'), (1, 0, 8, '-')]);
}

#[test]
fn occurrences_on_messages_or_time_are_single_steps() {
    let thrice = FaultEnd {
        occurrences: Some(3),
        ..FaultEnd::default()
    };
    let lost = event(
        1,
        "lost",
        at(1),
        &[
            on("link.sample", 0.0),
            on_and_off(1, on("link.command", 0.0)),
        ],
    );
    let busy = event(2, "busy", at(1), &[on("plant", 9.0)]);
    let mut rig = Rig::new(&[until(thrice.clone(), lost), until(thrice, busy)]);
    let ages = rig.each(8, |passed| {
        (
            passed.sample_age_steps,
            passed.command_age_steps,
            passed.busy_ns,
        )
    });
    assert_eq!(
        ages,
        [
            (0, 0, 0),
            (1, 1, 9),
            (2, 0, 9),
            (3, 1, 9),
            (0, 0, 0),
            (0, 1, 0),
            (0, 0, 0),
            (0, 0, 0)
        ]
    );
    assert_eq!(
        rig.events[3..],
        [(1, 0, 4, '-'), (2, 0, 4, '-'), (1, 1, 6, '-')]
    );
}

#[test]
fn each_effect_has_its_skew_and_its_own_duration() {
    let effects = [
        on(A, 1.0),
        skewed(2, on("measured.b_m", 1.0)),
        skewed(1, on("reference.r_m", 1.0)),
    ];
    let mut rig = Rig::new(&[until(lasting(2), event(1, "plus", at(1), &effects))]);
    rig.run(7);
    let expected = [
        (1, 0, 1, '+'),
        (1, 2, 2, '+'),
        (1, 0, 3, '-'),
        (1, 1, 3, '+'),
        (1, 2, 4, '-'),
        (1, 1, 5, '-'),
    ];
    assert_eq!(rig.events, expected);
}

#[test]
fn an_effect_whose_event_ends_first_never_begins() {
    let effects = [on(A, 1.0), skewed(3, on("measured.b_m", 1.0))];
    for end in [
        FaultEnd {
            step: Some(Step(4)),
            ..FaultEnd::default()
        },
        FaultEnd {
            condition: Some(when("sensed.a_m >= 3", 1)),
            ..FaultEnd::default()
        },
    ] {
        let mut rig = Rig::new(&[until(end, event(1, "plus", at(1), &effects))]);
        rig.run(8);
        assert_eq!(rig.events, [(1, 0, 1, '+'), (1, 0, 4, '-')]);
        assert_eq!(
            (rig.size(1, 1).step, rig.size(1, 1).ended_step),
            (None, None)
        );
        assert_eq!(rig.layer.states()[0].state, "ended");
    }
}

#[test]
fn an_event_that_ends_before_its_trigger_never_begins_nor_do_its_followers() {
    let over = FaultEnd {
        step: Some(Step(2)),
        ..FaultEnd::default()
    };
    let late = Trigger::Condition(when("sensed.a_m >= 3", 1));
    let mut rig = Rig::new(&[
        until(over, plus(1, late)),
        plus(2, after(1, 0)),
        plus(3, after(2, 0)),
    ]);
    rig.run(8);
    assert_eq!(rig.events, []);
    let states: Vec<_> = rig
        .layer
        .states()
        .into_iter()
        .map(|state| state.state)
        .collect();
    assert_eq!(states, ["ended", "waiting", "waiting"]);
    let waits_for = rig.layer.states().remove(1).waits_for.expect("it waits");
    assert_eq!(waits_for, "fault 1, which ended before it took effect");
}

#[test]
fn events_that_follow_one_another_at_once_begin_at_one_step_in_the_order_of_their_numbers() {
    let b = "measured.b_m";
    let mut rig = Rig::new(&[
        event(1, "times", after(2, 0), &[on(b, 2.0)]),
        event(2, "plus", after(3, 0), &[on(b, 3.0)]),
        event(
            3,
            "plus",
            Trigger::Condition(when("sensed.a_m == 1", 1)),
            &[on(b, 5.0)],
        ),
        event(4, "plus", after(1, 2), &[on(b, 7.0)]),
    ]);
    // 10 x 2 + 3 + 5 = 28 from step 2, + 7 from step 4.
    assert_eq!(
        rig.each(5, |passed| passed.sample[1]),
        [10.0, 10.0, 28.0, 28.0, 35.0]
    );
    assert_eq!(
        rig.events,
        [
            (1, 0, 2, '+'),
            (2, 0, 2, '+'),
            (3, 0, 2, '+'),
            (4, 0, 4, '+')
        ]
    );
}

#[test]
fn ends_at_a_step_precede_beginnings() {
    let mut rig = Rig::new(&[plus(1, at(3)), until(lasting(2), plus(2, at(1)))]);
    assert_eq!(
        rig.each(5, |passed| passed.sample[0]),
        [0.0, 2.0, 3.0, 4.0, 5.0]
    );
    assert_eq!(rig.events, [(2, 0, 1, '+'), (2, 0, 3, '-'), (1, 0, 3, '+')]);
}

#[test]
fn a_fault_is_reported_with_all_that_determines_its_course() {
    let ramp = FaultEffect {
        profile: Profile::Ramp { duration_s: 0.5 },
        ..on(A, 1.5)
    };
    let exponential = FaultEffect {
        profile: Profile::Exponential { speed_per_s: 10.0 },
        ..moving(&[("gain", Operation::Add, 0.5)])
    };
    let both = moving(&[
        ("gain", Operation::Set, 1.0),
        ("load_n", Operation::Scale, 2.0),
    ]);
    let list = FaultEffect {
        action: FaultAction::Kind {
            parameters: Settings::default(),
            list: vec![1.0, 0.0],
        },
        ..on("link.sample", 0.0)
    };
    let mut rig = Rig::new(&[
        event(1, "plus", at(0), &[ramp]),
        event(2, "x", at(0), &[exponential, both]),
        event(3, "lost", at(0), &[list]),
        event(4, "busy", at(0), &[on("plant", 2.0)]),
    ]);
    rig.layer.advance(Step(0), None);
    let mut events = Vec::new();
    while let Some(Event::Fault(begun_fault)) = rig.layer.next_event() {
        events.push((
            begun_fault.parameter,
            begun_fault.canonical,
            begun_fault.wall_only,
        ));
    }
    let events: Vec<_> = events
        .iter()
        .map(|(parameter, canonical, wall)| (&parameter[..], &canonical[..], *wall))
        .collect();
    assert_eq!(
        events,
        [
            (
                "measured.a_m",
                "by=3ff8000000000000 ramp=3fe0000000000000",
                false
            ),
            (
                "gain",
                "add=3fe0000000000000 exponential=4024000000000000",
                false
            ),
            (
                "gain,load_n",
                "set=3ff0000000000000 scale=4000000000000000 step",
                false
            ),
            (
                "link.sample",
                "list=3ff0000000000000,0000000000000000 step",
                false
            ),
            ("plant", "by=4000000000000000 step", true),
        ]
    );
}
