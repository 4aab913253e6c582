//! The bare iceoryx2 exchange: one blackboard entry in each direction between two processes, used as in the link, but
//! without filling, stamping and checking frames.
//!
//! Benchmarks compare the link with this exchange. Both share nearly all code that the compiler generates from
//! iceoryx2, so they are in one package; no run uses the bare exchange.

use iceoryx2::port::reader::{BlackboardValue, EntryHandle};
use iceoryx2::port::writer::EntryHandleMut;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::blackboard::PortFactory;

use super::iceoryx::for_words;
use super::service::{Ipc, node, transport};
use crate::session::SessionInfo;
use shared_types::link::LinkError;
use shared_types::side::Side;

const SAMPLES: &str = "bare/samples";
const COMMANDS: &str = "bare/commands";

/// Payload as large as a [frame](shared_types::frame::Frame) of so many words.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
struct Payload<const WORDS: usize> {
    words: [u64; WORDS],
}

impl<const WORDS: usize> Payload<WORDS> {
    const fn of(number: u64) -> Self {
        Self {
            words: [number; WORDS],
        }
    }
}

trait Outgoing {
    fn send(&self, number: u64);
}

trait Incoming {
    fn receive(&mut self) -> Option<u64>;
}

struct Writer<const WORDS: usize>(EntryHandleMut<Ipc, u8, Payload<WORDS>>);

impl<const WORDS: usize> Outgoing for Writer<WORDS> {
    fn send(&self, number: u64) {
        self.0.update_with_copy(Payload::of(number));
    }
}

struct Reader<const WORDS: usize> {
    cell: EntryHandle<Ipc, u8, Payload<WORDS>>,
    last: Option<BlackboardValue<Payload<WORDS>>>,
}

impl<const WORDS: usize> Incoming for Reader<WORDS> {
    fn receive(&mut self) -> Option<u64> {
        if (self.last.as_ref()).is_some_and(|last| self.cell.is_up_to_date(last)) {
            return None;
        }
        let payload = **self.last.insert(self.cell.get());
        // Reads the last word of the copy, so that all of it is copied.
        std::hint::black_box(payload).words.last().copied()
    }
}

/// End of a blackboard.
pub struct Blackboard {
    outgoing: Box<dyn Outgoing>,
    incoming: Box<dyn Incoming>,
    // Last: the fields above must be dropped before the node that owns them.
    _node: Node<Ipc>,
}

impl Blackboard {
    /// Sends a payload filled with this number.
    pub fn send(&mut self, number: u64) {
        self.outgoing.send(number);
    }

    /// Copies out a payload that arrived, and returns its number.
    pub fn receive(&mut self) -> Option<u64> {
        self.incoming.receive()
    }

    /// Opens an end for payloads of `there` values from the plant and `back` values to the plant. The plant's end must
    /// be opened before the controller's.
    ///
    /// # Errors
    /// If shared memory cannot be used, or the plant has not created its end.
    pub fn open(
        session: &SessionInfo,
        side: Side,
        there: usize,
        back: usize,
    ) -> Result<Self, LinkError> {
        let name = match side {
            Side::Plant => "bare plant",
            Side::Controller => "bare controller",
        };
        let node = node(session, name)?;
        let ((out_name, out_values), (in_name, received)) = match side {
            Side::Plant => ((SAMPLES, there), (COMMANDS, back)),
            Side::Controller => ((COMMANDS, back), (SAMPLES, there)),
        };
        Ok(Self {
            outgoing: for_words!(out_values, outgoing(&node, side, out_name))?,
            incoming: for_words!(received, incoming(&node, side, in_name))?,
            _node: node,
        })
    }
}

fn board<const WORDS: usize>(
    node: &Node<Ipc>,
    side: Side,
    name: &str,
) -> Result<PortFactory<Ipc, u8>, LinkError> {
    let service_name = name.try_into().map_err(|e| transport(name, e))?;
    let builder = node.service_builder(&service_name);
    match side {
        Side::Plant => (builder.blackboard_creator::<u8>())
            .add(0, Payload::<WORDS>::of(0))
            .create()
            .map_err(|e| transport(name, e)),
        Side::Controller => (builder.blackboard_opener::<u8>())
            .open()
            .map_err(|e| transport(name, e)),
    }
}

fn outgoing<const WORDS: usize>(
    node: &Node<Ipc>,
    side: Side,
    name: &str,
) -> Result<Box<dyn Outgoing>, LinkError> {
    let board = board::<WORDS>(node, side, name)?;
    let writer = board.writer_builder().create();
    let entry = writer
        .map_err(|e| transport(name, e))?
        .entry::<Payload<WORDS>>(&0);
    Ok(Box::new(Writer(entry.map_err(|e| transport(name, e))?)))
}

fn incoming<const WORDS: usize>(
    node: &Node<Ipc>,
    side: Side,
    name: &str,
) -> Result<Box<dyn Incoming>, LinkError> {
    let board = board::<WORDS>(node, side, name)?;
    let reader = board.reader_builder().create();
    let cell = reader
        .map_err(|e| transport(name, e))?
        .entry::<Payload<WORDS>>(&0);
    let cell = cell.map_err(|e| transport(name, e))?;
    Ok(Box::new(Reader { cell, last: None }))
}
