//! The medium of one direction of the link, as faults make it: what was sent, what is still under
//! way, and what the receiver has.
//!
//! Used by the layer while a fault of the link acts; otherwise what is sent is what is received.
//! The frames of the lockstep never pass through it: it decides what content they carry.

use shared_types::frame::{Frame, FrameKind, Header, MAX_SIGNALS, Seal, VALIDITY_WORDS};
use shared_types::time::Step;

use super::kind::Passage;

/// Messages that are remembered: one that comes later than this never comes.
const DEPTH: usize = Passage::LATEST_STEPS as usize + 1;
/// Any seal: both ends of the medium are here.
const SEAL: Seal = Seal {
    session: 1,
    layout: 1,
    epoch: 1,
};

/// One message: a row of signals and what is known of them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Message<'a> {
    pub(super) values: &'a [f64],
    pub(super) invalid: &'a [u64; VALIDITY_WORDS],
    /// Steps since its content was made, when it was sent.
    pub(super) age_steps: u32,
}

/// The medium.
#[derive(Debug)]
pub(super) struct Channel {
    width: usize,
    /// The last messages, by step modulo [`DEPTH`].
    values: Vec<f64>,
    about: Vec<About>,
    /// What arrives, by step modulo [`DEPTH`].
    arrivals: Vec<Option<Arrival>>,
    received: Vec<f64>,
    received_about: Option<About>,
    rejected: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct About {
    step: u64,
    age_steps: u32,
    invalid: [u64; VALIDITY_WORDS],
}

/// The message that the receiver has after all that came at one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Arrival {
    at: u64,
    /// It came after all that was in order.
    overtaken: bool,
    sent: u64,
}

impl Channel {
    /// A medium for messages of so many signals.
    pub(super) fn new(width: usize) -> Self {
        Self {
            width,
            values: vec![0.0; DEPTH * width],
            about: vec![About::default(); DEPTH],
            arrivals: vec![None; DEPTH],
            received: vec![0.0; width],
            received_about: None,
            rejected: 0,
        }
    }

    /// Bits of a message's frame.
    pub(super) fn bits(&self) -> u64 {
        8 * (size_of::<Header>() + self.width * size_of::<f64>()) as u64
    }

    /// Messages that the check sum refused.
    pub(super) fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Begins with nothing under way and a receiver that has the message of the step before;
    /// `None`: there was none.
    pub(super) fn begin(&mut self, step: u64, last: Option<&Message<'_>>) {
        self.arrivals.fill(None);
        self.received_about = last.map(|last| {
            self.received.copy_from_slice(last.values);
            About {
                step: step - 1,
                age_steps: last.age_steps,
                invalid: *last.invalid,
            }
        });
    }

    /// Sends the message of a step on its way.
    pub(super) fn send(&mut self, step: u64, message: &Message<'_>, passage: &Passage) {
        let place = (step % DEPTH as u64) as usize;
        let values = &mut self.values[place * self.width..][..self.width];
        values.copy_from_slice(message.values);
        self.about[place] = About {
            step,
            age_steps: message.age_steps,
            invalid: *message.invalid,
        };
        if passage.flipped > 0 && !transmit(step, passage, values) {
            self.rejected += 1;
            return;
        }
        for (late_steps, overtaken) in passage.copies.into_iter().zip(passage.overtaken) {
            if let Some(late_steps) = late_steps.filter(|&late| late <= Passage::LATEST_STEPS) {
                self.arrive(Arrival {
                    at: step + u64::from(late_steps),
                    overtaken: overtaken && late_steps > 0,
                    sent: step,
                });
            }
        }
    }

    /// The last of those that come at one step is the one that the receiver has: in the order in
    /// which they were sent, then those that were overtaken.
    fn arrive(&mut self, arrival: Arrival) {
        let slot = &mut self.arrivals[(arrival.at % DEPTH as u64) as usize];
        match slot {
            Some(other) if other.at == arrival.at && *other > arrival => {}
            _ => *slot = Some(arrival),
        }
    }

    /// What the receiver has at a step; gives its age in steps. Nothing ever came: zeros, all
    /// invalid, as old as the run.
    pub(super) fn receive(
        &mut self,
        step: u64,
        values: &mut [f64],
        invalid: &mut [u64; VALIDITY_WORDS],
    ) -> u32 {
        let slot = self.arrivals[(step % DEPTH as u64) as usize];
        if let Some(arrival) = slot.filter(|arrival| arrival.at == step) {
            let place = (arrival.sent % DEPTH as u64) as usize;
            let sent = &self.values[place * self.width..][..self.width];
            self.received.copy_from_slice(sent);
            self.received_about = Some(self.about[place]);
        }
        values.copy_from_slice(&self.received);
        match self.received_about {
            Some(about) => {
                *invalid = about.invalid;
                about.age_steps.saturating_add((step - about.step) as u32)
            }
            None => {
                values.fill(0.0);
                *invalid = [u64::MAX; VALIDITY_WORDS];
                u32::try_from(step + 1).unwrap_or(u32::MAX)
            }
        }
    }
}

