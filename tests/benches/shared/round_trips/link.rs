//! The project's link: frames that are filled, sealed, summed and checked.

use hil_benchmark::exchange::End;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::SessionInfo;
use shared_types::frame::{FrameIdentity, FrameKind, Header};
use shared_types::link::{FrameSpec, Link};
use shared_types::side::Side;
use shared_types::time::Step;

use super::{COMMANDS, SIGNALS};

/// End of a link.
pub(super) struct Linked {
    link: IceoryxLink,
    kind: FrameKind,
    outgoing: Vec<f64>,
    incoming: Vec<f64>,
}

impl Linked {
    pub(super) fn open(session: &SessionInfo, side: Side) -> Self {
        let (kind, outgoing, incoming) = match side {
            Side::Plant => (FrameKind::Sample, SIGNALS, COMMANDS),
            Side::Controller => (FrameKind::Command, COMMANDS, SIGNALS),
        };
        let link = match side {
            Side::Plant => IceoryxLink::create(session),
            Side::Controller => IceoryxLink::open(session, 1),
        };
        let mut link = link.expect("shared memory");
        let identity = FrameIdentity {
            session: session.id,
            layout: 1,
            epoch: 1,
        };
        let spec = FrameSpec {
            identity,
            outgoing,
            incoming,
        };
        link.open_frames(&spec).expect("opens the frames");
        Self {
            link,
            kind,
            outgoing: vec![0.0; outgoing],
            incoming: vec![0.0; incoming],
        }
    }
}

impl End for Linked {
    fn send(&mut self, number: u64) {
        self.outgoing.fill(number as f64);
        let header = Header::new(self.kind, Step(number));
        (self.link.send(&header, &self.outgoing)).expect("sends");
    }

    fn receive(&mut self) -> Option<u64> {
        let header = self.link.receive(&mut self.incoming).expect("receives")?;
        std::hint::black_box(&self.incoming);
        Some(header.step)
    }
}
