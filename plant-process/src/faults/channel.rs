//! Medium of one direction of the link under faults: sent messages, and the receiver's view of them.
//!
//! Used by the [signal path](super::signal_path) of that direction. While no link fault acts, messages are received as
//! sent, and the channel only remembers them. Lockstep frames never pass through the channel, which only determines
//! their content.

use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::frame::{
    Frame, FrameIdentity, FrameKind, Header, MAX_SIGNALS, VALIDITY_WORDS, words,
};
use shared_types::time::Step;

use super::arrivals::{Arrivals, DEPTH, age_steps};
use super::kind::Passage;

/// Arbitrary identity: both ends of the medium are in this process.
const IDENTITY: FrameIdentity = FrameIdentity {
    session: 1,
    layout: 1,
    epoch: 1,
};

/// Medium of one direction.
#[derive(Debug)]
pub(super) struct Channel {
    width: usize,
    kind: FrameKind,
    /// Last messages, by step modulo [`DEPTH`].
    values: Vec<f64>,
    about: Vec<About>,
    arrivals: Arrivals,
    /// Message that the receiver has, possibly older than all of `values`.
    received: Vec<f64>,
    received_about: About,
    /// `true` if the receiver has no message yet.
    silent: bool,
    /// `true` if the last message was received as sent.
    bypassed: bool,
    /// Buffer for opening a corrupted frame.
    opened: Vec<f64>,
    rejected: u64,
}

/// Metadata of a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct About {
    /// Step at which the message was sent.
    pub(super) step: u64,
    /// Age of the content at that step, in steps.
    pub(super) age_steps: u32,
    /// Bits of the invalid values.
    pub(super) invalid: [u64; VALIDITY_WORDS],
}

/// Saved state of a medium.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedChannel {
    /// `None` while no link fault acts: the next one begins with nothing in transit.
    under_way: Option<UnderWay>,
    received: Vec<f64>,
    received_about: About,
    silent: bool,
    rejected: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct UnderWay {
    values: Vec<f64>,
    about: Vec<About>,
    arrivals: Arrivals,
}

impl Channel {
    /// Creates a medium for messages of N signals, in frames of this kind.
    pub(super) fn new(width: usize, kind: FrameKind) -> Self {
        Self {
            width,
            kind,
            values: vec![0.0; DEPTH * width],
            about: vec![About::default(); DEPTH],
            arrivals: Arrivals::new(),
            received: vec![0.0; width],
            received_about: About::default(),
            silent: true,
            bypassed: true,
            opened: vec![0.0; width],
            rejected: 0,
        }
    }

    /// Returns the state.
    pub(super) fn save(&self) -> SavedChannel {
        SavedChannel {
            under_way: (!self.bypassed).then(|| UnderWay {
                values: self.values.clone(),
                about: self.about.clone(),
                arrivals: self.arrivals.clone(),
            }),
            received: self.received.clone(),
            received_about: self.received_about,
            silent: self.silent,
            rejected: self.rejected,
        }
    }

    /// Restores a saved state.
    pub(super) fn restore(&mut self, saved: SavedChannel) -> Result<(), Invalid> {
        let not_one = || Invalid("the state of the link does not belong to this plant".into());
        if saved.received.len() != self.width {
            return Err(not_one());
        }
        self.bypassed = saved.under_way.is_none();
        if let Some(under_way) = saved.under_way {
            let lengths = (under_way.values.len(), under_way.about.len());
            if lengths != (self.values.len(), self.about.len()) {
                return Err(not_one());
            }
            (self.values, self.about) = (under_way.values, under_way.about);
            self.arrivals.restore(&under_way.arrivals)?;
        }
        (self.received, self.received_about) = (saved.received, saved.received_about);
        (self.silent, self.rejected) = (saved.silent, saved.rejected);
        Ok(())
    }

    /// Returns the number of bits in a message's frame.
    pub(super) const fn bits(&self) -> u64 {
        64 * words(self.width) as u64
    }

    /// Returns the number of frames rejected by their checksum.
    pub(super) const fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Returns the messages in transit.
    pub(super) const fn arrivals(&self) -> &Arrivals {
        &self.arrivals
    }

    /// Remembers a message that is received as sent, because no link fault acts.
    pub(super) fn note(&mut self, values: &[f64], about: About) {
        self.received.copy_from_slice(values);
        self.received_about = about;
        self.silent = false;
        self.bypassed = true;
    }

