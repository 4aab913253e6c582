//! Exchange of frames over a wire that loses, repeats, reorders and delays packets: two state machines without
//! input or output.
//!
//! Each end has a latest frame, and the number of the other end's latest frame that it passed to its peer. A packet
//! carries both. So any later packet makes up for lost ones, duplicates and late packets change nothing, and a frame is
//! passed to the peer only once.
//!
//! The desk asks, and the target answers. In lockstep the desk repeats its latest frame until it is answered, after a
//! timeout derived from the round trips; the target answers a repeated frame with the stored answer, so that the law
//! steps only once. In real time a sample is never repeated, because the next one is newer.
//!
//! In real time the target withholds a sample from the controller until the plant has seen the last answer but one, as
//! stated by the sample itself, or the last answer if two samples are still unanswered. So the plant misses at most two
//! consecutive answers, however many packets are lost, and the two answers named by each command ([`Answered`])
//! complete the list of all.

use shared_types::directive::Answered;
use shared_types::frame::{FrameKind, Header};
use shared_types::time::Step;

use crate::packet::{Numbered, Packet, write};

/// Minimum time before a frame is repeated in ns.
const LEAST_NS: u64 = 1_000_000;
/// Maximum time before a frame is repeated in ns.
const MOST_NS: u64 = 50_000_000;
/// Time before a frame is repeated until a round trip is known, in ns.
const FIRST_NS: u64 = 20_000_000;
/// Interval between packets without news, in ns: a sign of life for the other end.
pub const BEAT_NS: u64 = 100_000_000;

/// State common to both ends.
#[derive(Debug, Default)]
struct Ends {
    /// Latest frame of this end.
    own: Option<Numbered>,
    /// Highest number of this end's frames received by the other end.
    answered: u64,
    /// Highest number of the other end's frames passed to the peer here.
    received: u64,
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

    /// Returns the number of this end's latest frame.
    fn said(&self) -> u64 {
        self.own.as_ref().map_or(0, |own| own.number)
    }

    fn is_heard(&self) -> bool {
        self.said() <= self.answered
    }

    fn packet(&self, bytes: &mut Vec<u8>) {
        let unreceived = self.own.as_ref().filter(|_| !self.is_heard());
        write(self.received, unreceived, bytes);
    }

    /// Records a number received by the other end; ignores numbers that were never sent.
    fn note(&mut self, received: u64) {
        if received <= self.said() && received > self.answered {
            self.answered = received;
        }
    }
}

/// Round-trip time and its variation, as in TCP (RFC 6298); `None` before the first.
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

/// Packets of the latest frame.
#[derive(Clone, Copy, Debug)]
enum Sent {
    None,
    /// Single packet, at that time: its answer gives the round trip.
    Once {
        at_ns: u64,
    },
    /// Several packets: the answered one is unknown.
    Repeatedly,
}

/// Desk's end.
#[derive(Debug)]
pub struct DeskEnd {
    ends: Ends,
    against_clock: bool,
    beat_ns: u64,
    trips: Trips,
    /// `true` if the latest frame needs an answer: a frame of the target newer than those known when it was sent.
    wants_answer: bool,
    sent: Sent,
    /// Time of the last packet of any frame.
    last_ns: Option<u64>,
    patience_ns: u64,
}

impl DeskEnd {
    /// Creates the desk's end of a run, `against_clock` if its plant never waits; sends a packet at least every
    /// `beat_ns`.
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

    /// Accepts a frame of the plant; its packet is due at once.
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

    /// Returns the time of the monotonic clock at which the next packet is due.
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

    /// Returns `true` if the latest frame is sent only once, because the next frame replaces it.
    fn is_passing(&self) -> bool {
        let newest = self.ends.own.as_ref().and_then(|own| own.header.kind());
        self.against_clock && newest == Some(FrameKind::Sample)
    }

    /// Writes the packet that is due.
    pub fn packet(&mut self, now_ns: u64, bytes: &mut Vec<u8>) {
        let is_first = matches!(self.sent, Sent::None);
        self.sent = if is_first {
            Sent::Once { at_ns: now_ns }
        } else {
            // Backs off: a controller may compute for a long time, and the wire may be congested.
            self.patience_ns = (2 * self.patience_ns).min(MOST_NS);
            Sent::Repeatedly
        };
        self.last_ns = Some(now_ns);
        if is_first || !self.is_passing() {
            self.ends.packet(bytes);
        } else {
            write(self.ends.received, None, bytes);
        }
    }

