//! The link over iceoryx2 shared memory.
//!
//! Frames use the blackboard pattern, with one service in each direction: a lock-free cell that holds the latest frame.
//! The pattern costs about half of publish-subscribe (see the bench `exchange`), and lockstep and real time need only
//! the latest frame.
//! A blackboard cell stays locked if its writer is killed, so each controller, identified by its epoch, gets its own
//! services. Control messages use publish-subscribe, also with services for each epoch. The plant creates every service
//! and verifies the result; the controller opens the services and proves the layout hash.

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::ReceiveError;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeCreateError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as Topic;

use super::bell::{Bell, Owner};
use super::service::{Ipc, absent, node, received, subscribe, transport};
use crate::process::ProcessId;
use crate::session::SessionInfo;
use crate::shared_memory;
pub(super) use frames::for_words;
use frames::{Incoming, Outgoing};
use shared_types::frame::{FrameIdentity, Header};
use shared_types::ignored::Ignored;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::side::Side;
use shared_types::wait::Sleeper;

mod frames;

/// Control messages that may be pending at their receiver.
const CONTROL_BUFFER: usize = 8;

/// End of a link over shared memory.
pub struct IceoryxLink {
    side: Side,
    session: SessionInfo,
    /// Bell that this side sleeps on.
    bell: Bell,
    control: ControlChannel,
    /// Control channel of the controller whose frames are in use, while another controller is expected.
    active: Option<ControlChannel>,
    frames: Option<Frames>,
    /// Frame channels opened last, while older ones are still in use.
    next: Option<Frames>,
    /// Frame channels of the previous job.
    previous: Option<Frames>,
    rejected: Ignored,
    // Last: the fields above must be dropped before the node that owns them.
    node: Node<Ipc>,
}

/// Control messages of one epoch.
struct ControlChannel {
    epoch: u32,
    speak: Publisher<Ipc, [u8], ()>,
    listen: Subscriber<Ipc, [u8], ()>,
    /// Topic that the other side publishes to.
    incoming: Topic<Ipc, [u8], ()>,
    /// Bell that the other side sleeps on.
    bell: Bell,
}

struct Frames {
    bell: Bell,
    identity: FrameIdentity,
    sequence: u64,
    outgoing: Box<dyn Outgoing>,
    incoming: Box<dyn Incoming>,
}

impl IceoryxLink {
    /// Creates the plant's end with its control services.
    ///
    /// # Errors
    /// If a service exists already or cannot be created.
    pub fn create(session: &SessionInfo) -> Result<Self, LinkError> {
        Self::start(session, Side::Plant, 1)
    }

    /// Opens the controller's end of an epoch with its control services.
    ///
    /// # Errors
    /// [`LinkError::Absent`] while the plant has not created them, [`LinkError::Taken`] while another process occupies
    /// the place.
    pub fn open(session: &SessionInfo, epoch: u32) -> Result<Self, LinkError> {
        Self::start(session, Side::Controller, epoch)
    }

    /// Returns the bell that this side sleeps on, for senders other than the peer.
    #[must_use]
    pub fn bell(&self) -> Bell {
        self.bell.clone()
    }

    /// Prepares the link for the next job of a persistent process. The frame channels are kept, because creating them
    /// takes longer than a short run; so the next job must have the same layout. A frame of the previous job is
    /// rejected by its session number, which differs between jobs.
    pub fn begin_next(&mut self) {
        self.previous = self.frames.take();
        self.next = None;
        self.rejected = Ignored::default();
    }

    fn start(session: &SessionInfo, side: Side, epoch: u32) -> Result<Self, LinkError> {
        let node = node(session, side.name())?;
        // The plant creates bells before the services that announce it, and the controller opens them after those:
        // iceoryx2 waits without a limit for a file that has no size yet.
        let (bell, control) = match side {
            Side::Plant => {
                let own = Bell::create(session, Owner::Plant)?;
                (own, ControlChannel::new(&node, session, side, epoch)?)
            }
            Side::Controller => {
                let control = ControlChannel::new(&node, session, side, epoch)?;
                (Bell::open(session, Owner::Controller(epoch))?, control)
            }
        };
        Ok(Self {
            side,
            session: session.clone(),
            bell,
            control,
            active: None,
            frames: None,
            next: None,
            previous: None,
            rejected: Ignored::default(),
            node,
        })
    }
}

