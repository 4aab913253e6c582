//! The exchanges between two processes: three patterns of iceoryx2 as they are, and the link.
//!
//! The plant creates every service, the controller opens them. Payloads are as large as the frames
//! that the link uses for 32 and 16 signals, header included.

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::reader::{BlackboardValue, EntryHandle};
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::writer::EntryHandleMut;
use iceoryx2::prelude::*;
use shared_types::frame::{Frame, FrameKind, Header, Seal};
use shared_types::link::iceoryx::{IceoryxLink, Ipc};
use shared_types::link::{FrameSpec, Link};
use shared_types::session::SessionInfo;
use shared_types::time::Step;

/// Words of a sample: a frame of 32 signals.
pub(crate) const SAMPLE_WORDS: usize = size_of::<Frame<32>>() / 8;
/// Words of a command: a frame of 16 signals.
pub(crate) const COMMAND_WORDS: usize = size_of::<Frame<16>>() / 8;

/// One side of an exchange.
pub(crate) trait End {
    /// Sends a payload full of this number.
    fn send(&mut self, number: u64);
    /// The number of a payload that came and was copied out.
    fn receive(&mut self) -> Option<u64>;
}

/// Which side of an exchange this is.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// Sends first, creates what both use.
    Plant,
    /// Answers.
    Controller,
}

#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
struct Payload<const N: usize> {
    words: [u64; N],
}

impl<const N: usize> Payload<N> {
    const fn of(number: u64) -> Self {
        Self { words: [number; N] }
    }

    /// The last word of a copy, so that all of it is copied.
    fn number(&self) -> u64 {
        std::hint::black_box(*self).words[N - 1]
    }
}

fn node(session: &SessionInfo, side: Side) -> Node<Ipc> {
    let name = match side {
        Side::Plant => "bench plant",
        Side::Controller => "bench controller",
    };
    shared_types::link::iceoryx::node(session, name).expect("shared memory")
}

fn name(text: &str) -> ServiceName {
    text.try_into().expect("a service name")
}

// Blackboard

struct Board<const OUT: usize, const IN: usize> {
    writer: EntryHandleMut<Ipc, u8, Payload<OUT>>,
    reader: EntryHandle<Ipc, u8, Payload<IN>>,
    last: Option<BlackboardValue<Payload<IN>>>,
    _node: Node<Ipc>,
}

impl<const OUT: usize, const IN: usize> End for Board<OUT, IN> {
    fn send(&mut self, number: u64) {
        self.writer.update_with_copy(Payload::of(number));
    }

    fn receive(&mut self) -> Option<u64> {
        if (self.last.as_ref()).is_some_and(|last| self.reader.is_up_to_date(last)) {
            return None;
        }
        Some(self.last.insert(self.reader.get()).number())
    }
}

fn board<const N: usize>(
    node: &Node<Ipc>,
    side: Side,
    service: &str,
) -> iceoryx2::service::port_factory::blackboard::PortFactory<Ipc, u8> {
    let builder = node.service_builder(&name(service));
    match side {
        Side::Plant => (builder.blackboard_creator::<u8>())
            .add(0, Payload::<N>::of(0))
            .create()
            .expect("creates"),
        Side::Controller => (builder.blackboard_opener::<u8>()).open().expect("opens"),
    }
}

fn blackboard<const OUT: usize, const IN: usize>(
    session: &SessionInfo,
    side: Side,
    (out_name, in_name): (&str, &str),
) -> Board<OUT, IN> {
    let node = node(session, side);
    let outgoing = board::<OUT>(&node, side, out_name);
    let incoming = board::<IN>(&node, side, in_name);
    let writer = outgoing.writer_builder().create().expect("a writer");
    let reader = incoming.reader_builder().create().expect("a reader");
    Board {
        writer: writer.entry(&0).expect("an entry"),
        reader: reader.entry(&0).expect("an entry"),
        last: None,
        _node: node,
    }
}

// Publish-subscribe

struct Topics<const OUT: usize, const IN: usize> {
    publisher: Publisher<Ipc, Payload<OUT>, ()>,
    subscriber: Subscriber<Ipc, Payload<IN>, ()>,
    _node: Node<Ipc>,
}

impl<const OUT: usize, const IN: usize> End for Topics<OUT, IN> {
    fn send(&mut self, number: u64) {
        let sample = self.publisher.loan_uninit().expect("a loan");
        let sent = sample.write_payload(Payload::of(number)).send();
        sent.expect("sends");
    }

    fn receive(&mut self) -> Option<u64> {
        let sample = self.subscriber.receive().expect("receives")?;
        Some(sample.number())
    }
}

fn topic<const N: usize>(
    node: &Node<Ipc>,
    side: Side,
    topic: &str,
) -> iceoryx2::service::port_factory::publish_subscribe::PortFactory<Ipc, Payload<N>, ()> {
    let name = name(topic);
    let builder = (node
        .service_builder(&name)
        .publish_subscribe::<Payload<N>>())
    .max_publishers(1)
    .max_subscribers(4)
    .history_size(0)
    .subscriber_max_buffer_size(1)
    .enable_safe_overflow(true);
    match side {
        Side::Plant => builder.create().expect("creates"),
        Side::Controller => builder.open().expect("opens"),
    }
}