/// Carries a real frame over a line that inverts bits; false if the frame's own check refuses it.
fn transmit(step: u64, passage: &Passage, values: &mut [f64]) -> bool {
    let header = Header::new(FrameKind::Sample, Step(step));
    let mut frame = Frame::<MAX_SIGNALS>::sealed(&header, values, SEAL);
    for bit in &passage.flips[..passage.flipped] {
        frame.flip(*bit);
    }
    frame.open(SEAL, values).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: [Option<u32>; Passage::MOST_COPIES] = [None; Passage::MOST_COPIES];

    /// Sends 10, 11, 12 .. from step 10 on, each with its passage, after 9 was received; gives value
    /// and age at each step.
    fn received(passages: &[Passage]) -> Vec<(f64, u32)> {
        let mut channel = Channel::new(1);
        let valid = [0; VALIDITY_WORDS];
        let last = [9.0];
        channel.begin(
            10,
            Some(&Message {
                values: &last,
                invalid: &valid,
                age_steps: 0,
            }),
        );
        (10..)
            .zip(passages)
            .map(|(step, passage)| {
                let values = [step as f64];
                let sent = Message {
                    values: &values,
                    invalid: &valid,
                    age_steps: 0,
                };
                channel.send(step, &sent, passage);
                let (mut values, mut invalid) = ([0.0], valid);
                let age = channel.receive(step, &mut values, &mut invalid);
                (values[0], age)
            })
            .collect()
    }

    fn healthy() -> Passage {
        Passage::healthy(8 * 152)
    }

    fn copies(given: &[u32]) -> Passage {
        let mut copies = NONE;
        for (copy, late) in copies.iter_mut().zip(given) {
            *copy = Some(*late);
        }
        Passage {
            copies,
            ..healthy()
        }
    }

    #[test]
    fn a_lost_message_leaves_the_receiver_with_the_last_one() {
        let lost = copies(&[]);
        assert_eq!(
            received(&[lost, lost, healthy()]),
            [(9.0, 1), (9.0, 2), (12.0, 0)]
        );
    }

    #[test]
    fn a_constant_delay_shows_the_past() {
        let late = copies(&[2]);
        assert_eq!(
            received(&[late, late, late, late]),
            [(9.0, 1), (9.0, 2), (10.0, 2), (11.0, 2)]
        );
    }

    #[test]
    fn a_late_message_does_not_replace_a_newer_one_that_comes_at_the_same_step() {
        assert_eq!(
            received(&[copies(&[1]), healthy(), healthy()]),
            [(9.0, 1), (11.0, 0), (12.0, 0)]
        );
    }

    #[test]
    fn an_overtaken_message_comes_after_the_next_one() {
        let overtaken = Passage {
            overtaken: [true; Passage::MOST_COPIES],
            ..copies(&[1])
        };
        assert_eq!(
            received(&[overtaken, healthy(), healthy()]),
            [(9.0, 1), (10.0, 1), (12.0, 0)]
        );
    }

    #[test]
    fn a_second_copy_that_comes_late_brings_the_past_back() {
        let twice = copies(&[0, 2]);
        let lost = copies(&[]);
        assert_eq!(
            received(&[twice, healthy(), lost, healthy()]),
            [(10.0, 0), (11.0, 0), (10.0, 2), (13.0, 0)]
        );
    }

    #[test]
    fn inverted_bits_are_refused_and_counted_and_an_even_number_of_them_is_none() {
        let mut broken = healthy();
        (broken.flips[0], broken.flipped) = (1_160, 1);
        assert_eq!(received(&[broken, healthy()]), [(9.0, 1), (11.0, 0)]);
        let mut twice = broken;
        (twice.flips[1], twice.flipped) = (1_160, 2);
        assert_eq!(received(&[twice]), [(10.0, 0)]);
        let mut channel = Channel::new(1);
        let invalid = [0; VALIDITY_WORDS];
        let sent = Message {
            values: &[1.0],
            invalid: &invalid,
            age_steps: 0,
        };
        channel.send(0, &sent, &broken);
        assert_eq!((channel.rejected(), channel.bits()), (1, 8 * 152));
    }

    #[test]
    fn a_receiver_that_never_got_anything_has_nothing_valid() {
        let mut channel = Channel::new(1);
        channel.begin(0, None);
        let (mut values, mut invalid) = ([7.0], [0; VALIDITY_WORDS]);
        assert_eq!(channel.receive(0, &mut values, &mut invalid), 1);
        assert_eq!((values, invalid[0]), ([0.0], u64::MAX));
    }
}