impl ControlChannel {
    fn new(
        node: &Node<Ipc>,
        session: &SessionInfo,
        side: Side,
        epoch: u32,
    ) -> Result<Self, LinkError> {
        let controller_bell = match side {
            Side::Plant => Some(Bell::create(session, Owner::Controller(epoch))?),
            Side::Controller => None,
        };
        let plant_speaks = format!("control/{epoch}/plant");
        let controller_speaks = format!("control/{epoch}/controller");
        let (speaks, hears) = match side {
            Side::Plant => (&plant_speaks, &controller_speaks),
            Side::Controller => (&controller_speaks, &plant_speaks),
        };
        // The receiver first: once the peer finds the service that this side publishes to, it may send at once, and
        // messages without a receiver are lost.
        let incoming = topic(node, side, hears)?;
        let listen = subscribe(hears, incoming.subscriber_builder())?;
        let speak = (topic(node, side, speaks)?.publisher_builder())
            .initial_max_slice_len(1 << 14)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .create()
            .map_err(|error| match error {
                PublisherCreateError::ExceedsMaxSupportedPublishers => LinkError::Taken {
                    service: speaks.clone(),
                    role: side.name(),
                },
                error => transport(speaks, error),
            })?;
        Ok(Self {
            epoch,
            speak,
            listen,
            incoming,
            bell: match controller_bell {
                Some(bell) => bell,
                None => Bell::open(session, Owner::Plant)?,
            },
        })
    }

    fn send(&self, message: &[u8]) -> Result<(), LinkError> {
        let failed = |e: &dyn std::fmt::Debug| transport("control", e);
        let sample = (self.speak.loan_slice_uninit(message.len())).map_err(|e| failed(&e))?;
        sample
            .write_from_slice(message)
            .send()
            .map_err(|e| failed(&e))?;
        self.bell.ring();
        Ok(())
    }
}

fn topic(node: &Node<Ipc>, side: Side, name: &str) -> Result<Topic<Ipc, [u8], ()>, LinkError> {
    let service_name = name.try_into().map_err(|e| transport(name, e))?;
    let builder = (node
        .service_builder(&service_name)
        .publish_subscribe::<[u8]>())
    .max_publishers(1)
    .max_subscribers(4)
    .history_size(0)
    .subscriber_max_buffer_size(CONTROL_BUFFER)
    .enable_safe_overflow(true);
    match side {
        Side::Plant => {
            let topic = builder.create().map_err(|error| match error {
                PublishSubscribeCreateError::AlreadyExists => LinkError::Taken {
                    service: name.into(),
                    role: side.name(),
                },
                error => transport(name, error),
            })?;
            // The requested maximum is only a minimum when opening, so verify it.
            if topic.static_config().max_publishers() != 1 {
                return Err(LinkError::Foreign {
                    service: name.into(),
                    reason: "it admits more than one publisher".into(),
                });
            }
            Ok(topic)
        }
        Side::Controller => builder.open().map_err(|e| absent(name, e)),
    }
}

/// Returns the process number of a node; 0 if it has none.
fn process_of(node: &UniqueNodeId) -> u32 {
    node.pid::<Ipc>().map_or(0, |pid| pid.value() as u32)
}

