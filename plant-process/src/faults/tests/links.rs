//! Faults of the link, alone, stacked and with faults of signals.

use super::rig::*;

#[test]
fn a_lost_message_leaves_the_receiver_with_the_last_one() {
    let mut rig = Rig::new(&[until(
        lasting(3),
        event(
            1,
            "lost",
            at(2),
            &[on("link.sample", 0.0), on("link.command", 0.0)],
        ),
    )]);
    let passed = rig.each(6, |p| {
        (
            p.sample[0],
            p.sample_age_steps,
            p.applied[0],
            p.command_age_steps,
        )
    });
    assert_eq!(
        passed[1..],
        [
            (1.0, 0, 1.0, 0),
            (1.0, 1, 1.0, 1),
            (1.0, 2, 1.0, 2),
            (1.0, 3, 1.0, 3),
            (5.0, 0, 5.0, 0)
        ]
    );
    assert_eq!(
        (rig.acted(1, 0), rig.size(1, 0).unit.as_str()),
        ((3, 3.0), "steps")
    );
}

#[test]
fn a_lost_first_message_leaves_invalid_zeros() {
    let both = [on("link.sample", 0.0), on("link.command", 0.0)];
    let mut rig = Rig::new(&[until(lasting(2), event(1, "lost", at(0), &both))]);
    let passed = rig.run(3);
    for (k, passed) in (0..2).zip(&passed) {
        assert_eq!((passed.sample, passed.invalid & 0b111), ([0.0; 3], 0b111));
        assert_eq!(
            (
                passed.applied,
                passed.sample_age_steps,
                passed.command_age_steps
            ),
            ([0.0; 2], k + 1, k + 1)
        );
    }
    assert_eq!(
        (passed[2].sample, passed[2].invalid, passed[2].applied),
        ([2.0, 10.0, 5.0], 0, [2.0, -1.0])
    );
}

#[test]
fn faults_of_the_link_stack_and_each_has_its_own_size() {
    // All messages two steps late; of those sent from step 5 on, two in four get lost.
    let link = "link.sample";
    let mut rig = Rig::new(&[
        event(1, "late", at(1), &[on(link, 2.0)]),
        event(2, "lost", at(5), &[on_and_off(2, on(link, 0.0))]),
    ]);
    let passed = rig.each(12, |passed| (passed.sample[0], passed.sample_age_steps));
    assert_eq!(
        passed[..6],
        [(0.0, 0), (0.0, 1), (0.0, 2), (1.0, 2), (2.0, 2), (3.0, 2)]
    );
    // 5 and 6 never arrive; 7 and 8 do; 9 and 10 do not.
    assert_eq!(
        passed[6..],
        [(4.0, 2), (4.0, 3), (4.0, 4), (7.0, 2), (8.0, 2), (8.0, 3)]
    );
    assert_eq!((rig.acted(1, 0), rig.acted(2, 0)), ((11, 2.0), (4, 2.0)));
}

#[test]
fn the_age_of_a_command_sums_the_answers_and_the_transits() {
    let mut rig = Rig::new(&[event(1, "late", at(1), &[on("link.command", 2.0)])]);
    rig.answer.age_steps = 3;
    assert_eq!(rig.each(4, |passed| passed.command_age_steps), [3, 4, 5, 5]);
    assert_eq!(rig.acted(1, 0), (3, 2.0));
}

#[test]
fn a_corrupted_message_is_rejected_counted_and_as_good_as_lost() {
    let mut rig = Rig::new(&[until(
        lasting(2),
        event(1, "broken", at(2), &[on("link.command", 0.0)]),
    )]);
    assert_eq!(
        rig.each(5, |passed| passed.applied[0]),
        [0.0, 1.0, 1.0, 1.0, 4.0]
    );
    assert_eq!((rig.layer.rejected(), rig.acted(1, 0)), (2, (2, 2.0)));

    // Two faults that invert the same bit: the second undoes the first.
    let link = "link.sample";
    let mut rig = Rig::new(&[event(1, "broken", at(1), &[on(link, 0.0), on(link, 0.0)])]);
    let passed = rig.each(3, |passed| (passed.sample[0], passed.sample_age_steps));
    assert_eq!(passed, [(0.0, 0), (1.0, 0), (2.0, 0)]);
    assert_eq!(rig.layer.rejected(), 0);
    assert_eq!((rig.acted(1, 0), rig.acted(1, 1)), ((2, 2.0), (2, 2.0)));
}

#[test]
fn a_message_still_late_after_a_fault_does_not_replace_newer_ones() {
    let link = "link.sample";
    let late = |step, steps| until(lasting(steps), event(1, "late", at(step), &[on(link, 3.0)]));
    let lost = |step| event(2, "lost", at(step), &[on_and_off(1, on(link, 0.0))]);

    // Even messages get lost. Message 1 arrives at 4, when the receiver has nothing newer; the fault has ended then,
    // and message 3, which would arrive at 6, is older than 5.
    let mut rig = Rig::new(&[late(1, 3), lost(0)]);
    let values = rig.each(9, |passed| passed.sample[0]);
    assert_eq!(values, [0.0, 0.0, 0.0, 0.0, 1.0, 5.0, 5.0, 7.0, 7.0]);

    // Odd messages get lost. Message 2 would arrive at 5, after 4 did: the loss of 5 costs a step.
    let mut rig = Rig::new(&[late(0, 4), lost(1)]);
    let ages = rig.each(9, |passed| passed.sample_age_steps);
    assert_eq!(ages, [1, 2, 3, 3, 0, 1, 0, 1, 0]);
    assert_eq!((rig.acted(1, 0), rig.acted(2, 0)), ((4, 3.0), (4, 1.0)));
}

#[test]
fn signal_faults_act_before_sending_a_sample_and_after_receiving_a_command() {
    let late = event(
        1,
        "late",
        at(0),
        &[on("link.sample", 1.0), on("link.command", 1.0)],
    );
    let targets = ["measured.a_m", "command.u_n"];
    let mut rig = Rig::new(&[
        late,
        event(2, "plus", at(3), &targets.map(|target| on(target, 100.0))),
    ]);
    let passed = rig.each(5, |passed| (passed.sample[0], passed.applied[0]));
    assert_eq!(passed[2..], [(1.0, 1.0), (2.0, 102.0), (103.0, 103.0)]);
}

#[test]
fn a_dead_sensor_behind_a_late_link_keeps_the_last_sent_value() {
    let mut rig = Rig::new(&[
        event(1, "late", at(1), &[on("link.sample", 2.0)]),
        event(2, "gone", at(4), &[on("measured.a_m", 0.0)]),
    ]);
    let passed = rig.each(8, |passed| (passed.sample[0], passed.invalid));
    // Sent: 0 1 2 3 then 3, invalid, from step 4 on.
    assert_eq!(
        passed[3..],
        [(1.0, 0), (2.0, 0), (3.0, 0), (3.0, 1), (3.0, 1)]
    );
}