fn publish_subscribe<const OUT: usize, const IN: usize>(
    session: &SessionInfo,
    side: Side,
    (out_name, in_name): (&str, &str),
) -> Topics<OUT, IN> {
    let node = node(session, side);
    let outgoing = topic::<OUT>(&node, side, out_name);
    let incoming = topic::<IN>(&node, side, in_name);
    let publisher = outgoing.publisher_builder().create();
    let subscriber = incoming.subscriber_builder().create();
    Topics {
        publisher: publisher.expect("a publisher"),
        subscriber: subscriber.expect("a subscriber"),
        _node: node,
    }
}

// Request-response: the sample is the request, the command its response.

type Sample = Payload<SAMPLE_WORDS>;
type Command = Payload<COMMAND_WORDS>;

struct Asking {
    client: Client<Ipc, Sample, (), Command, ()>,
    pending: Option<PendingResponse<Ipc, Sample, (), Command, ()>>,
    _node: Node<Ipc>,
}

impl End for Asking {
    fn send(&mut self, number: u64) {
        let request = self.client.loan_uninit().expect("a loan");
        let sent = request.write_payload(Payload::of(number)).send();
        self.pending = Some(sent.expect("sends"));
    }

    fn receive(&mut self) -> Option<u64> {
        let response = self.pending.as_ref()?.receive().expect("receives")?;
        Some(response.number())
    }
}

struct Answering {
    server: Server<Ipc, Sample, (), Command, ()>,
    active: Option<ActiveRequest<Ipc, Sample, (), Command, ()>>,
    _node: Node<Ipc>,
}

impl End for Answering {
    fn send(&mut self, number: u64) {
        let request = self.active.take().expect("a request to answer");
        let response = request.loan_uninit().expect("a loan");
        let sent = response.write_payload(Payload::of(number)).send();
        sent.expect("sends");
    }

    fn receive(&mut self) -> Option<u64> {
        let request = self.server.receive().expect("receives")?;
        let number = request.number();
        self.active = Some(request);
        Some(number)
    }
}

fn request_response(session: &SessionInfo, side: Side) -> Box<dyn End> {
    let node = node(session, side);
    let name = name("bare/steps");
    let builder = (node.service_builder(&name))
        .request_response::<Sample, Command>()
        .max_servers(1)
        .max_clients(1);
    match side {
        Side::Plant => {
            let service = builder.create().expect("creates");
            Box::new(Asking {
                client: service.client_builder().create().expect("a client"),
                pending: None,
                _node: node,
            })
        }
        Side::Controller => {
            let service = builder.open().expect("opens");
            Box::new(Answering {
                server: service.server_builder().create().expect("a server"),
                active: None,
                _node: node,
            })
        }
    }
}

// The link

struct Linked {
    link: IceoryxLink,
    kind: FrameKind,
    outgoing: Vec<f64>,
    incoming: Vec<f64>,
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

fn link(session: &SessionInfo, side: Side) -> Linked {
    let (kind, outgoing, incoming) = match side {
        Side::Plant => (FrameKind::Sample, 32, 16),
        Side::Controller => (FrameKind::Command, 16, 32),
    };
    let mut link = match side {
        Side::Plant => IceoryxLink::create(session).expect("creates"),
        Side::Controller => IceoryxLink::open(session).expect("opens"),
    };
    let seal = Seal {
        session: session.id,
        layout: 1,
        epoch: 1,
    };
    let spec = FrameSpec {
        seal,
        outgoing,
        incoming,
    };
    link.open_frames(&spec).expect("opens the frames");
    Linked {
        link,
        kind,
        outgoing: vec![0.0; outgoing],
        incoming: vec![0.0; incoming],
    }
}

/// An end of an exchange between processes.
pub(crate) fn end(exchange: crate::Exchange, session: &SessionInfo, side: Side) -> Box<dyn End> {
    const PLANT: (&str, &str) = ("bare/samples", "bare/commands");
    const CONTROLLER: (&str, &str) = ("bare/commands", "bare/samples");
    const S: usize = SAMPLE_WORDS;
    const C: usize = COMMAND_WORDS;
    use crate::Exchange::{Blackboard, Link, PublishSubscribe, Raw, RequestResponse};
    match (exchange, side) {
        (Raw, _) => unreachable!("the raw limit is measured between threads"),
        (Blackboard, Side::Plant) => Box::new(blackboard::<S, C>(session, side, PLANT)),
        (Blackboard, Side::Controller) => Box::new(blackboard::<C, S>(session, side, CONTROLLER)),
        (PublishSubscribe, Side::Plant) => {
            Box::new(publish_subscribe::<S, C>(session, side, PLANT))
        }
        (PublishSubscribe, Side::Controller) => {
            Box::new(publish_subscribe::<C, S>(session, side, CONTROLLER))
        }
        (RequestResponse, _) => request_response(session, side),
        (Link, _) => Box::new(link(session, side)),
    }
}
