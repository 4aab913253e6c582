//! Round trips: a payload to another process and back, over any connection between the two.
//!
//! Benches [`measure`] one exchange at a time, for N trips at some [`Place`]. The plant's end is in this
//! process, the controller's in this program started again, so that each bench first asks whether it was
//! [`answered`] as one. Trips, raw limit and bare blackboard are those of `hil latency`.
//!
//! Payloads are as large as the link's frames, header included. Both ends write all of one and take
//! all of the other out.

mod link;
mod patterns;
mod peer;
mod place;

use hil_benchmark::exchange::End;
use hil_session::link::bare::Blackboard;
use hil_session::session::SessionInfo;
use shared_types::frame;
use shared_types::side::Side;

pub(crate) use peer::{answered, measure};
pub(crate) use place::Place;

/// Returns the number of signals in a sample.
pub(crate) const SIGNALS: usize = 32;
/// Returns the number of values in a command.
pub(crate) const COMMANDS: usize = 16;
/// Returns the size of a sample in bytes.
pub(crate) const SAMPLE_BYTES: usize = 8 * frame::words(SIGNALS);
/// Returns the size of a command in bytes.
pub(crate) const COMMAND_BYTES: usize = 8 * frame::words(COMMANDS);

/// Exchange that connects the two sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exchange {
    Raw,
    Blackboard,
    PublishSubscribe,
    RequestResponse,
    Link,
}

impl Exchange {
    pub(crate) const ALL: [Self; 5] = [
        Self::Raw,
        Self::Blackboard,
        Self::PublishSubscribe,
        Self::RequestResponse,
        Self::Link,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw shared memory, two threads",
            Self::Blackboard => "iceoryx2 blackboard",
            Self::PublishSubscribe => "iceoryx2 publish-subscribe",
            Self::RequestResponse => "iceoryx2 request-response",
            Self::Link => "the project's link (on blackboard)",
        }
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.name() == name)
    }
}

/// Describes how both sides wait at a place: like the project's processes, which yield a core that they share.
pub(crate) const fn waits(place: Place<'_>) -> &'static str {
    match place.is_shared() {
        true => "yield after every poll",
        false => "up to 512 polls, then yield after every poll",
    }
}

/// Percentiles of one round, in ns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Round {
    pub(crate) p50: f64,
    pub(crate) p99: f64,
}

/// Opens this side's end of an exchange between processes; the plant opens its end first.
fn open(exchange: Exchange, session: &SessionInfo, side: Side) -> Box<dyn End> {
    match exchange {
        Exchange::Raw => unreachable!("the raw limit is measured between threads"),
        Exchange::Blackboard => {
            let end = Blackboard::open(session, side, SIGNALS, COMMANDS);
            Box::new(end.expect("shared memory"))
        }
        Exchange::PublishSubscribe => patterns::publish_subscribe(session, side),
        Exchange::RequestResponse => patterns::request_response(session, side),
        Exchange::Link => Box::new(link::Linked::open(session, side)),
    }
}
