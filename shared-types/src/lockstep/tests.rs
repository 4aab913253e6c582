//! Both machines, alone and against each other, without a transport.

use super::*;
use crate::frame::{FrameKind, Header};
use crate::hello::{Control, Hello, Offer};
use crate::ignored::Reason;
use crate::table::Field;
use crate::time::Rate;

fn hello() -> Hello {
    Hello {
        measured: vec![Field::signal("angle_rad", "rad", "x")],
        ..Hello::new(5, "pid")
    }
}

fn offer<'a>(measured: &'a [Field], steps: u64) -> Offer<'a> {
    let rate = Rate::new(10.0).expect("legal");
    Offer {
        session: 5,
        epoch: 1,
        rate,
        steps,
        first: Step(0),
        against_clock: false,
        measured,
        reference: &[],
        commands: &[],
    }
}

fn header(kind: FrameKind, step: u64) -> Header {
    Header::new(kind, Step(step))
}

/// Creates a plant past hello that exchanges N steps.
fn plant(steps: u64) -> PlantSide {
    let hello = hello();
    let mut plant = PlantSide::new(steps);
    let welcomed = plant.on(&PlantEvent::Hello(&hello, &offer(&hello.measured, steps)));
    assert!(matches!(welcomed, PlantAction::Welcome(_)));
    assert_eq!(plant.on(&PlantEvent::Ready(1)), PlantAction::Nothing);
    plant
}

