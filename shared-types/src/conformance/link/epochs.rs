//! Deaths, closes and handovers.

use super::{Fixture, Pair, command, frame, message, open, sample, send, silence};
use crate::frame::FrameKind;
use crate::link::Link;

/// Connects a second controller while the first one is active, up to the handover.
fn second<F: Fixture>(plant: &mut F::Link, place: &mut F) -> F::Link {
    plant.expect(2).expect("another is expected");
    let mut second = place.controller(2);
    second.send_control(b"new").expect("sends");
    assert_eq!(message::<F>(plant), b"new", "only the new one is received");
    open(plant, 2, 1, 1);
    open(&mut second, 2, 1, 1);
    second
}

/// Hands over to the second controller and exchanges one sample with it.
fn hand_over<F: Fixture>(plant: &mut F::Link, second: &mut F::Link) {
    let mut values = [0.0];
    plant.take_over();
    silence::<F>(plant, &mut values, "an older epoch's command is gone");
    sample(plant, 7, &[7.0]);
    let arrived = frame::<F>(second, &mut values);
    assert_eq!((arrived.epoch, arrived.sequence, values), (2, 1, [7.0]));
    command(second, 7, &[1.0]);
    let arrived = frame::<F>(plant, &mut values);
    assert_eq!((arrived.epoch, arrived.sequence, values), (2, 1, [1.0]));
}

/// A controller is active until the handover and ignored afterwards.
pub fn another_controller_takes_over_from_the_active_one<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    pair.controller.send_control(b"old").expect("sends");
    let mut second = second(&mut pair.plant, &mut pair.place);
    let mut values = [0.0];
    command(&mut pair.controller, 4, &[4.0]);
    let arrived = frame::<F>(&mut pair.plant, &mut values);
    assert_eq!(
        (arrived.epoch, values),
        (1, [4.0]),
        "the first one is active"
    );

    command(&mut pair.controller, 5, &[5.0]);
    hand_over::<F>(&mut pair.plant, &mut second);
    command(&mut pair.controller, 6, &[6.0]);
    silence::<F>(&mut pair.plant, &mut values, "the first one is not active");
}

/// Only the active controller receives the plant's messages before the handover, and only its successor afterwards.
pub fn the_active_controller_is_told_while_another_is_expected<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    pair.plant.tell(b"alone").expect("tells");
    assert_eq!(message::<F>(&mut pair.controller), b"alone");
    let mut second = second(&mut pair.plant, &mut pair.place);
    pair.plant.tell(b"active").expect("tells");
    pair.plant.send_control(b"welcome").expect("sends");
    assert_eq!(message::<F>(&mut second), b"welcome");
    assert_eq!(message::<F>(&mut pair.controller), b"active");
    let mut values = [0.0];
    silence::<F>(&mut second, &mut values, "it was sent to the other one");
    pair.plant.take_over();
    pair.plant.tell(b"next").expect("tells");
    assert_eq!(message::<F>(&mut second), b"next");
    let control = pair.controller.receive_control();
    assert_eq!(control, Ok(None), "the first one is not active");
}

/// The last command of a dead controller counts; the silence after it is no error.
pub fn a_dead_controller_is_silent_after_its_last_frame<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    sample(&mut pair.plant, 3, &[3.0]);
    command(&mut pair.controller, 3, &[5.0]);
    pair.place.kill(pair.controller);
    last_frame_and_silence::<F>(&mut pair.plant, FrameKind::Sample);
}

/// The last sample of a dead plant counts; the silence after it is no error.
pub fn a_dead_plant_is_silent_after_its_last_frame<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    command(&mut pair.controller, 2, &[2.0]);
    sample(&mut pair.plant, 3, &[5.0]);
    pair.place.kill(pair.plant);
    last_frame_and_silence::<F>(&mut pair.controller, FrameKind::Command);
}

fn last_frame_and_silence<F: Fixture>(end: &mut F::Link, sends: FrameKind) {
    let mut values = [0.0];
    let arrived = frame::<F>(end, &mut values);
    assert_eq!((arrived.step, values), (3, [5.0]));
    for step in 4..50 {
        send(end, sends, step, &[0.0]);
        silence::<F>(end, &mut values, "nobody answers");
    }
}

/// A run continues with a standby controller that was ready before the first one died.
pub fn another_controller_follows_a_dead_one<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    let mut second = second(&mut pair.plant, &mut pair.place);
    pair.place.kill(pair.controller);
    sample(&mut pair.plant, 6, &[6.0]);
    silence::<F>(&mut pair.plant, &mut [0.0], "the active one is dead");
    hand_over::<F>(&mut pair.plant, &mut second);
}

/// Either end may close first, even in the middle of an exchange.
pub fn an_end_that_closes_holds_nobody_up<F: Fixture>() {
    for plant_first in [true, false] {
        let mut pair = Pair::<F>::open(1, 1);
        pair.plant.send_control(b"word").expect("sends");
        sample(&mut pair.plant, 1, &[1.0]);
        command(&mut pair.controller, 1, &[1.0]);
        let (first, second) = if plant_first {
            (pair.plant, pair.controller)
        } else {
            (pair.controller, pair.plant)
        };
        drop(first);
        drop(second);
    }
}
