//! The exchange of frames over a wire that loses, repeats, reorders and delays: two state machines without input or
//! output.
//!
//! Each end has a newest frame and knows the newest of the other that it gave to its peer. A packet carries both.
//! So whatever is lost is made good by any later packet, whatever comes twice or too late changes nothing, and a frame is
//! given to the peer once.
//!
//! The desk asks, the target answers. In lockstep the desk repeats its newest frame until it is answered, after a
//! time that it takes from the round trips; the target answers a frame that it had before with the answer that it has
//! stored, so the law steps once. In real time a sample is never repeated: the next is newer.
//!
//! There the target keeps a sample from the controller as long as the plant has not seen the last answer but one, which the
//! sample itself tells; the last one, if two samples are still to be answered. So at most two answers in a row are unseen by
//! the plant, however many packets are lost, and the two that each command names
//! ([`Answered`]) complete the list of all.

use shared_types::directive::Answered;
use shared_types::frame::{FrameKind, Header};
use shared_types::time::Step;

use crate::packet::{Numbered, Packet, write};

/// Least time before a frame is repeated.
const LEAST_NS: u64 = 1_000_000;
/// Longest time before a frame is repeated.
const MOST_NS: u64 = 50_000_000;
/// Time before a frame is repeated as long as no round trip is known.
const FIRST_NS: u64 = 20_000_000;
/// Time between two packets where nothing has to be said: each end hears that the other lives.
pub const BEAT_NS: u64 = 100_000_000;

/// Facts that both ends know.
#[derive(Debug, Default)]
struct Ends {
    /// Newest frame of this end.
    own: Option<Numbered>,
    /// Highest number of this end's frames that the other has heard.
    answered: u64,
    /// Highest number of the other end's frames that was given to the peer here.
    heard: u64,
}

impl Ends {
    fn next(&mut self, header: &Header, values: &[f64]) {
        let count = usize::from(header.count).min(values.len());
        let own = self.own.get_or_insert_with(|| Numbered {
            number: 0,
            header: *header,
            values: Vec::new(),
        });
        own.number += 1;
        own.header = *header;
        own.values.clear();
        own.values.extend_from_slice(&values[..count]);
    }

    /// Number of the newest frame of this end.
    fn said(&self) -> u64 {
        self.own.as_ref().map_or(0, |own| own.number)
    }

    fn is_heard(&self) -> bool {
        self.said() <= self.answered
    }

    fn packet(&self, bytes: &mut Vec<u8>) {
        let unheard = self.own.as_ref().filter(|_| !self.is_heard());
        write(self.heard, unheard, bytes);
    }

    /// Takes what the other end has heard; nothing that was never said.
    fn note(&mut self, heard: u64) {
        if heard <= self.said() && heard > self.answered {
            self.answered = heard;
        }
    }
}

/// Time of a round trip and its spread, as TCP keeps them (RFC 6298); `None` before the first.
#[derive(Clone, Copy, Debug, Default)]
struct Trips(Option<(u64, u64)>);

impl Trips {
    fn note(&mut self, trip_ns: u64) {
        self.0 = Some(match self.0 {
            None => (trip_ns, trip_ns / 2),
            Some((smooth_ns, spread_ns)) => {
                let apart = smooth_ns.abs_diff(trip_ns);
                (
                    smooth_ns - smooth_ns / 8 + trip_ns / 8,
                    spread_ns - spread_ns / 4 + apart / 4,
                )
            }
        });
    }

    fn patience_ns(self) -> u64 {
        self.0.map_or(FIRST_NS, |(smooth_ns, spread_ns)| {
            (smooth_ns + 4 * spread_ns).clamp(LEAST_NS, MOST_NS)
        })
    }
}

/// Packets of the newest frame.
#[derive(Clone, Copy, Debug)]
enum Sent {
    None,
    /// One, at that time: its answer tells the round trip.
    Once {
        at_ns: u64,
    },
    /// Several: nobody knows which of them was answered.
    Repeatedly,
}

/// The desk's end.
#[derive(Debug)]
pub struct DeskEnd {
    ends: Ends,
    against_clock: bool,
    beat_ns: u64,
    trips: Trips,
    /// The newest frame wants an answer, a frame of the target that was not there when it was sent.
    wants_answer: bool,
    sent: Sent,
    /// Time of the last packet, of whichever frame.
    last_ns: Option<u64>,
    patience_ns: u64,
}

impl DeskEnd {
    /// Makes the end of a run, `against_clock` if its plant waits for nobody; says something each `beat_ns` at
    /// least.
    #[must_use]
    pub fn new(against_clock: bool, beat_ns: u64) -> Self {
        Self {
            ends: Ends::default(),
            against_clock,
            beat_ns,
            trips: Trips::default(),
            wants_answer: false,
            sent: Sent::None,
            last_ns: None,
            patience_ns: FIRST_NS,
        }
    }

    /// Takes a frame of the plant; its packet is due at once.
    pub fn say(&mut self, header: &Header, values: &[f64]) {
        self.ends.next(header, values);
        self.sent = Sent::None;
        self.patience_ns = self.trips.patience_ns();
        self.wants_answer = match header.kind() {
            Some(FrameKind::Sample) => !self.against_clock,
            Some(FrameKind::End) => true,
            _ => false,
        };
    }

