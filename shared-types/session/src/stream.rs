//! The record stream over iceoryx2 publish-subscribe.
//!
//! Overflow is enabled: a publisher never waits. An observer that returns no credit loses the oldest items and sees the
//! gap in the sequence numbers.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::link::bell::{Bell, Owner};
use crate::link::service::{Ipc, absent, node, received, subscribe, transport};
use crate::session::SessionInfo;
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout};
use shared_types::stream::{
    Assembler, Backpressure, Item, ItemKind, RecordSink, RecordSource, send_in_parts,
};

const RECORDS: &str = "records";
const CREDIT: &str = "credit";
/// File in the session's folder with the record layout for observers.
pub const LAYOUT_FILE: &str = "layout.json";
/// Queue capacity of an observer in items; large enough to bridge its stalls, small enough for its pages to stay in
/// cache.
pub const BUFFER: usize = 8192;
/// Queue capacity of a mere watcher: as many pages as a recorder touches anyway.
const WATCHERS_BUFFER: usize = BUFFER / 4;
/// Maximum number of observers of one session.
const OBSERVERS: usize = 4;
/// Maximum number of mere watchers among the observers.
pub const WATCHERS: usize = OBSERVERS - 1;
/// Number of possibly pending items at which checking the credit begins.
const LOOK_AT: u64 = BUFFER as u64 / 4;
/// Number of free places below which the loop is held back: an event may take thousands, for example that of a fault
/// with a long table.
const RESERVE: u64 = BUFFER as u64 / 4;

/// Header of an item.
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[repr(C)]
struct ItemHeader {
    sequence: u64,
    kind: u64,
    bytes: u64,
}

type Records = PortFactory<Ipc, [u64], ItemHeader>;
type Credit = PortFactory<Ipc, u64, ()>;

fn records(node: &Node<Ipc>, create: bool) -> Result<Records, LinkError> {
    let name = RECORDS.try_into().map_err(|e| transport(RECORDS, e))?;
    let records = (node.service_builder(&name).publish_subscribe::<[u64]>())
        .user_header::<ItemHeader>()
        .max_publishers(1)
        .max_subscribers(OBSERVERS)
        .history_size(0)
        .subscriber_max_buffer_size(BUFFER)
        .subscriber_max_borrowed_samples(1)
        .enable_safe_overflow(true);
    if create {
        records.create().map_err(|e| transport(RECORDS, e))
    } else {
        records.open().map_err(|e| absent(RECORDS, e))
    }
}

fn credit(node: &Node<Ipc>, create: bool) -> Result<Credit, LinkError> {
    let name = CREDIT.try_into().map_err(|e| transport(CREDIT, e))?;
    let credit = (node.service_builder(&name).publish_subscribe::<u64>())
        .max_publishers(1)
        .max_subscribers(1)
        .history_size(1)
        .subscriber_max_buffer_size(1)
        .enable_safe_overflow(true);
    if create {
        credit.create().map_err(|e| transport(CREDIT, e))
    } else {
        credit.open().map_err(|e| absent(CREDIT, e))
    }
}

/// The plant's end over shared memory.
pub struct IceoryxSink {
    session: SessionInfo,
    records: Records,
    credit: Subscriber<Ipc, u64, ()>,
    publisher: Option<Publisher<Ipc, [u64], ItemHeader>>,
    layout: RecordLayout,
    words: usize,
    sent: u64,
    credited: u64,
    backpressure: Backpressure,
    _node: Node<Ipc>,
}

impl IceoryxSink {
    /// Creates the stream.
    ///
    /// # Errors
    /// If shared memory cannot be used.
    pub fn create(session: &SessionInfo, backpressure: Backpressure) -> Result<Self, LinkError> {
        let node = node(session, "records")?;
        // The credit's subscriber is created before the service that observers look for: otherwise their first credit,
        // sent on attaching, would be lost.
        let of_credit = credit(&node, true)?;
        let credit = subscribe(CREDIT, of_credit.subscriber_builder().buffer_size(1))?;
        let records = records(&node, true)?;
        Ok(Self {
            session: session.clone(),
            records,
            credit,
            publisher: None,
            layout: RecordLayout::default(),
            words: 1,
            sent: 0,
            credited: 0,
            backpressure,
            _node: node,
        })
    }

    #[inline]
    fn send(&mut self, kind: ItemKind, bytes: usize, words: &[u64]) -> Result<(), LinkError> {
        let publisher = self.publisher.as_ref().ok_or(LinkError::NotOpen)?;
        let mut item =
            (publisher.loan_slice_uninit(words.len())).map_err(|e| transport(RECORDS, e))?;
        self.sent += 1;
        *item.user_header_mut() = ItemHeader {
            sequence: self.sent,
            kind: kind as u64,
            bytes: bytes as u64,
        };
        item.write_from_slice(words)
            .send()
            .map_err(|e| transport(RECORDS, e))?;
        Ok(())
    }

    fn hear_credit(&mut self) -> Result<(), LinkError> {
        while let Some(credit) = received(CREDIT, self.credit.receive())? {
            self.credited = *credit;
        }
        Ok(())
    }
}

