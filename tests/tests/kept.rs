//! Link of persistent processes: frames of one job are never used for the next.

use std::path::Path;

use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::Session;
use shared_types::frame::{FrameIdentity, FrameKind, Header};
use shared_types::ignored::Reason;
use shared_types::link::{FrameSpec, Link};
use shared_types::time::Step;

use crate::support::harness::Rig;

const fn spec(session: u64, layout: u64) -> FrameSpec {
    FrameSpec {
        identity: FrameIdentity {
            session,
            layout,
            epoch: 1,
        },
        outgoing: 1,
        incoming: 1,
    }
}

fn open(end: &mut IceoryxLink, session: u64, layout: u64) {
    end.begin_next();
    end.open_frames(&spec(session, layout))
        .expect("frames open");
}

fn send(end: &mut IceoryxLink, step: u64) {
    let header = Header::new(FrameKind::Sample, Step(step));
    end.send(&header, &[1.0]).expect("sent");
}

fn received(end: &mut IceoryxLink) -> Option<u64> {
    let header = end.receive(&mut [0.0]).expect("received");
    header.map(|header| header.step)
}

/// Lists the session's files in shared memory.
fn files(folder: &Path) -> usize {
    let all = std::fs::read_dir(folder).expect("the session's folder");
    all.count()
}

#[test]
fn a_frame_of_the_previous_job_is_refused_and_equal_layouts_reuse_frames() {
    let _rig = Rig::new();
    let mut session = Session::create(None).expect("a session");
    (session.add_controller(1, std::process::id())).expect("noted");
    let info = session.info().clone();
    let mut plant = IceoryxLink::create(&info).expect("a link");
    let mut controller = IceoryxLink::open(&info, 1).expect("a link");
    open(&mut plant, 1, 7);
    open(&mut controller, 1, 7);
    send(&mut plant, 0);
    assert_eq!(received(&mut controller), Some(0));
    send(&mut plant, 1); // late: no longer accepted
    let before = files(&info.folder);

    open(&mut plant, 2, 7);
    open(&mut controller, 2, 7);
    assert_eq!(files(&info.folder), before);
    assert_eq!(received(&mut controller), None);
    assert_eq!(controller.rejected().of(Reason::Session), 1);
    for step in 0..3 {
        send(&mut plant, step);
        assert_eq!(received(&mut controller), Some(step));
        send(&mut controller, step);
        assert_eq!(received(&mut plant), Some(step));
    }
}
