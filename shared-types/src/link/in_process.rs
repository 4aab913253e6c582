//! A link within one thread: two mailboxes.
//!
//! Used for runs without a second process (`hil run --link in-process`) and for tests. The link carries the same frames
//! as shared memory, but without the checksum, because nothing can corrupt them here.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use super::{FrameSpec, Link, LinkError, Peer};
use crate::frame::{FrameIdentity, Header, MAX_SIGNALS};
use crate::hello::Control;
use crate::ignored::Ignored;
use crate::table::canonical;

/// Creates two connected ends.
#[must_use]
pub fn pair() -> (InProcessLink, InProcessLink) {
    let (there, back) = (Rc::default(), Rc::default());
    (
        InProcessLink::new(Rc::clone(&there), Rc::clone(&back)),
        InProcessLink::new(back, there),
    )
}

/// End of an in-process link.
pub struct InProcessLink {
    outgoing: Rc<RefCell<Mailbox>>,
    incoming: Rc<RefCell<Mailbox>>,
    identity: Option<FrameIdentity>,
    /// Identity of the frames opened last, while older ones are still in use.
    next: Option<FrameIdentity>,
    sequence: u64,
    rejected: Ignored,
}

#[derive(Default)]
struct Mailbox {
    control: VecDeque<Message>,
    /// Messages to the controller of an epoch whose frames are in use.
    messages: VecDeque<(u32, Vec<u8>)>,
    frame: Option<Header>,
    values: Vec<f64>,
}

/// Control message as it was sent.
enum Message {
    Bytes(Vec<u8>),
    Value(Control),
}

impl InProcessLink {
    fn new(outgoing: Rc<RefCell<Mailbox>>, incoming: Rc<RefCell<Mailbox>>) -> Self {
        Self {
            outgoing,
            incoming,
            identity: None,
            next: None,
            sequence: 0,
            rejected: Ignored::default(),
        }
    }

    /// Creates an end for another controller on the same plant.
    #[must_use]
    pub fn another(&self) -> Self {
        Self::new(Rc::clone(&self.outgoing), Rc::clone(&self.incoming))
    }

    /// Takes the next control message.
    fn next(&mut self) -> Option<Message> {
        let mut mailbox = self.incoming.borrow_mut();
        let is_own = |(epoch, _): &(u32, Vec<u8>)| {
            (self.identity).is_some_and(|identity| identity.epoch == *epoch)
        };
        if mailbox.messages.front().is_some_and(is_own) {
            let message = mailbox.messages.pop_front();
            return message.map(|(_, bytes)| Message::Bytes(bytes));
        }
        mailbox.control.pop_front()
    }
}

impl Link for InProcessLink {
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError> {
        let mut mailbox = self.outgoing.borrow_mut();
        mailbox.control.push_back(Message::Bytes(message.to_vec()));
        Ok(())
    }

    fn send_message(&mut self, message: Control) -> Result<(), LinkError> {
        let mut mailbox = self.outgoing.borrow_mut();
        mailbox.control.push_back(Message::Value(message));
        Ok(())
    }

    fn tell(&mut self, message: &[u8]) -> Result<(), LinkError> {
        let identity = self.identity.ok_or(LinkError::NotOpen)?;
        let mut mailbox = self.outgoing.borrow_mut();
        mailbox
            .messages
            .push_back((identity.epoch, message.to_vec()));
        Ok(())
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        Ok(self.next().map(|message| match message {
            Message::Bytes(bytes) => bytes,
            Message::Value(message) => message.to_bytes(),
        }))
    }

    fn receive_message(&mut self) -> Result<Option<Option<Control>>, LinkError> {
        Ok(self.next().map(|message| match message {
            Message::Bytes(bytes) => Control::from_bytes(&bytes).ok(),
            Message::Value(message) => Some(message),
        }))
    }

    fn expect(&mut self, _epoch: u32) -> Result<(), LinkError> {
        self.incoming.borrow_mut().control.clear();
        self.outgoing.borrow_mut().control.clear();
        Ok(())
    }

    fn peer(&self) -> Result<Peer, LinkError> {
        Ok(Peer::Launched)
    }

    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError> {
        for count in [spec.outgoing, spec.incoming] {
            if count > MAX_SIGNALS {
                return Err(LinkError::TooManySignals(count));
            }
        }
        self.outgoing.borrow_mut().values.reserve(spec.outgoing);
        self.next = Some(spec.identity);
        if self.identity.is_none() {
            self.take_over();
        }
        Ok(())
    }

    fn take_over(&mut self) {
        if let Some(next) = self.next.take() {
            self.identity = Some(next);
            self.sequence = 0;
            // The receiver of the other messages no longer exists.
            let mut mailbox = self.outgoing.borrow_mut();
            mailbox.messages.retain(|(epoch, _)| *epoch >= next.epoch);
        }
    }

    #[inline]
    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError> {
        let identity = self.identity.ok_or(LinkError::NotOpen)?;
        self.sequence += 1;
        let mut mailbox = self.outgoing.borrow_mut();
        mailbox.frame = Some(Header {
            session: identity.session,
            layout: identity.layout,
            epoch: identity.epoch,
            sequence: self.sequence,
            count: values.len() as u16,
            ..*header
        });
        mailbox.values.clear();
        mailbox.values.extend(values.iter().map(|v| canonical(*v)));
        Ok(())
    }

    #[inline]
    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let identity = self.identity.ok_or(LinkError::NotOpen)?;
        let mut mailbox = self.incoming.borrow_mut();
        let Some(header) = mailbox.frame.take() else {
            return Ok(None);
        };
        if let Err(error) = identity.check(&header, values.len()) {
            self.rejected.count(error);
            return Ok(None);
        }
        if header.count > 0 {
            values.copy_from_slice(&mailbox.values);
        }
        Ok(Some(header))
    }

    fn rejected(&self) -> Ignored {
        self.rejected
    }
}
