//! Round trips: a payload there and one back, over whatever connects two processes.
//!
//! Benches [`measure`] one exchange at a time, for N trips at some [`Place`] with one way to
//! [`Wait`]. The plant's end is in this process, the controller's in this program started again, so
//! that each bench first asks whether it was [`answered`] as one. The raw limit and the bare
//! blackboard are those of `hil latency`.
//!
//! Payloads are as large as the link's frames, header included. Both ends write all of one and take
//! all of the other out.

mod link;
mod patterns;
mod peer;
mod place;
mod sockets;

use hil_benchmark::exchange::End;
use hil_session::link::bare::Blackboard;
use hil_session::session::SessionInfo;
use shared_types::frame;
use shared_types::side::Side;

pub(crate) use peer::{answered, measure};
pub(crate) use place::Place;

/// Returns the number of signals in a sample.
pub(crate) const SIGNALS: usize = 32;
/// Values of a command.
pub(crate) const COMMANDS: usize = 16;
/// Bytes of a sample.
pub(crate) const SAMPLE_BYTES: usize = 8 * frame::words(SIGNALS);
/// Bytes of a command.
pub(crate) const COMMAND_BYTES: usize = 8 * frame::words(COMMANDS);

/// Exchange that connects the two sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exchange {
    Raw,
    Blackboard,
    PublishSubscribe,
    RequestResponse,
    Link,
    UnixStream,
    UnixDatagram,
    Udp,
    Tcp,
}

impl Exchange {
    const ALL: [Self; 9] = [
        Self::Raw,
        Self::Blackboard,
        Self::PublishSubscribe,
        Self::RequestResponse,
        Self::Link,
        Self::UnixStream,
        Self::UnixDatagram,
        Self::Udp,
        Self::Tcp,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw shared memory, two threads",
            Self::Blackboard => "iceoryx2 blackboard",
            Self::PublishSubscribe => "iceoryx2 publish-subscribe",
            Self::RequestResponse => "iceoryx2 request-response",
            Self::Link => "the project's link (on blackboard)",
            Self::UnixStream => "UNIX stream socket",
            Self::UnixDatagram => "UNIX datagram socket",
            Self::Udp => "UDP on loopback",
            Self::Tcp => "TCP on loopback, no delay",
        }
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.name() == name)
    }
}

/// Way in which both sides wait for each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wait {
    /// Strategy of the project's processes unless told otherwise.
    Hybrid,
    /// Poll and never give the core away.
    Spin,
    /// Sleep in the kernel until something comes; sockets only.
    Block,
}

impl Wait {
    const ALL: [Self; 3] = [Self::Hybrid, Self::Spin, Self::Block];

    const fn name(self) -> &'static str {
        match self {
            Self::Hybrid => "hybrid",
            Self::Spin => "spin",
            Self::Block => "block",
        }
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.name() == name)
    }

    /// Describes the wait at a place: who shares a core must give it away.
    pub(crate) const fn at(self, place: Place<'_>) -> &'static str {
        match (self, place.is_shared()) {
            (Self::Block, _) => "blocking",
            (_, true) => "yield after every poll",
            (Self::Hybrid, false) => "up to 512 polls, then yield after every poll",
            (Self::Spin, false) => "spinning",
        }
    }
}

/// Percentiles of one round in ns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Round {
    pub(crate) p50: f64,
    pub(crate) p99: f64,
}

/// An end that the other side has yet to join. Calling it waits for what a socket has to know.
type Opened = Box<dyn FnOnce() -> Box<dyn End>>;

/// Opens this side's end of an exchange between processes; the plant opens its end first.
fn open(exchange: Exchange, session: &SessionInfo, side: Side, wait: Wait) -> Opened {
    let end: Box<dyn End> = match exchange {
        Exchange::Raw => unreachable!("the raw limit is measured between threads"),
        Exchange::Blackboard => {
            let end = Blackboard::open(session, side, SIGNALS, COMMANDS);
            Box::new(end.expect("shared memory"))
        }
        Exchange::PublishSubscribe => patterns::publish_subscribe(session, side),
        Exchange::RequestResponse => patterns::request_response(session, side),
        Exchange::Link => Box::new(link::Linked::open(session, side)),
        Exchange::UnixStream => return sockets::unix_stream(session, side, wait),
        Exchange::UnixDatagram => return sockets::unix_datagram(session, side, wait),
        Exchange::Udp => return sockets::udp(session, side, wait),
        Exchange::Tcp => return sockets::tcp(session, side, wait),
    };
    Box::new(move || end)
}
