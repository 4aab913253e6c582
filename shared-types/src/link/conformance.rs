//! What every link must do, run on each implementation.

use super::iceoryx::IceoryxLink;
use super::{FrameSpec, Link, LinkError, Peer};
use crate::frame::{FrameError, FrameKind, Header, Seal};
use crate::session::Session;
use crate::time::Step;

/// A connected pair, plant's end first, and whatever must outlive it.
trait Pair {
    type End: Link;
    type Keep;
    fn make() -> (Self::End, Self::End, Self::Keep);
    /// Another controller's end.
    fn another(controller: &Self::End, epoch: u32, keep: &Self::Keep) -> Self::End;
}

struct InProcess;

impl Pair for InProcess {
    type End = super::in_process::InProcessLink;
    type Keep = ();
    fn make() -> (Self::End, Self::End, ()) {
        let (plant, controller) = super::in_process::pair();
        (plant, controller, ())
    }
    fn another(controller: &Self::End, _epoch: u32, _keep: &()) -> Self::End {
        controller.another()
    }
}

struct Iceoryx;

impl Pair for Iceoryx {
    type End = super::iceoryx::IceoryxLink;
    type Keep = Session;
    fn make() -> (Self::End, Self::End, Session) {
        let session = Session::create(None).expect("a session");
        let plant = Self::End::create(session.info()).expect("creates");
        let controller = Self::End::open(session.info(), 1).expect("opens");
        (plant, controller, session)
    }
    fn another(_controller: &Self::End, epoch: u32, session: &Session) -> Self::End {
        Self::End::open(session.info(), epoch).expect("opens")
    }
}

const SEAL: Seal = Seal {
    session: 11,
    layout: 22,
    epoch: 1,
};

fn spec(outgoing: usize, incoming: usize) -> FrameSpec {
    FrameSpec {
        seal: SEAL,
        outgoing,
        incoming,
    }
}

fn connected<P: Pair>(samples: usize, commands: usize) -> (P::End, P::End, P::Keep) {
    let (mut plant, mut controller, keep) = P::make();
    plant
        .open_frames(&spec(samples, commands))
        .expect("plant opens");
    controller
        .open_frames(&spec(commands, samples))
        .expect("controller opens");
    (plant, controller, keep)
}

fn header(kind: FrameKind, step: u64) -> Header {
    Header::new(kind, Step(step))
}

fn control_messages_arrive_in_order_and_once<P: Pair>() {
    let (mut plant, mut controller, _keep) = P::make();
    let long = vec![7_u8; 100_000];
    controller.send_control(b"hello").expect("sends");
    controller.send_control(&long).expect("sends");
    assert_eq!(
        plant.receive_control().expect("polls").as_deref(),
        Some(&b"hello"[..])
    );
    assert_eq!(plant.receive_control().expect("polls"), Some(long));
    assert_eq!(plant.receive_control().expect("polls"), None);
    plant.send_control(b"welcome").expect("sends");
    assert_eq!(
        controller.receive_control().expect("polls").as_deref(),
        Some(&b"welcome"[..])
    );
}

fn frames_cross_both_ways<P: Pair>() {
    for (samples, commands) in [(1, 1), (16, 17), (40, 3), (100, 200), (512, 300), (0, 5)] {
        let (mut plant, mut controller, _keep) = connected::<P>(samples, commands);
        let sent: Vec<f64> = (0..samples).map(|i| i as f64 + 0.5).collect();
        let mut got = vec![0.0; samples];
        assert_eq!(controller.receive(&mut got), Ok(None));
        plant
            .send(&header(FrameKind::Sample, 0), &sent)
            .expect("sends");
        let arrived = controller
            .receive(&mut got)
            .expect("polls")
            .expect("a frame");
        assert_eq!(
            (arrived.step, arrived.sequence, arrived.kind()),
            (0, 1, Some(FrameKind::Sample))
        );
        assert_eq!(
            (arrived.session, arrived.layout, arrived.epoch),
            (11, 22, 1)
        );
        assert_eq!(got, sent);
        assert_eq!(
            controller.receive(&mut got),
            Ok(None),
            "a frame is delivered once"
        );
        let answer: Vec<f64> = (0..commands).map(|i| -(i as f64)).collect();
        let mut answered = vec![1.0; commands];
        controller
            .send(&header(FrameKind::Command, 0), &answer)
            .expect("sends");
        assert!(plant.receive(&mut answered).expect("polls").is_some());
        assert_eq!(answered, answer);
    }
}

