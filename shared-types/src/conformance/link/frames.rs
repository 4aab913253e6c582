//! Control messages and frames of one pair.

use std::thread::yield_now;

use super::{
    Fixture, IDENTITY, Pair, awaited, command, frame, message, open, sample, send, silence, spec,
};
use crate::frame::{FrameError, FrameIdentity, FrameKind, Header, MAX_SIGNALS};
use crate::link::{FrameSpec, Link, LinkError, Peer};
use crate::time::Step;

/// Control messages of any length arrive in order and exactly once.
pub fn control_messages_arrive_in_order_and_once<F: Fixture>() {
    let Pair {
        mut plant,
        mut controller,
        place: _place,
    } = Pair::<F>::new();
    let long = vec![7_u8; 100_000];
    controller.send_control(b"hello").expect("sends");
    controller.send_control(&long).expect("sends");
    assert_eq!(message::<F>(&mut plant), b"hello");
    assert_eq!(message::<F>(&mut plant), long);
    assert_eq!(plant.receive_control(), Ok(None), "it came already");
    plant.send_control(b"welcome").expect("sends");
    assert_eq!(message::<F>(&mut controller), b"welcome");
    assert_eq!(controller.receive_control(), Ok(None), "it came already");
}

/// A side may send its whole greeting before the other one listens.
pub fn eight_control_messages_may_wait<F: Fixture>() {
    let mut pair = Pair::<F>::new();
    for number in 0..8_u8 {
        let message = vec![number; 1 + usize::from(number)];
        pair.controller.send_control(&message).expect("sends");
    }
    for number in 0..8_u8 {
        let expected = vec![number; 1 + usize::from(number)];
        assert_eq!(message::<F>(&mut pair.plant), expected);
    }
}

/// Frames of every size class arrive once, with their values, kind, identity and number.
pub fn frames_cross_both_ways<F: Fixture>() {
    for (samples, commands) in [(1, 1), (16, 17), (40, 3), (100, 200), (512, 300), (0, 5)] {
        let mut pair = Pair::<F>::open(samples, commands);
        let (plant, controller) = (&mut pair.plant, &mut pair.controller);
        let expected: Vec<f64> = (0..samples).map(|i| i as f64 + 0.5).collect();
        let mut values = vec![0.0; samples];
        silence::<F>(controller, &mut values, "nothing was sent");
        sample(plant, 0, &expected);
        let arrived = frame::<F>(controller, &mut values);
        assert_eq!(
            (arrived.step, arrived.sequence, arrived.kind()),
            (0, 1, Some(FrameKind::Sample))
        );
        assert_eq!(
            (arrived.session, arrived.layout, arrived.epoch),
            (11, 22, 1)
        );
        assert_eq!(usize::from(arrived.count), samples);
        assert_eq!(values, expected);
        silence::<F>(controller, &mut values, "a frame is delivered once");
        let answer: Vec<f64> = (0..commands).map(|i| -1.0 - i as f64).collect();
        let mut answer_values = vec![1.0; commands];
        command(controller, 0, &answer);
        frame::<F>(plant, &mut answer_values);
        assert_eq!(answer_values, answer);
    }
}

/// Every header field set by the sender arrives unchanged.
pub fn every_field_of_a_header_crosses<F: Fixture>() {
    let mut pair = Pair::<F>::open(512, 1);
    let header = Header {
        time_ns: 1 << 40,
        work_ns: 2,
        directive: u64::MAX,
        surroundings: 3,
        tuning: 6,
        age_steps: 4,
        held_steps: 5,
        invalid: [1, 1 << 35, 0, 0, 0, 0, 0, 1 << 63],
        ..Header::new(FrameKind::Sample, Step(1 << 50))
    };
    pair.plant.send(&header, &[0.0; 512]).expect("sends");
    let arrived = frame::<F>(&mut pair.controller, &mut [0.0; 512]);
    let Header {
        session,
        layout,
        sequence,
        epoch,
        count,
        ..
    } = arrived;
    let expected = Header {
        session,
        layout,
        sequence,
        epoch,
        count,
        ..header
    };
    assert_eq!(arrived, expected);
}

