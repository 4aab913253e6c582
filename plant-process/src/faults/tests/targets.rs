//! Effects on their targets, alone and stacked.

use hil_config::plan::{FaultEffect, FaultEvent, Profile};
use shared_types::describe::Operation;
use shared_types::directive::Directive;
use shared_types::random::RandomStream;

use super::rig::*;

#[test]
fn effects_on_a_signal_act_in_the_order_in_which_they_began() {
    let b = "measured.b_m";
    // By step, whatever the numbers: 10 + 3 = 13, then (10 + 3) 2 = 26.
    let mut rig = Rig::new(&[
        event(1, "times", at(2), &[on(b, 2.0)]),
        event(2, "plus", at(1), &[on(b, 3.0)]),
    ]);
    assert_eq!(
        rig.each(4, |passed| passed.sample[1]),
        [10.0, 13.0, 26.0, 26.0]
    );
    assert_eq!((rig.acted(1, 0), rig.acted(2, 0)), ((2, 13.0), (3, 3.0)));

    // At one step by number: 10 x 2 + 3.
    let mut rig = Rig::new(&[
        event(1, "times", at(1), &[on(b, 2.0)]),
        event(2, "plus", at(1), &[on(b, 3.0)]),
    ]);
    assert_eq!(rig.each(2, |passed| passed.sample[1]), [10.0, 23.0]);
    assert_eq!((rig.acted(1, 0), rig.acted(2, 0)), ((1, 10.0), (1, 3.0)));

    // In one event by index: ((10 + 1) + 3), then a skewed one on top: 10 + 3 + 1 = 14, 14 + 100.
    let skewed = skewed(1, on(b, 100.0));
    let mut rig = Rig::new(&[event(1, "plus", at(1), &[skewed, on(b, 1.0), on(b, 3.0)])]);
    assert_eq!(rig.each(3, |passed| passed.sample[1]), [10.0, 14.0, 114.0]);
    assert_eq!(rig.events, [(1, 1, 1, '+'), (1, 2, 1, '+'), (1, 0, 2, '+')]);
}

#[test]
fn each_signal_has_its_own_faults() {
    let mut rig = Rig::new(&[
        event(
            1,
            "plus",
            at(0),
            &[on("reference.r_m", 1.0), on("command.v_n", 0.5)],
        ),
        event(
            2,
            "times",
            at(0),
            &[on("measured.a_m", 2.0), on("command.u_n", -1.0)],
        ),
    ]);
    rig.run(3);
    let passed = rig.step();
    assert_eq!(
        (passed.sample, passed.applied),
        ([6.0, 10.0, 6.0], [-3.0, -0.5])
    );
    assert_eq!(rig.size(1, 1).unit, "N");
}

#[test]
fn a_profile_starts_with_its_own_effect() {
    let ramp = FaultEffect {
        profile: Profile::Ramp { duration_s: 0.2 },
        ..on("measured.b_m", 8.0)
    };
    let mut rig = Rig::new(&[event(1, "plus", at(1), &[skewed(1, ramp)])]);
    // 0.1 s a step: nothing at its first step, half at the next, all from then on.
    let values = rig.each(6, |passed| passed.sample[1]);
    assert_eq!(values, [10.0, 10.0, 10.0, 14.0, 18.0, 18.0]);
    assert_eq!(rig.acted(1, 0), (3, 8.0));
}

#[test]
fn a_dead_signal_keeps_its_last_valid_value_and_is_marked() {
    let mut rig = Rig::new(&[event(
        1,
        "gone",
        at(3),
        &[on_and_off(2, on("measured.a_m", 0.0))],
    )]);
    let passed = rig.each(8, |passed| (passed.sample[0], passed.invalid));
    assert_eq!(passed[2..5], [(2.0, 0), (2.0, 1), (2.0, 1)]);
    assert_eq!(passed[5..], [(5.0, 0), (6.0, 0), (6.0, 1)]);
    // Measured 3, 4 and 7 became 2, 2 and 6.
    assert_eq!(rig.acted(1, 0), (3, 2.0));
}

#[test]
fn a_dead_signal_of_a_constant_acts_without_a_change_of_value() {
    let mut rig = Rig::new(&[event(1, "gone", at(1), &[on("reference.r_m", 0.0)])]);
    assert_eq!(
        rig.each(3, |passed| (passed.sample[2], passed.invalid)),
        [(5.0, 0), (5.0, 4), (5.0, 4)]
    );
    assert_eq!(rig.acted(1, 0), (2, 0.0));
}

#[test]
fn a_signal_that_was_never_valid_is_zero() {
    let mut rig = Rig::new(&[event(
        1,
        "gone",
        at(0),
        &[on("measured.b_m", 0.0), on("command.v_n", 0.0)],
    )]);
    let passed = rig.run(2);
    assert_eq!(
        passed
            .iter()
            .map(|p| (p.sample[1], p.invalid, p.applied[1]))
            .collect::<Vec<_>>(),
        [(0.0, 2, 0.0); 2]
    );
}

