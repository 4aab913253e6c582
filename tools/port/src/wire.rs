//! The frames of a port, bound to the rows of a side: what is sent, what arrives, and what is counted.

mod check;
mod ledger;
mod reading;
mod refusals;
mod turn;

use std::io;
use std::mem::take;
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::time::{Duration, Instant};

use hil_codec::frame::{CanId, Frame};
use hil_codec::pack::Packer;
use hil_codec::receive::Receiver;
use hil_codec::row::Row;
use hil_config::port::{Carries, Exchange, MediumKind, Port};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use shared_types::quality::SignalSet;

pub use check::check;
use check::{age_limit, cut, steps};
use refusals::Kind;

use crate::medium::{self, LONGEST, Medium};

/// Most frames that are read in one step from one medium. A peer that sends more is read on at the next step; the
/// kernel drops what does not fit its buffer.
const MOST_AT_ONCE: usize = 4096;
/// Pause between two looks at a medium that cannot be waited for.
const LOOK: Duration = Duration::from_micros(200);
/// Frame that is sent.
struct Outgoing {
    /// Place in the port file.
    frame: usize,
    medium: usize,
    id: Option<CanId>,
    packer: Packer,
    divider: u64,
    /// Bytes that were sent last.
    bytes: Vec<u8>,
    /// `true` if the medium took them, and has not said since that they reached nobody.
    is_sent: bool,
    sent: u64,
    /// Times it was sent once more because no answer had come.
    resent: u64,
}

/// Medium with the frames that arrive on it.
struct Incoming {
    medium: Box<dyn Medium>,
    receiver: Receiver,
    /// Place in the port file of each frame of the receiver.
    frames: Vec<usize>,
}

/// Error of a medium.
#[derive(Debug, thiserror::Error)]
#[error("medium `{name}` ({place}): {error}")]
pub struct WireError {
    name: String,
    place: String,
    error: io::Error,
}

/// Opened port.
pub struct Wire {
    port: Port,
    outgoing: Vec<Outgoing>,
    media: Vec<Incoming>,
    row: Row,
    /// For each frame, its divider in steps.
    dividers: Vec<u64>,
    /// For each frame, `true` if it arrived since the last [`send`](Self::send).
    has_arrived: Vec<bool>,
    unasked: Vec<u64>,
    /// For each frame, the refused fields that have been looked at.
    refused_fields: Vec<u64>,
    printed: Vec<Kind>,
    /// Frames that were read.
    read: u64,
    /// `true` if a medium brought more frames than a step reads.
    is_flooded: bool,
    buffer: Vec<u8>,
}

impl Wire {
    /// Opens the media of a port, whose paths are relative to a folder. A side sends the frames that carry one direction
    /// and receives the others.
    ///
    /// # Errors
    /// If a medium cannot be opened, or frames cannot be told apart on it.
    pub fn open(port: &Port, sends: Carries, period_s: f64, folder: &Path) -> Result<Self, String> {
        let receives = sends.other();
        let (out_table, in_table) = (port.table(sends), port.table(receives));
        let mut row = Row::new(in_table.len());
        let mut outgoing = Vec::new();
        let mut of_medium: Vec<Vec<usize>> = vec![Vec::new(); port.media.len()];
        let mut dividers = Vec::new();
        for (index, one) in port.frames.iter().enumerate() {
            let divider = steps(one, period_s)?;
            dividers.push(divider);
            let medium = one.medium.ok_or("a frame has no medium")?;
            if one.carries == sends {
                let packer = Packer::new(&one.frame, &out_table).map_err(|e| e.to_string())?;
                outgoing.push(Outgoing {
                    frame: index,
                    medium,
                    id: one.frame.id,
                    packer,
                    divider,
                    bytes: Vec::with_capacity(LONGEST),
                    is_sent: false,
                    sent: 0,
                    resent: 0,
                });
            } else {
                of_medium[medium].push(index);
            }
        }
        let mut media = Vec::new();
        for (medium, frames) in port.media.iter().zip(of_medium) {
            let received = || frames.iter().map(|index| &port.frames[*index].frame);
            let place = medium::place(&medium.kind);
            let named = |error: &dyn std::fmt::Display| {
                format!("medium `{}` ({place}): {error}", medium.name)
            };
            let cut = cut(&medium.kind, received()).map_err(|error| named(&error))?;
            let bound: Vec<Frame> = received().cloned().collect();
            let receiver = Receiver::new(&bound, &in_table).map_err(|error| named(&error))?;
            for (place, index) in frames.iter().enumerate() {
                if let Some(stale_s) = port.frames[*index].stale_s {
                    for column in receiver.columns(place) {
                        row.limit_age(*column, age_limit(stale_s, period_s));
                    }
                }
            }
            media.push(Incoming {
                medium: medium::open(medium, cut, folder).map_err(|error| named(&error))?,
                receiver,
                frames,
            });
        }
        Ok(Self {
            outgoing,
            media,
            row,
            dividers,
            has_arrived: vec![false; port.frames.len()],
            unasked: vec![0; port.frames.len()],
            refused_fields: vec![0; port.frames.len()],
            printed: Vec::new(),
            read: 0,
            is_flooded: false,
            buffer: vec![0; LONGEST + 1],
            port: port.clone(),
        })
    }

    /// Returns the received row.
    #[must_use]
    pub const fn row(&self) -> &Row {
        &self.row
    }