fn the_latest_frame_wins<P: Pair>() {
    let (mut plant, mut controller, _keep) = connected::<P>(1, 1);
    for step in 0..5 {
        plant
            .send(&header(FrameKind::Sample, step), &[step as f64])
            .expect("sends");
    }
    let mut got = [0.0];
    let arrived = controller
        .receive(&mut got)
        .expect("polls")
        .expect("a frame");
    assert_eq!((arrived.step, got), (4, [4.0]));
    assert_eq!(controller.receive(&mut got), Ok(None));
}

fn frames_without_values_leave_the_buffer_alone<P: Pair>() {
    let (mut plant, mut controller, _keep) = connected::<P>(2, 1);
    plant.send(&header(FrameKind::End, 9), &[]).expect("sends");
    let mut got = [3.0, 4.0];
    let arrived = controller
        .receive(&mut got)
        .expect("polls")
        .expect("a frame");
    assert_eq!(
        (arrived.kind(), arrived.step, got),
        (Some(FrameKind::End), 9, [3.0, 4.0])
    );
}

fn a_frame_of_another_count_is_rejected_and_counted<P: Pair>() {
    let (mut plant, mut controller, _keep) = connected::<P>(2, 1);
    plant
        .send(&header(FrameKind::Sample, 0), &[1.0])
        .expect("sends");
    assert_eq!(controller.receive(&mut [0.0; 2]), Ok(None));
    assert_eq!(controller.rejected().count, 1);
    assert_eq!(controller.rejected().last, Some(FrameError::Count));
}

fn odd_numbers_arrive_canonical<P: Pair>() {
    let (mut plant, mut controller, _keep) = connected::<P>(3, 1);
    let odd = [-0.0, -f64::NAN, f64::INFINITY];
    plant
        .send(&header(FrameKind::Sample, 0), &odd)
        .expect("sends");
    let mut got = [1.0; 3];
    controller
        .receive(&mut got)
        .expect("polls")
        .expect("a frame");
    assert_eq!(
        got.map(f64::to_bits),
        [0.0, f64::NAN, f64::INFINITY].map(f64::to_bits)
    );
}

fn frames_before_opening_are_an_error<P: Pair>() {
    let (mut plant, _controller, _keep) = P::make();
    assert_eq!(
        plant.send(&header(FrameKind::Sample, 0), &[]),
        Err(LinkError::NotOpen)
    );
    assert_eq!(plant.receive(&mut []), Err(LinkError::NotOpen));
}

fn too_many_signals_are_refused<P: Pair>() {
    let (mut plant, _controller, _keep) = P::make();
    assert_eq!(
        plant.open_frames(&spec(513, 1)),
        Err(LinkError::TooManySignals(513))
    );
}