#[test]
fn a_nan_is_replaced_by_the_last_good_value() {
    for kind in ["infinite", "no-number"] {
        let targets = ["measured.a_m", "command.u_n"];
        let mut rig = Rig::new(&[event(
            1,
            kind,
            at(2),
            &targets.map(|target| on(target, 0.0)),
        )]);
        let passed = rig.each(4, |passed| {
            (passed.sample[0], passed.invalid, passed.applied[0])
        });
        assert_eq!(
            passed,
            [(0.0, 0, 0.0), (1.0, 0, 1.0), (1.0, 1, 1.0), (1.0, 1, 1.0)],
            "{kind}"
        );
        assert_eq!((rig.acted(1, 0), rig.acted(1, 1)), ((2, 2.0), (2, 2.0)));
    }
}

#[test]
fn no_fault_changes_an_invalid_signal() {
    // A bias on top of a dead sensor: the last valid value was 11, and stays so.
    let b = "measured.b_m";
    for (first, second) in [("gone", "plus"), ("plus", "gone")] {
        let begin = |kind| if kind == "gone" { 1 } else { 0 };
        let mut rig = Rig::new(&[
            event(1, first, at(begin(first)), &[on(b, 1.0)]),
            event(2, second, at(begin(second)), &[on(b, 1.0)]),
        ]);
        let passed = rig.each(3, |passed| (passed.sample[1], passed.invalid));
        assert_eq!(
            passed,
            [(11.0, 0), (11.0, 2), (11.0, 2)],
            "{first}, {second}"
        );
    }
    let mut rig = Rig::new(&[
        event(1, "gone", at(1), &[on(b, 0.0)]),
        event(2, "plus", at(2), &[on(b, 1.0)]),
    ]);
    assert_eq!(rig.each(4, |passed| passed.sample[1]), [10.0; 4]);
    assert_eq!((rig.acted(1, 0).0, rig.acted(2, 0)), (3, (0, 0.0)));
}

#[test]
fn validity_is_delayed_with_its_value() {
    // Dead at steps 2 and 3 (a ramp is 0 at its first step), shown one step later.
    let a = "measured.a_m";
    let ramp = FaultEffect {
        profile: Profile::Ramp { duration_s: 0.1 },
        ..on(a, 0.0)
    };
    let mut rig = Rig::new(&[
        until(lasting(3), event(1, "gone", at(1), &[ramp])),
        event(2, "before", at(1), &[on(a, 0.0)]),
    ]);
    let passed = rig.each(7, |passed| (passed.sample[0], passed.invalid));
    assert_eq!(passed[..3], [(0.0, 0), (1.0, 0), (1.0, 0)]);
    assert_eq!(passed[3..], [(1.0, 1), (1.0, 1), (4.0, 0), (5.0, 0)]);
}

#[test]
fn after_an_invalid_command_the_last_valid_one_is_held() {
    // The controller itself marks `u_n` as invalid, then a fault does so with `v_n`.
    let mut rig = Rig::new(&[event(1, "gone", at(5), &[on("command.v_n", 0.0)])]);
    rig.run(2);
    rig.command_invalid = 0b01;
    assert_eq!(rig.each(2, |passed| passed.applied), [[1.0, -1.0]; 2]);
    rig.command_invalid = 0;
    assert_eq!(
        rig.each(2, |passed| passed.applied),
        [[4.0, -1.0], [5.0, -1.0]]
    );
    assert_eq!(rig.acted(1, 0), (1, 0.0));
}

#[test]
fn an_invalid_command_from_the_controller_is_not_counted_as_a_fault_effect() {
    let mut rig = Rig::new(&[event(1, "plus", at(2), &[on("command.u_n", 1.0)])]);
    rig.run(2);
    rig.command_invalid = 0b01;
    rig.run(2);
    assert_eq!(rig.acted(1, 0), (0, 0.0));
}

#[test]
fn parameters_are_moved_in_order_from_their_healthy_values() {
    let gain = "gain";
    let mut rig = Rig::new(&[
        until(
            lasting(3),
            event(1, "x", at(1), &[moving(&[(gain, Operation::Add, 5.0)])]),
        ),
        event(
            2,
            "x",
            at(2),
            &[moving(&[
                (gain, Operation::Scale, 2.0),
                ("load_n", Operation::Set, 3.0),
            ])],
        ),
        until(
            lasting(1),
            event(3, "plus", at(3), &[on("parameter.gain", 1.0)]),
        ),
    ]);
    let passed = rig.each(6, |passed| (passed.parameters, passed.retuned));
    assert_eq!(
        passed,
        [
            ([1.0, 10.0, 0.0], false),
            ([1.0, 15.0, 0.0], true),
            ([1.0, 30.0, 3.0], true),
            ([1.0, 31.0, 3.0], true),
            ([1.0, 20.0, 3.0], true),
            ([1.0, 20.0, 3.0], false),
        ]
    );
    // The size of a fault that moves several is that of the first: 15 to 30, then 10 to 20.
    assert_eq!(
        (rig.acted(1, 0), rig.acted(2, 0), rig.acted(3, 0)),
        ((3, 5.0), (4, 15.0), (1, 1.0))
    );
    let size = rig.size(2, 0);
    assert_eq!(
        (size.parameter.as_str(), size.unit.as_str()),
        ("gain,load_n", "1")
    );
}

