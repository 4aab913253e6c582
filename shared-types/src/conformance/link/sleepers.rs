//! Sleeping until the other side sends. Trivially true for a link whose sends wake nobody.

use std::time::Instant;

use super::{Fixture, Pair, command, open, sample};
use crate::link::Link;
use crate::wait::Sleeper;

/// Sleeps, and checks that a ring ends the sleep before its time limit.
fn nap<F: Fixture>(sleeper: &dyn Sleeper, announced: u32, what: &str) {
    let since = Instant::now();
    sleeper.sleep(announced, 2 * F::PATIENCE.as_nanos() as u64);
    assert!(since.elapsed() < F::PATIENCE, "{what} wakes nobody");
    sleeper.retire();
}

/// A frame or control message sent between the announcement of a sleep and the sleep itself ends the sleep, also one
/// from another controller.
pub fn what_is_sent_ends_an_announced_sleep<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    let sleepers = (pair.plant.sleeper(), pair.controller.sleeper());
    let (Some(plant), Some(controller)) = sleepers else {
        return;
    };
    let announced = controller.announce();
    sample(&mut pair.plant, 0, &[1.0]);
    nap::<F>(&*controller, announced, "a sample");
    let announced = plant.announce();
    command(&mut pair.controller, 0, &[1.0]);
    nap::<F>(&*plant, announced, "a command");
    let announced = controller.announce();
    pair.plant.send_control(b"news").expect("sends");
    nap::<F>(&*controller, announced, "the plant's message");
    let announced = plant.announce();
    pair.controller.send_control(b"news").expect("sends");
    nap::<F>(&*plant, announced, "the controller's message");

    pair.plant.expect(2).expect("another is expected");
    let mut second = pair.place.controller(2);
    let candidate = second.sleeper().expect("a sleeper, as the first has");
    let announced = plant.announce();
    second.send_control(b"hello").expect("sends");
    nap::<F>(&*plant, announced, "a candidate's message");
    let announced = candidate.announce();
    pair.plant.send_control(b"welcome").expect("sends");
    nap::<F>(&*candidate, announced, "the plant's message to a candidate");
    open(&mut pair.plant, 2, 1, 1);
    open(&mut second, 2, 1, 1);
    let announced = controller.announce();
    sample(&mut pair.plant, 1, &[1.0]);
    nap::<F>(&*controller, announced, "a sample to the active controller");
    pair.plant.take_over();
    let announced = candidate.announce();
    sample(&mut pair.plant, 2, &[1.0]);
    nap::<F>(&*candidate, announced, "a sample to the new controller");
}

/// Two threads that sleep whenever nothing has arrived keep exchanging frames.
pub fn no_sleeper_is_left_asleep<F: Fixture>() {
    const STEPS: u64 = 5000;
    let mut place = F::new();
    let Some(opens) = place.controller_elsewhere() else {
        return;
    };
    let mut plant = place.plant();
    let Some(bell) = plant.sleeper() else {
        return;
    };
    open(&mut plant, 1, 1, 1);
    let controller = std::thread::spawn(move || {
        let mut controller = opens();
        let bell = controller.sleeper().expect("a sleeper, as the plant has");
        open(&mut controller, 1, 1, 1);
        controller.send_control(b"ready").expect("sends");
        for step in 0..STEPS {
            sleep_until::<F>(&*bell, &mut controller, step);
            command(&mut controller, step, &[0.0]);
        }
    });
    super::message::<F>(&mut plant);
    for step in 0..STEPS {
        sample(&mut plant, step, &[0.0]);
        sleep_until::<F>(&*bell, &mut plant, step);
    }
    controller.join().expect("a controller to the end");
}

/// Sleeps until the frame of a step arrives.
fn sleep_until<F: Fixture>(sleeper: &dyn Sleeper, end: &mut F::Link, step: u64) {
    let mut values = [0.0];
    loop {
        let announced = sleeper.announce();
        let came = end.receive(&mut values).expect("an end receives");
        if came.is_some_and(|header| header.step == step) {
            return sleeper.retire();
        }
        nap::<F>(sleeper, announced, "a frame");
    }
}