    /// Sends the frames that are due at a step, and begins the step of the received row. What arrived before is
    /// accepted, and counted as unasked.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn send(
        &mut self,
        step: u64,
        values: &[f64],
        invalid: &SignalSet,
    ) -> Result<(), WireError> {
        self.begin();
        self.receive()?;
        for (unasked, has_arrived) in self.unasked.iter_mut().zip(&mut self.has_arrived) {
            *unasked += u64::from(take(has_arrived) && self.port.exchange == Exchange::Answers);
        }
        self.transmit(step, values, invalid)
    }

    /// Sends those frames of a step again that reached nobody: a peer may start later than the port, or start again.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn send_again(&mut self, step: u64) -> Result<(), WireError> {
        for one in due(&mut self.outgoing, step).filter(|one| one.is_sent) {
            let medium = &self.media[one.medium].medium;
            one.is_sent = !medium.has_reached_nobody(one.id, &one.bytes);
            one.sent -= u64::from(!one.is_sent);
        }
        for incoming in &mut self.media {
            incoming.medium.forget_lost();
        }
        for one in due(&mut self.outgoing, step).filter(|one| !one.is_sent) {
            let result = self.media[one.medium].medium.send(one.id, &one.bytes);
            one.is_sent = result.map_err(|error| gone(&self.port, one.medium, error))?;
            one.sent += u64::from(one.is_sent);
        }
        Ok(())
    }

    /// Sends the frames of a step once more on media that drop a frame without a word if nobody listens; returns `true`
    /// if there was one.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn resend(&mut self, step: u64) -> Result<bool, WireError> {
        let mut is_resent = false;
        for one in due(&mut self.outgoing, step).filter(|one| one.is_sent) {
            if !drops_silently(&self.port.media[one.medium].kind) {
                continue;
            }
            let result = self.media[one.medium].medium.send(one.id, &one.bytes);
            one.is_sent = result.map_err(|error| gone(&self.port, one.medium, error))?;
            one.resent += u64::from(one.is_sent);
            is_resent |= one.is_sent;
        }
        Ok(is_resent)
    }

    /// Returns the number of frames that have arrived, accepted or not, on the media that [`resend`](Self::resend) uses.
    #[must_use]
    pub fn arrivals(&self) -> u64 {
        let of = |incoming: &Incoming| {
            let places = 0..incoming.frames.len();
            let counts = places.map(|place| incoming.receiver.counts(place));
            let sums = counts.map(|count| count.accepted + count.repeated + count.refused);
            sums.sum::<u64>()
        };
        let media = self.port.media.iter().zip(&self.media);
        let media = media.filter(|(medium, _)| drops_silently(&medium.kind));
        media.map(|(_, incoming)| of(incoming)).sum()
    }

    /// Returns the first frame that is due at a step and has not arrived since [`send`](Self::send).
    #[must_use]
    pub fn awaited(&self, step: u64) -> Option<usize> {
        let frames = self.media.iter().flat_map(|incoming| &incoming.frames);
        let mut awaited = frames.filter(|frame| self.is_awaited(**frame, step));
        awaited.next().copied()
    }

    /// Returns `true` if a frame is due at a step and has not arrived since [`send`](Self::send).
    fn is_awaited(&self, frame: usize, step: u64) -> bool {
        step.is_multiple_of(self.dividers[frame]) && !self.has_arrived[frame]
    }

    /// Returns the name of a frame.
    #[must_use]
    pub fn name(&self, frame: usize) -> &str {
        &self.port.frames[frame].frame.name
    }

    /// Waits until something can be received or a time is reached.
    ///
    /// # Errors
    /// If the system cannot wait.
    pub fn wait(&self, until: Instant) -> io::Result<()> {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(());
        }
        let receives = self.media.iter().filter(|medium| !medium.frames.is_empty());
        let fds: Vec<Option<BorrowedFd<'_>>> = receives
            .map(|incoming| incoming.medium.readable())
            .collect();
        let writable = { self.media.iter() }.filter_map(|incoming| incoming.medium.writable());
        let limit = match fds.iter().all(Option::is_some) {
            true => left,
            false => left.min(LOOK),
        };
        let mut fds: Vec<PollFd<'_>> = { fds.iter().flatten() }
            .map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN))
            .chain(writable.map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::OUT)))
            .collect();
        let limit = Timespec {
            tv_sec: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: limit.subsec_nanos().into(),
        };
        match poll(&mut fds, Some(&limit)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Returns the frames that are due at a step.
fn due(outgoing: &mut [Outgoing], step: u64) -> impl Iterator<Item = &mut Outgoing> {
    let frames = outgoing.iter_mut();
    frames.filter(move |one| step.is_multiple_of(one.divider))
}

/// Returns `true` if a frame that nobody reads is lost on a medium, and the sender does not learn of it.
const fn drops_silently(kind: &MediumKind) -> bool {
    match kind {
        MediumKind::Udp { .. }
        | MediumKind::Cannelloni { .. }
        | MediumKind::Can { .. }
        | MediumKind::Serial { .. } => true,
        MediumKind::Tcp { .. } | MediumKind::Unix { .. } | MediumKind::File { .. } => false,
    }
}

fn gone(port: &Port, medium: usize, error: io::Error) -> WireError {
    let medium = &port.media[medium];
    WireError {
        name: medium.name.clone(),
        place: medium::place(&medium.kind),
        error,
    }
}

#[cfg(test)]
mod tests;