    /// Begins a link fault, possibly in addition to others.
    pub(super) fn begin(&mut self) {
        if std::mem::take(&mut self.bypassed) {
            let received = (!self.silent).then_some(self.received_about.step);
            self.arrivals.begin(received);
        }
    }

    /// Ends a link fault, possibly while others continue.
    pub(super) const fn end(&mut self, step: Step) {
        self.arrivals.overrule(step.0);
    }

    /// Stores the message to be sent. [`Channel::send`] follows for the same step.
    pub(super) fn put(&mut self, values: &[f64], about: About) {
        let place = (about.step % DEPTH as u64) as usize;
        self.values[place * self.width..][..self.width].copy_from_slice(values);
        self.about[place] = about;
    }

    /// Returns `true` if the stored message is accepted with these bits inverted.
    pub(super) fn gets_through(&mut self, step: Step, passage: &Passage) -> bool {
        passage.flipped == 0 || self.open_broken(step, passage).is_some()
    }

    /// Sends the stored message.
    pub(super) fn send(&mut self, step: Step, passage: &Passage) {
        if passage.flipped > 0 {
            let Some(header) = self.open_broken(step, passage) else {
                // The receiver rejects each copy.
                self.rejected += passage.copies.iter().flatten().count() as u64;
                return;
            };
            let place = (step.0 % DEPTH as u64) as usize;
            self.values[place * self.width..][..self.width].copy_from_slice(&self.opened);
            self.about[place].age_steps = header.age_steps;
            self.about[place].invalid = header.invalid;
        }
        self.arrivals.send(step.0, passage);
    }

    /// Seals the stored message in a real frame, inverts its bits and opens the frame into `opened`; `None` if the
    /// frame's check rejects it.
    fn open_broken(&mut self, step: Step, passage: &Passage) -> Option<Header> {
        let place = (step.0 % DEPTH as u64) as usize;
        let header = Header {
            age_steps: self.about[place].age_steps,
            invalid: self.about[place].invalid,
            ..Header::new(self.kind, step)
        };
        let values = &self.values[place * self.width..][..self.width];
        let mut frame = Frame::<{ words(MAX_SIGNALS) }>::sealed(&header, values, IDENTITY);
        for bit in &passage.flips[..passage.flipped] {
            frame.flip(*bit);
        }
        frame.open(IDENTITY, &mut self.opened).ok()
    }