    /// Processes a packet of the target; returns its frame if the frame must be passed to the plant.
    pub fn take(&mut self, packet: Packet, now_ns: u64) -> Option<Numbered> {
        self.ends.note(packet.received);
        let frame = packet
            .frame
            .filter(|frame| frame.number > self.ends.received)?;
        // A frame of the target answers the desk's frame that it has received.
        if !self.ends.is_heard() && self.wants_answer {
            return None;
        }
        self.ends.received = frame.number;
        if let Sent::Once { at_ns } = self.sent {
            self.trips.note(now_ns.saturating_sub(at_ns));
        }
        self.wants_answer = false;
        Some(frame)
    }

    /// Returns the number of the last frame passed to the plant.
    pub(crate) const fn received(&self) -> u64 {
        self.ends.received
    }

    /// Returns `true` while the plant's latest frame is unanswered.
    pub(crate) fn awaits_answer(&self) -> bool {
        self.wants_answer || !self.ends.is_heard()
    }
}

/// Target's end.
#[derive(Debug)]
pub struct TargetEnd {
    ends: Ends,
    against_clock: bool,
    /// Steps of the last known answer and of the one before it, if known.
    answers: [Option<u64>; 2],
    /// Steps of the last two samples passed to the controller.
    delivered: [Option<u64>; 2],
}

impl TargetEnd {
    /// Creates the target's end of a run; `against_clock` if its plant never waits.
    #[must_use]
    pub fn new(against_clock: bool) -> Self {
        Self {
            ends: Ends::default(),
            against_clock,
            answers: [None; 2],
            delivered: [None; 2],
        }
    }

    /// Returns `true` if a frame is newer than those passed to the controller.
    pub(crate) const fn is_news(&self, frame: &Numbered) -> bool {
        frame.number > self.ends.received
    }

    /// Processes a packet of the desk; returns its frame if the frame must be passed to the controller. Otherwise the
    /// packet needs an answer at once.
    ///
    /// In real time the caller must just have polled the controller's latest frame and [passed it on](Self::say): if
    /// there was none, at most one of the samples passed since its last answer can be in progress.
    pub fn take(&mut self, packet: Packet) -> Option<Numbered> {
        self.ends.note(packet.received);
        let frame = packet.frame.filter(|frame| self.is_news(frame))?;
        if self.against_clock && !self.is_seen(&frame.header) {
            return None;
        }
        self.ends.received = frame.number;
        if frame.header.kind() == Some(FrameKind::Sample) {
            self.delivered = [Some(frame.header.step), self.delivered[0]];
        }
        Some(frame)
    }

    /// Returns `true` if the plant has seen enough answers at this sample to miss at most two consecutive ones, even if
    /// this sample is also answered.
    ///
    /// Of the samples passed since the last answer, one may be in progress, and the latest may be taken before this
    /// sample replaces it: with two such samples, the answer to this one can be the third from now.
    fn is_seen(&self, sample: &Header) -> bool {
        let [last, last_but_one] = self.answers;
        let are_two_open = self.delivered[1] > last;
        let needed = if are_two_open { last } else { last_but_one };
        let Some(answer) = needed else {
            return true;
        };
        // The step before the sample received the command that the plant has held for this many steps.
        let held = u64::from(sample.held_steps) + 1;
        sample.kind() != Some(FrameKind::Sample) || answer + held <= sample.step
    }

    /// Accepts a frame of the controller; its packet is due at once.
    pub fn say(&mut self, header: &Header, values: &[f64]) {
        self.ends.next(header, values);
        if header.kind() == Some(FrameKind::Command) {
            // A replaced answer is known only because later commands name it.
            let before = Answered::from_wire(header.directive).steps(Step(header.step));
            self.answers = [Some(header.step), before.map(|step| step.0).next()];
        }
    }

    /// Writes the answering packet.
    pub fn packet(&self, bytes: &mut Vec<u8>) {
        self.ends.packet(bytes);
    }

    /// Returns `true` if the desk has not confirmed the controller's latest frame.
    pub(crate) fn has_unheard(&self) -> bool {
        !self.ends.is_heard()
    }

    /// Returns the number of the last frame passed to the controller.
    pub(crate) const fn received(&self) -> u64 {
        self.ends.received
    }

    /// Returns the number of the controller's last frame.
    pub(crate) fn said(&self) -> u64 {
        self.ends.said()
    }
}

#[cfg(test)]
mod tests;