/// Checks the actions of a plant for a sequence of events.
fn answers<const N: usize>(plant: &mut PlantSide, course: [(PlantEvent<'_>, PlantAction); N]) {
    for (place, (event, action)) in course.into_iter().enumerate() {
        assert_eq!(plant.on(&event), action, "{place}: {event:?}");
    }
}

/// Creates a controller past hello.
fn controller() -> ControllerSide {
    controller_of(false)
}

/// Creates a controller past hello with a plant that may run against the clock.
fn controller_of(against_clock: bool) -> ControllerSide {
    let hello = hello();
    let mut controller = ControllerSide::new();
    let action = controller.on(&ControllerEvent::Begin(&hello));
    assert_eq!(action, ControllerAction::SendHello);
    let offer = Offer {
        against_clock,
        ..offer(&hello.measured, 3)
    };
    let welcome = crate::hello::agree(&hello, &offer).expect("agreed");
    let message = Control::Welcome(Box::new(welcome));
    let opened = controller.on(&ControllerEvent::Control(&message));
    assert!(matches!(opened, ControllerAction::OpenFrames(_)));
    let ready = controller.on(&ControllerEvent::Opened);
    assert_eq!(ready, ControllerAction::SendReady(1));
    controller
}

#[test]
fn both_sides_execute_the_same_steps_and_confirm_the_end() {
    let (mut plant, mut controller) = (plant(3), controller());
    for step in 0..3 {
        let action = plant.on(&PlantEvent::Release);
        assert_eq!(action, PlantAction::SendSample(Step(step)));
        let sample = header(FrameKind::Sample, step);
        let answer = controller.on(&ControllerEvent::Frame(&sample));
        assert_eq!(answer, ControllerAction::Answer(Step(step)));
        let command = header(FrameKind::Command, step);
        let applied = plant.on(&PlantEvent::Frame(&command));
        assert_eq!(applied, PlantAction::Apply(Step(step)));
    }
    let ended = plant.on(&PlantEvent::Release);
    assert_eq!(ended, PlantAction::SendEnd(Step(3)));
    let end = controller.on(&ControllerEvent::Frame(&header(FrameKind::End, 3)));
    assert_eq!(end, ControllerAction::ConfirmEnd(Step(3)));
    let confirmed = plant.on(&PlantEvent::Frame(&header(FrameKind::EndConfirmed, 3)));
    assert_eq!(confirmed, PlantAction::Finish);
    assert!(plant.is_over() && controller.is_over());
}

#[test]
fn a_resumed_run_begins_at_its_step_on_both_sides() {
    let hello = hello();
    let offer = Offer {
        first: Step(2),
        ..offer(&hello.measured, 3)
    };
    let mut plant = PlantSide::new(3).beginning_at(Step(2));
    let welcome = match plant.on(&PlantEvent::Hello(&hello, &offer)) {
        PlantAction::Welcome(welcome) => welcome,
        other => panic!("{other:?}"),
    };
    assert_eq!(plant.at(), Step(2));
    plant.on(&PlantEvent::Ready(1));
    assert_eq!(plant.unreleased(), Some(Step(2)));

    let mut controller = ControllerSide::new();
    controller.on(&ControllerEvent::Begin(&hello));
    // As received over the wire.
    let message = Control::from_bytes(&Control::Welcome(welcome).to_bytes()).expect("a welcome");
    controller.on(&ControllerEvent::Control(&message));
    controller.on(&ControllerEvent::Opened);
    assert_eq!(controller.at(), Step(2));
    let sample = header(FrameKind::Sample, 2);
    let answer = controller.on(&ControllerEvent::Frame(&sample));
    assert_eq!(answer, ControllerAction::Answer(Step(2)));
    let end = controller.on(&ControllerEvent::Frame(&header(FrameKind::End, 3)));
    assert_eq!(end, ControllerAction::ConfirmEnd(Step(3)));
}

#[test]
fn a_command_seen_twice_is_applied_once() {
    let mut plant = plant(3);
    plant.on(&PlantEvent::Release);
    let command = header(FrameKind::Command, 0);
    let repeated = PlantAction::Ignore(Reason::Repeated);
    let applied = plant.on(&PlantEvent::Frame(&command));
    assert_eq!(applied, PlantAction::Apply(Step(0)));
    assert_eq!(plant.on(&PlantEvent::Frame(&command)), repeated);
    plant.on(&PlantEvent::Release);
    assert_eq!(plant.on(&PlantEvent::Frame(&command)), repeated);
    assert_eq!(plant.ignored().of(Reason::Repeated), 2);
    let next = plant.on(&PlantEvent::Frame(&header(FrameKind::Command, 1)));
    assert_eq!(next, PlantAction::Apply(Step(1)));
}

#[test]
fn a_sample_seen_twice_is_answered_once() {
    let mut controller = controller();
    let sample = header(FrameKind::Sample, 0);
    let answer = controller.on(&ControllerEvent::Frame(&sample));
    assert_eq!(answer, ControllerAction::Answer(Step(0)));
    let again = controller.on(&ControllerEvent::Frame(&sample));
    assert_eq!(again, ControllerAction::Ignore);
}

#[test]
fn a_command_from_the_future_is_a_broken_protocol() {
    let mut plant = plant(3);
    plant.on(&PlantEvent::Release);
    let action = plant.on(&PlantEvent::Frame(&header(FrameKind::Command, 1)));
    assert!(matches!(
        action,
        PlantAction::Abort(Abort::Protocol { at: Step(0), .. })
    ));
    assert!(plant.is_over());
}

#[test]
fn a_command_before_its_sample_is_a_broken_protocol() {
    let mut plant = plant(3);
    let action = plant.on(&PlantEvent::Frame(&header(FrameKind::Command, 0)));
    assert!(
        matches!(action, PlantAction::Abort(Abort::Protocol { .. })),
        "{action:?}"
    );
}

#[test]
fn a_skipped_sample_is_a_broken_protocol() {
    let mut controller = controller();
    let action = controller.on(&ControllerEvent::Frame(&header(FrameKind::Sample, 1)));
    assert!(matches!(
        action,
        ControllerAction::Abort(Abort::Protocol { .. })
    ));
}

#[test]
fn an_early_end_is_not_confirmed() {
    let mut controller = controller();
    controller.on(&ControllerEvent::Frame(&header(FrameKind::Sample, 0)));
    let action = controller.on(&ControllerEvent::Frame(&header(FrameKind::End, 3)));
    let ControllerAction::Abort(abort) = action else {
        panic!("{action:?}")
    };
    let text =
        "plant broke the protocol at step 1: it ends after 3 steps, but 1 were executed here";
    assert_eq!(abort.to_string(), text);
}

#[test]
fn a_confirmation_of_another_step_fails_the_barrier() {
    let mut plant = plant(1);
    plant.on(&PlantEvent::Release);
    plant.on(&PlantEvent::Frame(&header(FrameKind::Command, 0)));
    plant.on(&PlantEvent::Release);
    let action = plant.on(&PlantEvent::Frame(&header(FrameKind::EndConfirmed, 0)));
    assert!(matches!(action, PlantAction::Abort(Abort::Protocol { .. })));
}

#[test]
fn every_timeout_of_the_plant_names_the_peer_and_the_awaited_action() {
    let late = |mut plant: PlantSide| match plant.on(&PlantEvent::Deadline(5000)) {
        PlantAction::Abort(abort) => abort.to_string(),
        other => panic!("{other:?}"),
    };
    assert_eq!(
        late(PlantSide::new(3)),
        "controller did not say hello within 5 s"
    );
    let mut waiting = plant(3);
    let idle = waiting.on(&PlantEvent::Deadline(5000));
    assert_eq!(idle, PlantAction::Nothing, "no wait is pending");
    waiting.on(&PlantEvent::Release);
    assert_eq!(late(waiting), "controller did not answer step 0 within 5 s");
    let mut ending = plant(0);
    ending.on(&PlantEvent::Release);
    assert_eq!(
        late(ending),
        "controller did not confirm the end after 0 steps within 5 s"
    );
}

#[test]
fn every_timeout_of_the_controller_names_the_peer_and_the_awaited_action() {
    let late = |mut controller: ControllerSide| match controller.on(&ControllerEvent::Deadline(200))
    {
        ControllerAction::Abort(abort) => abort.to_string(),
        other => panic!("{other:?}"),
    };
    let text = "plant did not create the session's link within 0.2 s";
    assert_eq!(late(ControllerSide::new()), text);
    assert_eq!(late(controller()), "plant did not send step 0 within 0.2 s");
}

#[test]
fn stop_and_loss_end_every_state() {
    let stopped = PlantSide::new(1).on(&PlantEvent::Stop);
    assert_eq!(stopped, PlantAction::Abort(Abort::Stopped { at: Step(0) }));
    let mut running = plant(3);
    running.on(&PlantEvent::Release);
    let abort = Abort::Gone {
        peer: "controller",
        at: Step(0),
    };
    let lost = running.on(&PlantEvent::PeerGone(1));
    assert_eq!(lost, PlantAction::Abort(abort));
    let over = running.on(&PlantEvent::Release);
    assert_eq!(over, PlantAction::Nothing, "the run stays over");
    let mut answering = controller();
    answering.on(&ControllerEvent::Frame(&header(FrameKind::Sample, 0)));
    let stopped = ControllerAction::Abort(Abort::Stopped { at: Step(1) });
    assert_eq!(answering.on(&ControllerEvent::Stop), stopped);
}

#[test]
fn an_abort_is_passed_on_with_its_reason() {
    let mut controller = controller();
    let abort = Header {
        directive: AbortCode::Diverged as u64,
        ..header(FrameKind::Abort, 0)
    };
    let action = controller.on(&ControllerEvent::Frame(&abort));
    let ControllerAction::Abort(abort) = action else {
        panic!("{action:?}")
    };
    assert_eq!(
        abort.to_string(),
        "plant gave up at step 0: the plant left its range of validity"
    );
}

#[test]
fn a_refusal_ends_both_sides() {
    let hello = Hello {
        session: 6,
        ..hello()
    };
    let mut plant = PlantSide::new(3);
    let action = plant.on(&PlantEvent::Hello(&hello, &offer(&hello.measured, 3)));
    let PlantAction::Refuse(reason) = action else {
        panic!("{action:?}")
    };
    assert!(plant.is_over());
    let mut controller = ControllerSide::new();
    controller.on(&ControllerEvent::Begin(&hello));
    let action = controller.on(&ControllerEvent::Control(&Control::Refusal {
        reason: reason.clone(),
    }));
    assert_eq!(action, ControllerAction::Abort(Abort::Refused(reason)));
}

#[test]
fn a_ready_of_another_epoch_does_not_start_the_run() {
    let hello = hello();
    let mut plant = PlantSide::new(3);
    plant.on(&PlantEvent::Hello(&hello, &offer(&hello.measured, 3)));
    let of_another = PlantAction::Ignore(Reason::Epoch);
    assert_eq!(plant.on(&PlantEvent::Ready(2)), of_another);
    assert_eq!(plant.unreleased(), None);
    assert!(plant.is_greeting());
}

#[test]
fn in_real_time_a_missed_command_is_held_and_a_late_one_stored() {
    let mut plant = plant(3).against_clock();
    let commands = [0, 1, 2].map(|step| header(FrameKind::Command, step));
    let confirmed = header(FrameKind::EndConfirmed, 3);
    let repeated = PlantAction::Ignore(Reason::Repeated);
    answers(
        &mut plant,
        [
            (PlantEvent::Release, PlantAction::SendSample(Step(0))),
            (PlantEvent::Missed, PlantAction::Hold(Step(0))),
            (PlantEvent::Release, PlantAction::SendSample(Step(1))),
            (PlantEvent::Frame(&commands[0]), PlantAction::Keep),
            (PlantEvent::Missed, PlantAction::Hold(Step(1))),
            (PlantEvent::Release, PlantAction::SendSample(Step(2))),
            (PlantEvent::Frame(&commands[2]), PlantAction::Apply(Step(2))),
            (PlantEvent::Release, PlantAction::SendEnd(Step(3))),
            (PlantEvent::Frame(&commands[1]), repeated),
            (PlantEvent::Frame(&confirmed), PlantAction::Finish),
        ],
    );
}

#[test]
fn in_lockstep_no_deadline_is_missed_and_a_late_command_changes_nothing() {
    let first = header(FrameKind::Command, 0);
    let repeated = PlantAction::Ignore(Reason::Repeated);
    answers(
        &mut plant(3),
        [
            (PlantEvent::Release, PlantAction::SendSample(Step(0))),
            (PlantEvent::Missed, PlantAction::Nothing),
            (PlantEvent::Frame(&first), PlantAction::Apply(Step(0))),
            (PlantEvent::Release, PlantAction::SendSample(Step(1))),
            (PlantEvent::Frame(&first), repeated),
        ],
    );
}

#[test]
fn samples_may_be_missed_in_real_time_only() {
    let sample = |step| header(FrameKind::Sample, step);
    let mut controller = controller_of(true);
    for step in [0, 2, 5] {
        let answer = controller.on(&ControllerEvent::Frame(&sample(step)));
        assert_eq!(answer, ControllerAction::Answer(Step(step)));
    }
    let again = controller.on(&ControllerEvent::Frame(&sample(2)));
    assert_eq!(again, ControllerAction::Ignore);
    let end = controller.on(&ControllerEvent::Frame(&header(FrameKind::End, 9)));
    assert_eq!(end, ControllerAction::ConfirmEnd(Step(9)));

    let mut controller = controller_of(false);
    let skipped = controller.on(&ControllerEvent::Frame(&sample(2)));
    assert!(matches!(
        skipped,
        ControllerAction::Abort(Abort::Protocol { .. })
    ));
}

#[test]
fn in_real_time_only_a_command_newer_than_all_before_is_stored() {
    let mut plant = plant(9).against_clock();
    let command = |step| header(FrameKind::Command, step);
    for step in 0..5 {
        plant.on(&PlantEvent::Release);
        if step < 4 {
            assert_eq!(plant.on(&PlantEvent::Missed), PlantAction::Hold(Step(step)));
        }
    }
    for (step, action) in [
        (1, PlantAction::Keep),
        (1, PlantAction::Ignore(Reason::Repeated)),
        (0, PlantAction::Ignore(Reason::Repeated)),
        (3, PlantAction::Keep),
        (2, PlantAction::Ignore(Reason::Repeated)),
        (4, PlantAction::Apply(Step(4))),
    ] {
        let before = plant.standing();
        let moves = !matches!(action, PlantAction::Ignore(_));
        assert_eq!(plant.on(&PlantEvent::Frame(&command(step))), action);
        assert_eq!(plant.standing() != before, moves, "command {step}");
    }
}

#[test]
fn two_different_answers_to_one_step_are_a_broken_protocol() {
    let text = "controller broke the protocol at step 1: it answered step 0 twice, with different commands";
    for on_loss in [OnLoss::Abort, OnLoss::Hold] {
        let mut plant = plant(3).on_loss(on_loss);
        plant.on(&PlantEvent::Release);
        plant.on(&PlantEvent::Frame(&header(FrameKind::Command, 0)));
        plant.on(&PlantEvent::Release);
        let (PlantAction::Abort(why) | PlantAction::Lose(why)) =
            plant.on(&PlantEvent::Contradiction(Step(0)))
        else {
            panic!("it is taken");
        };
        assert_eq!(why.to_string(), text);
        assert_eq!(plant.is_over(), on_loss == OnLoss::Abort);
    }
}

#[test]
fn each_ignored_message_is_counted_by_reason() {
    let hello = hello();
    let mut plant = plant(3).against_clock().on_loss(OnLoss::Hold);
    let offer = offer(&hello.measured, 3);
    let mut reason_of = |event: PlantEvent<'_>| match plant.on(&event) {
        PlantAction::Ignore(reason) => Some(reason),
        _ => None,
    };
    assert_eq!(reason_of(PlantEvent::Ready(1)), Some(Reason::OutOfTurn));
    assert_eq!(reason_of(PlantEvent::Ready(7)), Some(Reason::Epoch));
    assert_eq!(
        reason_of(PlantEvent::Hello(&hello, &offer)),
        Some(Reason::OutOfTurn)
    );
    for _ in 0..3 {
        assert_eq!(reason_of(PlantEvent::Release), None);
        assert_eq!(reason_of(PlantEvent::Missed), None);
    }
    assert_eq!(reason_of(PlantEvent::Release), None);
    let command = header(FrameKind::Command, 2);
    assert_eq!(reason_of(PlantEvent::Frame(&command)), Some(Reason::Late));
    assert_eq!(reason_of(PlantEvent::PeerGone(1)), None);
    assert_eq!(reason_of(PlantEvent::Frame(&command)), Some(Reason::Lost));
    assert_eq!(reason_of(PlantEvent::PeerGone(1)), None);
    let ignored = plant.ignored();
    assert_eq!((ignored.total(), ignored.of(Reason::OutOfTurn)), (5, 2));
}