impl Link for IceoryxLink {
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.control.send(message)
    }

    fn tell(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.active.as_ref().unwrap_or(&self.control).send(message)
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        let sample = match self.control.listen.receive() {
            // The publisher may have been killed meanwhile, which is detected elsewhere and need not end the run.
            Err(ReceiveError::ConnectionFailure(_)) if shared_memory::hindrance().is_none() => None,
            sample => received("control", sample)?,
        };
        Ok(sample.map(|message| message.payload().to_vec()))
    }

    fn expect(&mut self, epoch: u32) -> Result<(), LinkError> {
        let next = ControlChannel::new(&self.node, &self.session, self.side, epoch)?;
        let before = std::mem::replace(&mut self.control, next);
        // An earlier controller may have been expected in vain.
        let is_in_use = |frames: &Frames| frames.identity.epoch == before.epoch;
        if self.frames.as_ref().is_some_and(is_in_use) {
            self.active = Some(before);
        }
        Ok(())
    }

    fn peer(&self) -> Result<Peer, LinkError> {
        // Read anew: the launcher records a process only after starting it.
        let session = SessionInfo::read(&self.session.folder);
        let session = session.map_err(|e| LinkError::Transport {
            service: "session.json".into(),
            reason: e.to_string(),
        })?;
        let launched = session.controller.filter(|c| c.epoch == self.control.epoch);
        let Some(launched) = launched else {
            return Ok(Peer::Unknown);
        };
        let mut speakers = Vec::new();
        (self.control.incoming.dynamic_config()).list_publishers(|publisher| {
            speakers.push(process_of(&publisher.node_id));
            CallbackProgression::Continue
        });
        let newest = self.next.as_ref().or(self.frames.as_ref());
        if let Some(frames) = newest.filter(|frames| frames.identity.epoch == self.control.epoch) {
            speakers.extend(frames.incoming.writers());
        }
        let mut strangers = (speakers.into_iter()).filter(|pid| !launched.process.leads(*pid));
        Ok(match strangers.next() {
            None => Peer::Launched,
            Some(pid) => Peer::Stranger(format!(
                "process {pid}{} acts as the controller, but the process launched as the controller is {}",
                ProcessId::name(pid).map_or_else(String::new, |name| format!(" ({name})")),
                launched.process.pid
            )),
        })
    }

    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError> {
        let of = |identity: FrameIdentity| (identity.epoch, identity.layout);
        if let Some(mut previous) = self.previous.take()
            && of(previous.identity) == of(spec.identity)
        {
            previous.identity = spec.identity;
            self.frames = Some(previous);
            return Ok(());
        }
        let samples = format!("frames/{}/samples", spec.identity.epoch);
        let commands = format!("frames/{}/commands", spec.identity.epoch);
        let (out_name, in_name) = match self.side {
            Side::Plant => (&samples, &commands),
            Side::Controller => (&commands, &samples),
        };
        let (node, side, identity) = (&self.node, self.side, spec.identity);
        self.next = Some(Frames {
            bell: self.control.bell.clone(),
            identity,
            sequence: 0,
            outgoing: frames::outgoing((node, side), out_name, identity, spec.outgoing)?,
            incoming: frames::incoming((node, side), in_name, identity, spec.incoming)?,
        });
        if self.frames.is_none() {
            self.take_over();
        }
        Ok(())
    }

    fn take_over(&mut self) {
        if self.next.is_some() {
            self.frames = self.next.take();
            self.active = None;
        }
    }

    #[inline]
    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError> {
        let frames = self.frames.as_mut().ok_or(LinkError::NotOpen)?;
        frames.sequence += 1;
        let header = Header {
            sequence: frames.sequence,
            ..*header
        };
        frames.outgoing.send(&header, values, frames.identity);
        frames.bell.ring();
        Ok(())
    }

    #[inline]
    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let frames = self.frames.as_mut().ok_or(LinkError::NotOpen)?;
        match frames.incoming.receive(values, frames.identity) {
            None => Ok(None),
            Some(Ok(header)) => Ok(Some(header)),
            Some(Err(error)) => {
                self.rejected.count(error);
                Ok(None)
            }
        }
    }

    fn rejected(&self) -> Ignored {
        self.rejected
    }

    fn sleeper(&self) -> Option<Box<dyn Sleeper>> {
        Some(Box::new(self.bell.clone()))
    }
}
