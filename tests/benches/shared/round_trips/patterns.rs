//! Two more patterns of iceoryx2 without changes, on which the link could have been built.
//!
//! The plant creates every service, the controller opens them.

use hil_benchmark::exchange::End;
use hil_session::link::service::Ipc;
use hil_session::session::SessionInfo;
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::side::Side;

use super::{COMMAND_BYTES, SAMPLE_BYTES};

const SAMPLES: &str = "bare/samples";
const COMMANDS: &str = "bare/commands";

#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
struct Payload<const N: usize> {
    words: [u64; N],
}

impl<const N: usize> Payload<N> {
    const fn of(number: u64) -> Self {
        Self { words: [number; N] }
    }

    /// Returns the last word of a copy, so that the compiler cannot skip any of it.
    fn number(&self) -> u64 {
        std::hint::black_box(*self).words[N - 1]
    }
}

/// Words in a sample.
const SAMPLE: usize = SAMPLE_BYTES / 8;
/// Words in a command.
const COMMAND: usize = COMMAND_BYTES / 8;

type Sample = Payload<SAMPLE>;
type Command = Payload<COMMAND>;

fn node(session: &SessionInfo, side: Side) -> Node<Ipc> {
    let name = match side {
        Side::Plant => "bench plant",
        Side::Controller => "bench controller",
    };
    hil_session::link::service::node(session, name).expect("shared memory")
}

fn name(text: &str) -> ServiceName {
    text.try_into().expect("a service name")
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
) -> PortFactory<Ipc, Payload<N>, ()> {
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

fn topics<const OUT: usize, const IN: usize>(
    session: &SessionInfo,
    side: Side,
    (out_name, in_name): (&str, &str),
) -> Box<dyn End> {
    let node = node(session, side);
    let outgoing = topic::<OUT>(&node, side, out_name);
    let incoming = topic::<IN>(&node, side, in_name);
    let publisher = outgoing.publisher_builder().create();
    let subscriber = incoming.subscriber_builder().create();
    Box::new(Topics {
        publisher: publisher.expect("a publisher"),
        subscriber: subscriber.expect("a subscriber"),
        _node: node,
    })
}

/// Exchanges over one topic in each direction.
pub(super) fn publish_subscribe(session: &SessionInfo, side: Side) -> Box<dyn End> {
    match side {
        Side::Plant => topics::<SAMPLE, COMMAND>(session, side, (SAMPLES, COMMANDS)),
        Side::Controller => topics::<COMMAND, SAMPLE>(session, side, (COMMANDS, SAMPLES)),
    }
}

// Request-response

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

/// Exchanges with the sample as the request and the command as its response.
pub(super) fn request_response(session: &SessionInfo, side: Side) -> Box<dyn End> {
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
