//! Frame channels: one blackboard service in each direction, in one of a few sizes.

use iceoryx2::port::reader::{BlackboardValue, EntryHandle};
use iceoryx2::port::writer::EntryValueUninit;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::blackboard::BlackboardOpenError;
use iceoryx2::service::port_factory::blackboard::PortFactory as Blackboard;

use super::{Ipc, LinkError, process_of, transport};
use shared_types::frame::{Frame, FrameError, FrameIdentity, Header};
use shared_types::side::Side;

const LAYOUT: &str = "layout";

/// Calls a function with the number of words of the smallest frame that fits so many values.
macro_rules! for_words {
    ($values:expr, $function:ident ( $($argument:expr),* )) => {{
        use shared_types::frame::{SizeClass, words};
        match SizeClass::for_count($values).ok_or(LinkError::TooManySignals($values))? {
            SizeClass::N16 => $function::<{ words(16) }>($($argument),*),
            SizeClass::N32 => $function::<{ words(32) }>($($argument),*),
            SizeClass::N64 => $function::<{ words(64) }>($($argument),*),
            SizeClass::N128 => $function::<{ words(128) }>($($argument),*),
            SizeClass::N256 => $function::<{ words(256) }>($($argument),*),
            SizeClass::N512 => $function::<{ words(512) }>($($argument),*),
        }
    }};
}
pub(crate) use for_words;

/// Opens the sending end of a channel whose frames hold so many values.
pub(super) fn outgoing(
    (node, side): (&Node<Ipc>, Side),
    name: &str,
    identity: FrameIdentity,
    values: usize,
) -> Result<Box<dyn Outgoing>, LinkError> {
    for_words!(values, writer(node, side, name, identity))
}

/// Opens the receiving end of a channel whose frames hold so many values.
pub(super) fn incoming(
    (node, side): (&Node<Ipc>, Side),
    name: &str,
    identity: FrameIdentity,
    values: usize,
) -> Result<Box<dyn Incoming>, LinkError> {
    for_words!(values, reader(node, side, name, identity))
}

/// Sending end of a frame channel of any size class.
pub(super) trait Outgoing {
    fn send(&mut self, header: &Header, values: &[f64], identity: FrameIdentity);
}

/// Receiving end of a frame channel of any size class.
pub(super) trait Incoming {
    /// Lists the processes that may send on the channel.
    fn writers(&self) -> Vec<u32>;
    fn receive(
        &mut self,
        values: &mut [f64],
        identity: FrameIdentity,
    ) -> Option<Result<Header, FrameError>>;
}

/// Words of a [`Frame`] in shared memory. The type name is fixed, so that programs built in different paths agree.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
#[type_name("hil_frame")]
struct Words<const WORDS: usize>([u64; WORDS]);

/// Sending end that holds the cell of the next frame. Borrowing a cell touches a cache line that the reader writes,
/// which is cheapest right after sending, while the reader is busy.
struct Writer<const WORDS: usize>(Option<EntryValueUninit<Ipc, u8, Words<WORDS>>>);

impl<const WORDS: usize> Outgoing for Writer<WORDS> {
    fn send(&mut self, header: &Header, values: &[f64], identity: FrameIdentity) {
        if let Some(next) = self.0.take() {
            let frame = Frame::sealed(header, values, identity);
            let entry = next.update_with_copy(Words(frame.into_words()));
            self.0 = Some(entry.loan_uninit());
        }
    }
}

struct Reader<const WORDS: usize> {
    board: Blackboard<Ipc, u8>,
    cell: EntryHandle<Ipc, u8, Words<WORDS>>,
    last: Option<BlackboardValue<Words<WORDS>>>,
    /// Sequence number of the last delivered frame; 0 if there was none.
    delivered: u64,
}

impl<const WORDS: usize> Incoming for Reader<WORDS> {
    fn writers(&self) -> Vec<u32> {
        let mut writers = Vec::new();
        self.board.dynamic_config().list_writers(|writer| {
            writers.push(process_of(&writer.node_id));
            CallbackProgression::Continue
        });
        writers
    }

    fn receive(
        &mut self,
        values: &mut [f64],
        identity: FrameIdentity,
    ) -> Option<Result<Header, FrameError>> {
        if let Some(last) = &self.last
            && self.cell.is_up_to_date(last)
        {
            return None;
        }
        let words = self.last.insert(self.cell.get());
        let frame = Frame::from_words(&words.0);
        let sequence = frame.sequence();
        // With a writer at work, the cell may present a frame as new that was delivered before.
        if sequence == self.delivered {
            return None;
        }
        self.delivered = sequence;
        Some(frame.open(identity, values))
    }
}

fn board<const WORDS: usize>(
    node: &Node<Ipc>,
    side: Side,
    name: &str,
    identity: FrameIdentity,
) -> Result<Blackboard<Ipc, u8>, LinkError> {
    let service_name = name.try_into().map_err(|e| transport(name, e))?;
    let key = LAYOUT.try_into().map_err(|e| transport(name, e))?;
    let hash = format!("{:016x}", identity.layout);
    let value = hash.as_str().try_into().map_err(|e| transport(name, e))?;
    let builder = node.service_builder(&service_name);
    match side {
        Side::Plant => {
            let attributes = AttributeSpecifier::new().define(&key, &value);
            builder
                .blackboard_creator::<u8>()
                .max_readers(4)
                .add(0, Words([0; WORDS]))
                .create_with_attributes(&attributes.map_err(|e| transport(name, e))?)
                .map_err(|e| transport(name, e))
        }
        Side::Controller => {
            let attributes = AttributeVerifier::new().require(&key, &value);
            builder
                .blackboard_opener::<u8>()
                .open_with_attributes(&attributes.map_err(|e| transport(name, e))?)
                .map_err(|error| match error {
                    BlackboardOpenError::InternalFailure
                    | BlackboardOpenError::InsufficientPermissions
                    | BlackboardOpenError::UnableToCreateServiceTag => transport(name, error),
                    error => LinkError::Foreign {
                        service: name.into(),
                        reason: format!(
                            "iceoryx2 reports {error:?}; both sides must belong to one run"
                        ),
                    },
                })
        }
    }
}

fn writer<const WORDS: usize>(
    node: &Node<Ipc>,
    side: Side,
    name: &str,
    identity: FrameIdentity,
) -> Result<Box<dyn Outgoing>, LinkError> {
    let writer = (board::<WORDS>(node, side, name, identity)?
        .writer_builder()
        .create())
    .map_err(|e| transport(name, e))?;
    let entry = writer
        .entry::<Words<WORDS>>(&0)
        .map_err(|e| transport(name, e))?;
    Ok(Box::new(Writer(Some(entry.loan_uninit()))))
}

fn reader<const WORDS: usize>(
    node: &Node<Ipc>,
    side: Side,
    name: &str,
    identity: FrameIdentity,
) -> Result<Box<dyn Incoming>, LinkError> {
    let board = board::<WORDS>(node, side, name, identity)?;
    let reader = (board.reader_builder().create()).map_err(|e| transport(name, e))?;
    let cell = reader
        .entry::<Words<WORDS>>(&0)
        .map_err(|e| transport(name, e))?;
    Ok(Box::new(Reader {
        board,
        cell,
        last: None,
        delivered: 0,
    }))
}