    /// Time of the monotonic clock at which the next packet is due.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        let is_new = matches!(self.sent, Sent::None) && !self.ends.is_heard();
        let Some(last_ns) = self.last_ns.filter(|_| !is_new) else {
            return 0;
        };
        let is_open = self.wants_answer || !(self.ends.is_heard() || self.is_passing());
        last_ns
            + if is_open {
                self.patience_ns
            } else {
                self.beat_ns
            }
    }

    /// Returns true if the newest frame is one that the next replaces: it is sent once.
    fn is_passing(&self) -> bool {
        let newest = self.ends.own.as_ref().and_then(|own| own.header.kind());
        self.against_clock && newest == Some(FrameKind::Sample)
    }

    /// Writes the packet that is due now.
    pub fn packet(&mut self, now_ns: u64, bytes: &mut Vec<u8>) {
        let is_first = matches!(self.sent, Sent::None);
        self.sent = if is_first {
            Sent::Once { at_ns: now_ns }
        } else {
            // Longer each time: a controller may compute for long, and the wire may be full.
            self.patience_ns = (2 * self.patience_ns).min(MOST_NS);
            Sent::Repeatedly
        };
        self.last_ns = Some(now_ns);
        if is_first || !self.is_passing() {
            self.ends.packet(bytes);
        } else {
            write(self.ends.heard, None, bytes);
        }
    }

    /// Takes a packet of the target; returns the frame in it if it is to be given to the plant.
    pub fn take(&mut self, packet: Packet, now_ns: u64) -> Option<Numbered> {
        self.ends.note(packet.heard);
        let frame = packet
            .frame
            .filter(|frame| frame.number > self.ends.heard)?;
        // A frame of the target answers one of the desk that it has heard.
        if !self.ends.is_heard() && self.wants_answer {
            return None;
        }
        self.ends.heard = frame.number;
        if let Sent::Once { at_ns } = self.sent {
            self.trips.note(now_ns.saturating_sub(at_ns));
        }
        self.wants_answer = false;
        Some(frame)
    }

    /// Number of the last frame that was given to the plant.
    #[must_use]
    pub const fn heard(&self) -> u64 {
        self.ends.heard
    }

    /// Returns true as long as the plant's newest frame is not answered.
    #[must_use]
    pub fn awaits_answer(&self) -> bool {
        self.wants_answer || !self.ends.is_heard()
    }
}

/// The target's end.
#[derive(Debug)]
pub struct TargetEnd {
    ends: Ends,
    against_clock: bool,
    /// Steps of the last answer that is known and of the one before it, which may never have been known.
    answers: [Option<u64>; 2],
    /// Steps of the last sample that was given to the controller and of the one before it.
    given: [Option<u64>; 2],
}

impl TargetEnd {
    /// Makes the end of a run; `against_clock` if its plant waits for nobody.
    #[must_use]
    pub fn new(against_clock: bool) -> Self {
        Self {
            ends: Ends::default(),
            against_clock,
            answers: [None; 2],
            given: [None; 2],
        }
    }

    /// Checks whether a frame came that is newer than those that were given to the controller.
    #[must_use]
    pub const fn is_news(&self, frame: &Numbered) -> bool {
        frame.number > self.ends.heard
    }

    /// Takes a packet of the desk; returns the frame in it if it is to be given to the controller. Otherwise the packet
    /// wants an answer at once.
    ///
    /// In real time the newest frame of the controller must have been looked for right before, and
    /// [said](Self::say): if there was none, only one of the samples given since its last answer can be in work.
    pub fn take(&mut self, packet: Packet) -> Option<Numbered> {
        self.ends.note(packet.heard);
        let frame = packet.frame.filter(|frame| self.is_news(frame))?;
        if self.against_clock && !self.is_seen(&frame.header) {
            return None;
        }
        self.ends.heard = frame.number;
        if frame.header.kind() == Some(FrameKind::Sample) {
            self.given = [Some(frame.header.step), self.given[0]];
        }
        Some(frame)
    }

    /// Checks whether the plant had seen so much when it made a sample that it will miss two answers in a row at most
    /// if this sample is answered too.
    ///
    /// Of the samples given since the last answer one may be in work, and the newest may be taken before this one
    /// replaces it: if there are two, this one's answer can be the third from now.
    fn is_seen(&self, sample: &Header) -> bool {
        let [last, last_but_one] = self.answers;
        let are_two_open = self.given[1] > last;
        let needed = if are_two_open { last } else { last_but_one };
        let Some(answer) = needed else {
            return true;
        };
        // The step before the sample met the command that the plant holds since so many steps.
        let held = u64::from(sample.held_steps) + 1;
        sample.kind() != Some(FrameKind::Sample) || answer + held <= sample.step
    }

    /// Takes a frame of the controller; its packet is due at once.
    pub fn say(&mut self, header: &Header, values: &[f64]) {
        self.ends.next(header, values);
        if header.kind() == Some(FrameKind::Command) {
            // One that was replaced before anybody looked is known by its name alone.
            let before = Answered::from_wire(header.directive).steps(Step(header.step));
            self.answers = [Some(header.step), before.map(|step| step.0).next()];
        }
    }

    /// Writes the packet that answers.
    pub fn packet(&self, bytes: &mut Vec<u8>) {
        self.ends.packet(bytes);
    }

    /// Returns `true` if the desk has not confirmed the controller's newest frame.
    #[must_use]
    pub fn has_unheard(&self) -> bool {
        !self.ends.is_heard()
    }

    /// Number of the last frame that was given to the controller.
    #[must_use]
    pub const fn heard(&self) -> u64 {
        self.ends.heard
    }

    /// Number of the controller's last frame.
    #[must_use]
    pub fn said(&self) -> u64 {
        self.ends.said()
    }
}

#[cfg(test)]
mod tests;