    /// Writes the receiver's values at a step and returns their age in steps. Before the first message the values are
    /// zero, invalid, and as old as the run.
    pub(super) fn receive(
        &mut self,
        step: Step,
        values: &mut [f64],
        invalid: &mut [u64; VALIDITY_WORDS],
    ) -> u32 {
        let received = self.arrivals.receive(step.0);
        if let Some(step_sent) = received
            && (self.silent || step_sent != self.received_about.step)
        {
            let place = (step_sent % DEPTH as u64) as usize;
            let row = &self.values[place * self.width..][..self.width];
            self.received.copy_from_slice(row);
            self.received_about = self.about[place];
            self.silent = false;
        }
        values.copy_from_slice(&self.received);
        let late_steps = age_steps(step.0, received);
        if self.silent {
            *invalid = [u64::MAX; VALIDITY_WORDS];
            late_steps
        } else {
            *invalid = self.received_about.invalid;
            self.received_about.age_steps.saturating_add(late_steps)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALID: [u64; VALIDITY_WORDS] = [0; VALIDITY_WORDS];

    /// Channel of two signals whose message of step k has the values k and -k.
    struct Line(Channel);

    impl Line {
        fn new() -> Self {
            Self(Channel::new(2, FrameKind::Sample))
        }

        fn about(step: u64) -> About {
            // The content of message 3 was two steps old when it was sent, and half of it invalid.
            let mut about = About {
                step,
                ..About::default()
            };
            if step == 3 {
                (about.age_steps, about.invalid[0]) = (2, 0b10);
            }
            about
        }

        fn note(&mut self, step: u64) {
            self.0
                .note(&[step as f64, -(step as f64)], Self::about(step));
        }

        /// Returns the first value, the age and the first word of invalid bits.
        fn pass(&mut self, step: u64, passage: &Passage) -> (f64, u32, u64) {
            let (k, mut invalid) = (step as f64, VALID);
            let mut values = [f64::NAN; 2];
            self.0.put(&[k, -k], Self::about(step));
            self.0.send(Step(step), passage);
            let age = self.0.receive(Step(step), &mut values, &mut invalid);
            assert_eq!(values[0] + values[1], 0.0, "one message, not parts of two");
            (values[0], age, invalid[0])
        }
    }

    fn late(copies: [Option<u32>; 2]) -> Passage {
        Passage {
            copies: [copies[0], copies[1], None, None],
            ..Passage::healthy(0)
        }
    }

    const LOST: [Option<u32>; 2] = [None; 2];

    #[test]
    fn a_message_carries_its_values_validity_and_age() {
        let mut line = Line::new();
        line.note(1);
        line.0.begin();
        assert_eq!(line.pass(2, &late([Some(2), None])), (1.0, 1, 0));
        assert_eq!(line.pass(3, &late([Some(2), None])), (1.0, 2, 0));
        assert_eq!(line.pass(4, &late([Some(2), None])), (2.0, 2, 0));
        assert_eq!(line.pass(5, &late([Some(2), None])), (3.0, 2 + 2, 0b10));
        assert_eq!(line.pass(6, &late([Some(0), None])), (6.0, 0, 0));
    }

    #[test]
    fn the_last_message_outlives_the_channels_memory() {
        let mut line = Line::new();
        line.note(1);
        line.0.begin();
        let steps = 2..3 * DEPTH as u64;
        for step in steps {
            assert_eq!(line.pass(step, &late(LOST)), (1.0, step as u32 - 1, 0));
        }
    }

    #[test]
    fn a_receiver_without_any_message_has_invalid_zeros() {
        let mut line = Line::new();
        line.0.begin();
        assert_eq!(line.pass(0, &late(LOST)), (0.0, 1, u64::MAX));
        assert_eq!(line.pass(1, &late(LOST)), (0.0, 2, u64::MAX));
        assert_eq!(line.pass(2, &late([Some(0), None])), (2.0, 0, 0));
    }

    #[test]
    fn a_fault_that_immediately_follows_another_continues_from_its_state() {
        let mut line = Line::new();
        line.note(0);
        line.0.begin();
        for step in 1..=5 {
            line.pass(step, &late([Some(4), None]));
        }
        // The delay ends and a loss begins: the receiver has message 1, not message 5.
        line.0.end(Step(6));
        line.0.begin();
        assert_eq!(line.pass(6, &late(LOST)), (2.0, 4, 0));
    }

    #[test]
    fn no_message_stays_in_transit_between_two_faults() {
        let mut line = Line::new();
        line.note(0);
        line.0.begin();
        line.pass(1, &late([Some(3), None]));
        line.0.end(Step(2));
        line.note(2);
        line.0.begin();
        assert_eq!(line.pass(3, &late(LOST)), (2.0, 1, 0));
        assert_eq!(line.pass(4, &late(LOST)), (2.0, 2, 0));
    }

    #[test]
    fn every_copy_with_an_inverted_bit_is_rejected_and_counted() {
        let mut line = Line::new();
        line.note(1);
        line.0.begin();
        let bits = line.0.bits();
        assert_eq!(bits, 64 * (1 + 11 + 1 + 2)); // checksum, header, validity, values
        // In the checksum, in the first value, in the last; and one that no copy carries.
        let mut refusals = 0;
        for (step, bit, copies) in [
            (2, 0, [Some(0), None]),
            (3, 64 * 13, [Some(0), Some(1)]),
            (4, bits - 1, [Some(3), None]),
            (5, 0, LOST),
        ] {
            let mut broken = late(copies);
            (broken.flips[0], broken.flipped) = (bit, 1);
            assert_eq!(line.pass(step, &broken), (1.0, step as u32 - 1, 0));
            refusals += copies.iter().flatten().count() as u64;
            assert_eq!(line.0.rejected(), refusals);
        }
        assert_eq!(refusals, 4);
    }

    #[test]
    fn a_bit_inverted_twice_is_restored() {
        let mut line = Line::new();
        line.0.begin();
        let mut passage = late([Some(0), None]);
        passage.flips[..2].copy_from_slice(&[700; 2]);
        passage.flipped = 2;
        assert_eq!(line.pass(3, &passage), (3.0, 2, 0b10));
        assert_eq!(line.0.rejected(), 0);
    }
}