/// Lockstep loses, repeats and alters no frame.
pub fn each_of_many_samples_is_answered_once<F: Fixture>() {
    let mut pair = Pair::<F>::open(3, 2);
    for step in 0..2000 {
        let value = step as f64;
        let (mut sampled, mut answer) = ([0.0; 3], [0.0; 2]);
        sample(&mut pair.plant, step, &[value, -value, 0.5 * value]);
        let header = frame::<F>(&mut pair.controller, &mut sampled);
        assert_eq!((header.step, header.sequence), (step, step + 1));
        assert_eq!(sampled, [value, -value, 0.5 * value], "step {step}");
        command(&mut pair.controller, step, &[2.0 * value, value]);
        let header = frame::<F>(&mut pair.plant, &mut answer);
        assert_eq!((header.step, header.sequence), (step, step + 1));
        assert_eq!(answer, [2.0 * value, value], "step {step}");
    }
}

/// A link holds only the latest frame; it does not queue.
pub fn the_latest_frame_wins<F: Fixture>() {
    let mut pair = Pair::<F>::open(1, 1);
    for step in 0..5 {
        sample(&mut pair.plant, step, &[step as f64]);
    }
    std::thread::sleep(F::LATENCY);
    let mut values = [0.0];
    let arrived = frame::<F>(&mut pair.controller, &mut values);
    assert_eq!((arrived.step, arrived.sequence, values), (4, 5, [4.0]));
    silence::<F>(&mut pair.controller, &mut values, "older ones are gone");
}

/// A sender never waits, however many frames are pending; the newest frame still arrives.
pub fn an_end_that_never_receives_holds_nobody_up<F: Fixture>() {
    let mut pair = Pair::<F>::open(512, 1);
    for step in 0..5000 {
        sample(&mut pair.plant, step, &[step as f64; 512]);
    }
    let mut values = [0.0; 512];
    awaited::<F, _>("newest frame", || {
        // A frame that a full channel rejected is sent when its sender next polls for frames.
        assert_eq!(pair.plant.receive(&mut [0.0]), Ok(None));
        let arrived = pair.controller.receive(&mut values).expect("receives");
        arrived.filter(|header| header.step == 4999)
    });
    assert_eq!(values, [4999.0; 512]);
}

/// A received frame is never a mix of two frames. Trivially true for a link within one thread.
pub fn frames_are_whole_while_both_ends_work<F: Fixture>() {
    const LAST: u64 = 5000;
    let mut place = F::new();
    let mut plant = place.plant();
    let Some(opens) = place.controller_elsewhere() else {
        return;
    };
    open(&mut plant, 1, 512, 1);
    let receives = std::thread::spawn(move || {
        let mut controller = opens();
        open(&mut controller, 1, 1, 512);
        command(&mut controller, 0, &[0.0]);
        let (mut values, mut newest) = ([0.0; 512], 0);
        while newest < LAST {
            let header = frame::<F>(&mut controller, &mut values);
            assert!(header.step > newest, "{} after {newest}", header.step);
            newest = header.step;
            assert_eq!(values, [newest as f64; 512], "step {newest}");
        }
        assert_eq!(controller.rejected().total(), 0);
    });
    frame::<F>(&mut plant, &mut [0.0]);
    for step in 1..=LAST {
        sample(&mut plant, step, &[step as f64; 512]);
    }
    while !receives.is_finished() {
        assert_eq!(plant.receive(&mut [0.0]), Ok(None));
        yield_now();
    }
    receives.join().expect("every frame is whole");
}