impl RecordSink for IceoryxSink {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        // A persistent process keeps its stream from job to job.
        if self.publisher.is_some() && *layout == self.layout {
            return Ok(());
        }
        self.publisher = None;
        self.layout = layout.clone();
        self.words = layout.words();
        let publisher = (self.records.publisher_builder())
            .initial_max_slice_len(self.words)
            .max_loaned_samples(1)
            .create()
            .map_err(|e| transport(RECORDS, e))?;
        self.publisher = Some(publisher);
        // The file tells observers that the publisher exists.
        let result = self.session.write_file(LAYOUT_FILE, layout);
        result.map_err(|error| LinkError::Transport {
            service: RECORDS.into(),
            reason: error.to_string(),
        })
    }

    #[inline]
    fn has_room(&mut self) -> Result<bool, LinkError> {
        // Credit is the number of the next item that the observer awaits: 0 means that it is not attached, 1 that it is
        // attached and has received nothing.
        let under_way = |sink: &Self| (sink.sent + 1).saturating_sub(sink.credited);
        let is_free = match self.backpressure {
            Backpressure::None => true,
            Backpressure::AtStart => self.credited > 0,
            Backpressure::Always => self.credited > 0 && under_way(self) < LOOK_AT,
        };
        if is_free {
            return Ok(true);
        }
        self.hear_credit()?;
        Ok(self.credited > 0
            && (self.backpressure == Backpressure::AtStart
                || under_way(self) < BUFFER as u64 - RESERVE))
    }

    fn sent_and_taken(&mut self) -> Result<(u64, u64), LinkError> {
        if self.backpressure == Backpressure::None {
            return Ok((0, 0));
        }
        self.hear_credit()?;
        Ok((self.sent, self.credited.saturating_sub(1)))
    }

    #[inline]
    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.send(ItemKind::Record, 8 * words.len(), words)
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        let words = self.words;
        send_in_parts(event, words, |kind, bytes, part| {
            self.send(kind, bytes, part)
        })
    }
}

/// An observer's end over shared memory.
pub struct IceoryxSource {
    records: Subscriber<Ipc, [u64], ItemHeader>,
    credit: Option<Publisher<Ipc, u64, ()>>,
    /// Bell of a plant that sleeps while awaiting credit.
    bell: Option<Bell>,
    /// `true` if the observer has announced itself.
    has_greeted: bool,
    items: Assembler,
    _node: Node<Ipc>,
}

impl IceoryxSource {
    /// Attaches to the stream. The observer that `gives_credit` is the recorder and can hold the plant back; all other
    /// observers only watch.
    ///
    /// # Errors
    /// [`LinkError::Absent`] while the plant has not created the stream.
    pub fn open(session: &SessionInfo, gives_credit: bool) -> Result<Self, LinkError> {
        let node = node(session, "observer")?;
        let credit = gives_credit.then(|| credit(&node, false)).transpose()?;
        let source = Self::subscribe(node, BUFFER, credit.as_ref())?;
        Ok(Self {
            bell: Bell::open(session, Owner::Plant).ok(),
            ..source
        })
    }

    /// Attaches a watcher in addition to the recorder. A watcher that is too slow loses items without affecting the
    /// plant.
    ///
    /// # Errors
    /// [`LinkError::Absent`] while there is no recorder: its place must stay free.
    /// [`LinkError::Taken`] if [`WATCHERS`] others already watch.
    pub fn watch(session: &SessionInfo) -> Result<Self, LinkError> {
        let node = node(session, "watcher")?;
        let recorders = credit(&node, false)?
            .dynamic_config()
            .number_of_publishers();
        if recorders == 0 {
            return Err(LinkError::Absent {
                service: CREDIT.into(),
                reason: "no recorder is attached yet".into(),
            });
        }
        Self::subscribe(node, WATCHERS_BUFFER, None)
    }

    fn subscribe(
        node: Node<Ipc>,
        buffer: usize,
        credit: Option<&Credit>,
    ) -> Result<Self, LinkError> {
        let of_records = records(&node, false)?;
        let records = subscribe(RECORDS, of_records.subscriber_builder().buffer_size(buffer))?;
        let credit = match credit {
            Some(credit) => {
                let publisher = credit.publisher_builder().create();
                Some(publisher.map_err(|e| transport(CREDIT, e))?)
            }
            None => None,
        };
        Ok(Self {
            records,
            credit,
            bell: None,
            has_greeted: false,
            items: Assembler::default(),
            _node: node,
        })
    }
}

impl RecordSource for IceoryxSource {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        let mut count = 0;
        // At most one buffer at a time, so that credit flows while the plant keeps publishing.
        while count < BUFFER / 8
            && let Some(item) = received(RECORDS, self.records.receive())?
        {
            let header = *item.user_header();
            self.items.take(
                (header.sequence, header.kind, header.bytes),
                item.payload(),
                take,
            );
            count += 1;
        }
        // The first credit releases step 0. It follows a poll of the stream, which connects to the publisher: items
        // sent before that would be lost if the plant ended meanwhile.
        let greets = !std::mem::replace(&mut self.has_greeted, true);
        if (count > 0 || greets)
            && let Some(credit) = &self.credit
        {
            credit
                .send_copy(self.items.last().saturating_add(1))
                .map_err(|e| transport(CREDIT, e))?;
            if let Some(bell) = &self.bell {
                bell.ring();
            }
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests;