#[test]
fn parameters_are_healthy_again_after_the_last_fault() {
    let mut rig = Rig::new(&[until(
        lasting(2),
        event(1, "x", at(1), &[moving(&[("gain", Operation::Set, 0.0)])]),
    )]);
    let passed = rig.each(5, |passed| (passed.parameters[1], passed.retuned));
    assert_eq!(
        passed,
        [
            (10.0, false),
            (0.0, true),
            (0.0, false),
            (10.0, true),
            (10.0, false)
        ]
    );
}

#[test]
fn no_fault_moves_a_parameter_out_of_its_range() {
    // The load may be -5 to 5 and is 0, the gain 0 to 100 and is 10.
    #[rustfmt::skip] // a table
    let cases: [(FaultEvent, [f64; 2], (u64, f64)); 5] = [
        (event(1, "x", at(0), &[moving(&[("load_n", Operation::Add, -7.0)])]), [10.0, -5.0], (2, 5.0)),
        (event(1, "plus", at(0), &[on("parameter.load_n", 7.0)]), [10.0, 5.0], (2, 5.0)),
        (event(1, "infinite", at(0), &[on("parameter.gain", 0.0)]), [100.0, 0.0], (2, 90.0)),
        // NaN changes nothing, and is reported as no change.
        (event(1, "no-number", at(0), &[on("parameter.gain", 0.0)]), [10.0, 0.0], (0, 0.0)),
        (event(1, "x", at(0), &[moving(&[("gain", Operation::Add, f64::NAN)])]), [10.0, 0.0], (0, 0.0)),
    ];
    for (event, expected, acted) in cases {
        let mut rig = Rig::new(&[event]);
        rig.step();
        assert_eq!(rig.step().parameters[1..], expected);
        assert_eq!(rig.acted(1, 0), acted);
    }
}

#[test]
fn busy_times_add_up_and_each_has_its_own_size() {
    let busy = |id, target, by| event(id, "busy", at(1), &[on(target, by)]);
    let mut rig = Rig::new(&[
        busy(1, "controller", 300.0),
        busy(2, "controller", 50.0),
        busy(3, "plant", 700.0),
        event(4, "jump", at(1), &[on_and_off(1, on("controller", 4.0))]),
    ]);
    // The controller reports no more than its actual work.
    rig.answer.work_ns = 200;
    let passed = rig.each(3, |passed| (passed.directive, passed.busy_ns));
    let directive = |busy_ns, late_steps| Directive {
        busy_ns,
        late_steps,
        unseen: false,
    };
    assert_eq!(
        passed,
        [
            (directive(0, 0), 0),
            (directive(350, 4), 700),
            (directive(350, 0), 700)
        ]
    );
    rig.layer.plant_was_busy(1234);
    assert_eq!(
        (rig.acted(1, 0), rig.acted(2, 0), rig.acted(3, 0)),
        ((2, 200.0), (2, 50.0), (2, 700.0))
    );
    // It answered each sample with a new command: it does not obey.
    assert_eq!(rig.acted(4, 0), (1, 0.0));
    rig.answer.age_steps = 1;
    rig.step();
    assert_eq!(rig.acted(4, 0), (2, 4.0));
    let units = [1, 3, 4].map(|id| rig.size(id, 0).unit);
    assert_eq!(units, ["ns", "ns", "steps"]);
}

#[test]
fn random_numbers_depend_on_kind_target_step_and_ordinal() {
    let a = "measured.a_m";
    let draw = |path: &str| RandomStream::new(1, path).uniform();
    for first in [1, 40] {
        // The event's number does not matter, nor do effects on other targets.
        let mut rig = Rig::new(&[
            event(first, "dice", at(2), &[on("measured.b_m", 0.0)]),
            event(first + 1, "dice", at(2), &[on(a, 0.0)]),
            until(
                lasting(1),
                event(first + 2, "dice", at(3), &[on(a, 0.0), on(a, 0.0)]),
            ),
        ]);
        let passed = rig.each(4, |passed| passed.sample);
        assert_eq!(passed[2][0], draw("dice/measured.a_m/2/0"));
        assert_eq!(passed[2][1], draw("dice/measured.b_m/2/0"));
        assert_eq!(passed[3][0], draw("dice/measured.a_m/3/1"));
    }
}
