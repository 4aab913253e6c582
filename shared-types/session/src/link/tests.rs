//! Properties specific to the link over shared memory; `conformance` covers those of every link.

use super::iceoryx::IceoryxLink;
use crate::session::Session;
use shared_types::frame::FrameIdentity;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};

fn spec() -> FrameSpec {
    FrameSpec {
        identity: FrameIdentity {
            session: 11,
            layout: 22,
            epoch: 1,
        },
        outgoing: 1,
        incoming: 1,
    }
}

fn pair() -> (IceoryxLink, IceoryxLink, Session) {
    let session = Session::create(None).expect("a session");
    let plant = IceoryxLink::create(session.info()).expect("creates");
    let controller = IceoryxLink::open(session.info(), 1).expect("opens");
    (plant, controller, session)
}

#[test]
fn another_layout_cannot_open_the_frames() {
    let (mut plant, mut controller, _session) = pair();
    plant.open_frames(&spec()).expect("plant opens");
    let mut other = spec();
    other.identity.layout = 23;
    assert!(matches!(
        controller.open_frames(&other),
        Err(LinkError::Foreign { .. })
    ));
}

#[test]
fn a_second_plant_or_controller_is_refused() {
    let (_plant, _controller, session) = pair();
    let role = |second: Result<IceoryxLink, LinkError>| match second.err() {
        Some(LinkError::Taken { role, .. }) => role,
        other => panic!("{other:?}"),
    };
    assert_eq!(role(IceoryxLink::create(session.info())), "plant");
    assert_eq!(role(IceoryxLink::open(session.info(), 1)), "controller");
}

#[test]
fn only_the_launched_process_may_act_as_the_controller() {
    let (mut plant, mut controller, mut session) = pair();
    assert_eq!(plant.peer(), Ok(Peer::Unknown));
    let own = std::process::id();
    session.add_controller(1, own).expect("noted");
    assert_eq!(plant.peer(), Ok(Peer::Launched));
    plant.open_frames(&spec()).expect("plant opens");
    controller.open_frames(&spec()).expect("opens");
    assert_eq!(plant.peer(), Ok(Peer::Launched));
    // Process 1 was launched, but this process is the peer.
    session.add_controller(1, 1).expect("noted");
    match plant.peer() {
        Ok(Peer::Stranger(told)) => assert!(told.contains(&format!("process {own}")), "{told}"),
        other => panic!("{other:?}"),
    }
    // The control channel still belongs to the first controller.
    session.add_controller(2, own).expect("noted");
    assert_eq!(plant.peer(), Ok(Peer::Unknown));
}

#[test]
fn a_controller_without_a_plant_finds_nothing() {
    let session = Session::create(None).expect("a session");
    let opened = IceoryxLink::open(session.info(), 1);
    assert!(matches!(opened, Err(LinkError::Absent { .. })));
}
