//! The frames of a port, bound to the rows of a side: what is sent, what arrives, and what is counted.

mod turn;

use std::io;
use std::mem::{Discriminant, discriminant, take};
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::time::{Duration, Instant};

use hil_codec::frame::{Body, CanId, Frame};
use hil_codec::pack::Packer;
use hil_codec::receive::Receiver;
use hil_codec::row::{FieldResult, Refusal, Row};
use hil_config::port::counts::{Counts, FrameCounts, MediumCounts};
use hil_config::port::{Carries, Exchange, MediumKind, Port, PortFrame};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use shared_types::quality::SignalSet;
use shared_types::time::Rate;

use crate::medium::{self, Cut, LONGEST, Medium};

/// Most frames that are read in one step from one medium. A peer that sends more is read on at the next step; the
/// kernel drops what does not fit its buffer.
const MOST_AT_ONCE: usize = 4096;
/// Pause between two looks at a medium that cannot be waited for.
const LOOK: Duration = Duration::from_micros(200);
/// Most kinds of refusals that are printed; all are counted.
const MOST_PRINTED: usize = 20;
/// Most bytes of a refused frame that are printed.
const MOST_BYTES: usize = 64;

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
    /// `true` if the medium took them.
    is_sent: bool,
    sent: u64,
}

/// Medium with the frames that arrive on it.
struct Incoming {
    medium: Box<dyn Medium>,
    receiver: Receiver,
    /// Place in the port file of each frame of the receiver.
    frames: Vec<usize>,
}

/// Kind of refusal: the frame, if it is known, and the reason.
type Kind = (Option<usize>, Discriminant<Refusal>);

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
    buffer: Vec<u8>,
}

/// Returns the number of steps of the period of a frame, for a side that runs once in `period_s`.
fn steps(frame: &PortFrame, period_s: f64) -> Result<u64, String> {
    let rate = Rate::new(1.0 / period_s).ok_or_else(|| format!("no port runs at {period_s} s"))?;
    frame.period.steps(rate).map_err(|(below, above)| {
        let name = &frame.frame.name;
        format!(
            "the period of frame `{name}` is no whole number of steps of {period_s} s; use {below} s or {above} s"
        )
    })
}

/// Returns the largest age in steps of an accepted value.
fn age_limit(stale_s: f64, period_s: f64) -> u32 {
    let steps = (stale_s / period_s * (1.0 + 1e-9)).floor();
    // A conversion from a float saturates.
    steps as u32
}

/// Returns the ends of the frames that arrive on a medium.
fn cut<'a>(kind: &MediumKind, frames: impl Iterator<Item = &'a Frame>) -> Result<Cut, String> {
    if kind.is_stream() {
        return Cut::of(frames, matches!(kind, MediumKind::Serial { .. }));
    }
    let mut bodies = frames.map(|frame| &frame.body);
    Ok(match bodies.any(|body| matches!(body, Body::Json(_))) {
        true => Cut::Line,
        false => Cut::Lengths(Vec::new()),
    })
}

/// Returns `true` if bytes are none of a frame, so that a stream has to be searched again.
const fn is_no_frame(refusal: &Refusal) -> bool {
    matches!(
        refusal,
        Refusal::Foreign { .. } | Refusal::Constant { .. } | Refusal::Checksum { .. }
    )
}