/// End, confirmation and abort frames carry no values.
pub fn frames_without_values_leave_the_buffer_alone<F: Fixture>() {
    let mut pair = Pair::<F>::open(2, 1);
    send(&mut pair.plant, FrameKind::End, 9, &[]);
    let mut values = [3.0, 4.0];
    let arrived = frame::<F>(&mut pair.controller, &mut values);
    assert_eq!(
        (arrived.kind(), arrived.step, values),
        (Some(FrameKind::End), 9, [3.0, 4.0])
    );
}

/// Numbers are made canonical in transit: one NaN, no negative zero.
pub fn odd_numbers_arrive_canonical<F: Fixture>() {
    let mut pair = Pair::<F>::open(3, 1);
    sample(&mut pair.plant, 0, &[-0.0, -f64::NAN, f64::INFINITY]);
    let mut values = [1.0; 3];
    frame::<F>(&mut pair.controller, &mut values);
    let expected = [0.0, f64::NAN, f64::INFINITY];
    assert_eq!(values.map(f64::to_bits), expected.map(f64::to_bits));
}

/// A frame whose number of values differs from the agreed one is not delivered.
pub fn a_frame_of_another_count_is_rejected_and_counted<F: Fixture>() {
    let mut pair = Pair::<F>::open(2, 1);
    sample(&mut pair.plant, 0, &[1.0]);
    rejects::<F>(&mut pair.controller, FrameError::Count);
}

/// Polls until a frame is rejected for this reason.
fn rejects<F: Fixture>(end: &mut F::Link, reason: FrameError) {
    let mut values = [7.0; 2];
    let rejected = awaited::<F, _>("refusal", || {
        assert_eq!(end.receive(&mut values), Ok(None));
        Some(end.rejected()).filter(|rejected| !rejected.is_empty())
    });
    assert_eq!((rejected.total(), rejected.of(reason.into())), (1, 1));
    assert_eq!(values, [7.0; 2], "a refused frame leaves the buffer alone");
}

/// Frames of another session or layout either cannot be opened or are rejected one by one.
pub fn frames_of_another_run_are_never_delivered<F: Fixture>() {
    let session = FrameIdentity {
        session: 12,
        ..IDENTITY
    };
    let layout = FrameIdentity {
        layout: 23,
        ..IDENTITY
    };
    for (identity, reason) in [(session, FrameError::Session), (layout, FrameError::Layout)] {
        let mut pair = Pair::<F>::new();
        open(&mut pair.plant, 1, 2, 1);
        let other = FrameSpec {
            identity,
            ..spec(1, 1, 2)
        };
        match pair.controller.open_frames(&other) {
            Err(error) => assert!(matches!(error, LinkError::Foreign { .. }), "{error}"),
            Ok(()) => {
                sample(&mut pair.plant, 0, &[1.0, 2.0]);
                rejects::<F>(&mut pair.controller, reason);
            }
        }
    }
}

/// No frame is sent or received before both sides agree on the layout.
pub fn frames_before_opening_are_an_error<F: Fixture>() {
    let mut pair = Pair::<F>::new();
    let header = Header::new(FrameKind::Sample, Step(0));
    assert_eq!(pair.plant.send(&header, &[]), Err(LinkError::NotOpen));
    assert_eq!(pair.plant.receive(&mut []), Err(LinkError::NotOpen));
}

/// More signals than a frame can carry are rejected with their number.
pub fn too_many_signals_are_refused<F: Fixture>() {
    let mut pair = Pair::<F>::new();
    for (outgoing, incoming) in [(MAX_SIGNALS + 1, 1), (1, MAX_SIGNALS + 1)] {
        let opened = pair.plant.open_frames(&spec(1, outgoing, incoming));
        assert_eq!(opened, Err(LinkError::TooManySignals(MAX_SIGNALS + 1)));
    }
}

/// The plant recognises the controller of its own pair, or does not know it yet.
pub fn the_peer_of_a_pair_is_no_stranger<F: Fixture>() {
    let pair = Pair::<F>::open(1, 1);
    let peer = pair.plant.peer().expect("it can be asked");
    assert!(matches!(peer, Peer::Launched | Peer::Unknown), "{peer:?}");
}