fn another_controller_takes_over_from_the_one_in_office<P: Pair>() {
    let (mut plant, mut controller, keep) = connected::<P>(1, 1);
    controller.send_control(b"old").expect("sends");
    plant.expect(2).expect("makes a channel");
    let mut other = P::another(&controller, 2, &keep);
    other.send_control(b"new").expect("sends");
    let heard = plant.receive_control().expect("polls");
    assert_eq!(heard.as_deref(), Some(&b"new"[..]), "only the new one");
    let second = FrameSpec {
        seal: Seal { epoch: 2, ..SEAL },
        outgoing: 1,
        incoming: 1,
    };
    plant.open_frames(&second).expect("opens beside the first");
    other.open_frames(&second).expect("opens");
    let mut got = [0.0];
    controller
        .send(&header(FrameKind::Command, 4), &[4.0])
        .expect("sends");
    let arrived = plant.receive(&mut got).expect("polls").expect("a frame");
    assert_eq!((arrived.epoch, got), (1, [4.0]), "the old one is in office");

    controller
        .send(&header(FrameKind::Command, 5), &[5.0])
        .expect("sends");
    plant.take_over();
    assert_eq!(
        plant.receive(&mut got),
        Ok(None),
        "the old controller's command is gone"
    );
    controller
        .send(&header(FrameKind::Command, 6), &[6.0])
        .expect("sends");
    assert_eq!(
        plant.receive(&mut got),
        Ok(None),
        "and so are its later ones"
    );
    other
        .send(&header(FrameKind::Command, 0), &[1.0])
        .expect("sends");
    let arrived = plant.receive(&mut got).expect("polls").expect("a frame");
    assert_eq!((arrived.epoch, arrived.sequence, got), (2, 1, [1.0]));
}

macro_rules! suite {
    ($($test:ident),+ $(,)?) => {
        mod in_process { $( #[test] fn $test() { super::$test::<super::InProcess>(); } )+ }
        mod iceoryx { $( #[test] fn $test() { super::$test::<super::Iceoryx>(); } )+ }
    };
}

suite!(
    control_messages_arrive_in_order_and_once,
    frames_cross_both_ways,
    the_latest_frame_wins,
    frames_without_values_leave_the_buffer_alone,
    a_frame_of_another_count_is_rejected_and_counted,
    odd_numbers_arrive_canonical,
    frames_before_opening_are_an_error,
    too_many_signals_are_refused,
    another_controller_takes_over_from_the_one_in_office,
);

#[test]
fn another_layout_cannot_open_the_frames() {
    let (mut plant, mut controller, _session) = Iceoryx::make();
    plant.open_frames(&spec(1, 1)).expect("plant opens");
    let other = FrameSpec {
        seal: Seal { layout: 23, ..SEAL },
        outgoing: 1,
        incoming: 1,
    };
    assert!(matches!(
        controller.open_frames(&other),
        Err(LinkError::Foreign { .. })
    ));
}

#[test]
fn a_second_plant_or_controller_is_refused() {
    let (_plant, _controller, session) = Iceoryx::make();
    let role = |second: Result<IceoryxLink, LinkError>| match second.err() {
        Some(LinkError::Taken { role, .. }) => role,
        other => panic!("{other:?}"),
    };
    assert_eq!(role(IceoryxLink::create(session.info())), "plant");
    assert_eq!(role(IceoryxLink::open(session.info(), 1)), "controller");
}

#[test]
fn only_the_process_that_was_launched_may_speak_for_the_controller() {
    let (mut plant, mut controller, mut session) = Iceoryx::make();
    assert_eq!(plant.peer(), Ok(Peer::Unknown));
    let own = std::process::id();
    session.add_controller(1, own).expect("noted");
    assert_eq!(plant.peer(), Ok(Peer::Launched));
    plant.open_frames(&spec(1, 1)).expect("plant opens");
    controller.open_frames(&spec(1, 1)).expect("opens");
    assert_eq!(plant.peer(), Ok(Peer::Launched));
    // Process 1 was launched, and this one speaks.
    session.add_controller(1, 1).expect("noted");
    match plant.peer() {
        Ok(Peer::Stranger(told)) => assert!(told.contains(&format!("process {own}")), "{told}"),
        other => panic!("{other:?}"),
    }
    // The control channel is still that of the first.
    session.add_controller(2, own).expect("noted");
    assert_eq!(plant.peer(), Ok(Peer::Unknown));
}

#[test]
fn a_controller_without_a_plant_finds_nothing() {
    let session = Session::create(None).expect("a session");
    let opened = IceoryxLink::open(session.info(), 1);
    assert!(matches!(opened, Err(LinkError::Absent { .. })));
}