/// Checks a port as a side of a run that sends one direction, without opening anything.
///
/// # Errors
/// If the period of a frame is no whole number of steps, or a frame has no medium.
pub fn check(port: &Port, sends: Carries, period_s: f64) -> Result<(), String> {
    for frame in &port.frames {
        steps(frame, period_s)?;
        if frame.medium.is_none() {
            let name = &frame.frame.name;
            return Err(format!(
                "frame `{name}` has no medium; the far end of a port is reached by one"
            ));
        }
    }
    let of = |carries| port.frames.iter().filter(move |one| one.carries == carries);
    for (index, medium) in port.media.iter().enumerate() {
        let received = of(sends.other()).filter(|one| one.medium == Some(index));
        cut(&medium.kind, received.map(|one| &one.frame))
            .map_err(|error| format!("medium `{}`: {error}", medium.name))?;
    }
    // A plant behind a port waits for nobody.
    if port.exchange == Exchange::Free || sends == Carries::Command {
        return Ok(());
    }
    for command in of(Carries::Command) {
        let divider = steps(command, period_s)?;
        let mut samples = of(Carries::Sample).filter_map(|sample| steps(sample, period_s).ok());
        if !samples.any(|sample| divider.is_multiple_of(sample)) {
            let name = &command.frame.name;
            return Err(format!(
                "frame `{name}` is awaited at steps at which no sample is sent that it could answer; give it the period of a sample, or use `exchange = \"free\"`"
            ));
        }
    }
    Ok(())
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

    /// Sends the frames of a step again on media where the last one reached nobody: a peer may start later than the
    /// port, or start again.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn send_again(&mut self, step: u64) -> Result<(), WireError> {
        for (index, incoming) in self.media.iter_mut().enumerate() {
            if !incoming.medium.has_reached_nobody() {
                continue;
            }
            let due = |one: &&mut Outgoing| one.medium == index && step.is_multiple_of(one.divider);
            for one in self.outgoing.iter_mut().filter(due) {
                let result = incoming.medium.send(one.id, &one.bytes);
                let is_sent = result.map_err(|error| gone(&self.port, index, error))?;
                one.sent += u64::from(is_sent && !one.is_sent);
                one.is_sent |= is_sent;
            }
        }
        Ok(())
    }

    /// Receives all frames that have arrived.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn receive(&mut self) -> Result<(), WireError> {
        for (index, incoming) in self.media.iter_mut().enumerate() {
            let is_file = matches!(self.port.media[index].kind, MediumKind::File { .. });
            if is_file && incoming.frames.is_empty() {
                continue;
            }
            for _ in 0..MOST_AT_ONCE {
                let result = incoming.medium.receive(&mut self.buffer);
                let Some(arrival) = result.map_err(|error| gone(&self.port, index, error))? else {
                    break;
                };
                let bytes = &self.buffer[..arrival.length];
                let (place, result) = (incoming.receiver).receive(arrival.id, bytes, &mut self.row);
                let frame = place.map(|place| incoming.frames[place]);
                match (result, frame) {
                    (Ok(()), Some(frame)) => {
                        self.has_arrived[frame] = true;
                        let place = place.unwrap_or_default();
                        let refused = incoming.receiver.counts(place).refused_fields;
                        if refused > self.refused_fields[frame] {
                            self.refused_fields[frame] = refused;
                            let results = self.row.results();
                            let columns = incoming.receiver.columns(place).iter();
                            for result in columns.map(|column| results[*column]) {
                                if let FieldResult::Refused(refusal) = result
                                    && is_new(
                                        &mut self.printed,
                                        (Some(frame), discriminant(&refusal)),
                                    )
                                {
                                    report(&self.port, index, Some(frame), &refusal, bytes);
                                }
                            }
                        }
                    }
                    (Err(refusal), frame) => {
                        if is_no_frame(&refusal) {
                            incoming.medium.reject();
                        }
                        if is_new(&mut self.printed, (frame, discriminant(&refusal))) {
                            let of = frame.or(incoming.frames.first().copied());
                            report(&self.port, index, of, &refusal, bytes);
                        }
                    }
                    (Ok(()), None) => {}
                }
            }
        }
        Ok(())
    }

    /// Returns the first frame that is due at a step and has not arrived since [`send`](Self::send).
    #[must_use]
    pub fn awaited(&self, step: u64) -> Option<usize> {
        let frames = self.media.iter().flat_map(|incoming| &incoming.frames);
        let mut due = frames.filter(|frame| {
            step.is_multiple_of(self.dividers[**frame]) && !self.has_arrived[**frame]
        });
        due.next().copied()
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
        let limit = match fds.iter().all(Option::is_some) {
            true => left,
            false => left.min(LOOK),
        };
        let mut fds: Vec<PollFd<'_>> = { fds.iter().flatten() }
            .map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN))
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

    /// Returns the counts so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let named = |one: &PortFrame| FrameCounts {
            name: one.frame.name.clone(),
            ..FrameCounts::default()
        };
        let mut counts = Counts {
            frames: self.port.frames.iter().map(named).collect(),
            media: Vec::new(),
            repeatable: self.port.is_repeatable,
        };
        for one in &self.outgoing {
            let count = &mut counts.frames[one.frame];
            count.sent = one.sent;
            count.saturated = one.packer.saturated().iter().sum();
        }
        for (medium, incoming) in self.port.media.iter().zip(&self.media) {
            for (place, frame) in incoming.frames.iter().enumerate() {
                let (count, received) =
                    (&mut counts.frames[*frame], incoming.receiver.counts(place));
                count.accepted = received.accepted;
                count.repeated = received.repeated;
                count.refused = received.refused;
                count.lost = received.lost;
                count.refused_fields = received.refused_fields;
                count.unasked = self.unasked[*frame];
            }
            let of_medium = incoming.medium.counts();
            counts.media.push(MediumCounts {
                name: medium.name.clone(),
                foreign: incoming.receiver.foreign(),
                strangers: of_medium.strangers,
                new_peers: of_medium.new_peers,
                skipped_bytes: of_medium.skipped_bytes,
                unsent: of_medium.unsent,
            });
        }
        counts
    }

    /// Returns the media as a text for messages.
    #[must_use]
    pub fn places(&self) -> String {
        let places: Vec<String> = { self.port.media.iter() }
            .map(|medium| medium::place(&medium.kind))
            .collect();
        places.join("; ")
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

/// Returns `true` for the first refusal of a kind, as far as refusals are printed.
fn is_new(printed: &mut Vec<Kind>, kind: Kind) -> bool {
    let is_new = printed.len() < MOST_PRINTED && !printed.contains(&kind);
    if is_new {
        printed.push(kind);
    }
    is_new
}

/// Prints a refusal with the bytes of the frame.
fn report(port: &Port, medium: usize, frame: Option<usize>, refusal: &Refusal, bytes: &[u8]) {
    let why = match frame {
        Some(frame) => refusal.describe(&port.frames[frame].frame),
        None => "no frame is received on this medium".into(),
    };
    let beginning = &bytes[..bytes.len().min(MOST_BYTES)];
    let hex: Vec<String> = beginning.iter().map(|byte| format!("{byte:02x}")).collect();
    let rest = match bytes.len() > beginning.len() {
        true => " ..",
        false => "",
    };
    hil_session::program::say(&format!(
        "medium `{}`: refused: {why}; bytes: {}{rest} (further ones of this kind are counted only)",
        port.media[medium].name,
        hex.join(" ")
    ));
}
