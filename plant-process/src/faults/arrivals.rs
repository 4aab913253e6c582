//! Arrival of messages at the receiver: steps only, no content.
//!
//! The [`channel`](super::channel) has one instance for the real arrivals, and every link fault has one for the
//! arrivals as if no other fault followed it: the difference between two instances is the effect of a single fault. The
//! causes of delays are unknown here.

use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;

use super::kind::Passage;

/// Maximum number of messages in transit: a message with a longer delay never arrives.
pub(super) const DEPTH: usize = Passage::LATEST_STEPS as usize + 1;
/// Step that never comes.
const NEVER: u64 = u64::MAX;

/// Messages in transit, and the message that was received last.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Arrivals {
    /// Slots by step of arrival, modulo [`DEPTH`].
    slots: Vec<Slot>,
    /// Step at which the last received message was sent.
    received: Option<u64>,
    /// Step before which sent messages no longer replace newer ones.
    overruled: u64,
}

/// Relevant messages among those that arrive at one step: the last of each kind.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Slot {
    /// Step of arrival; at any other step the slot is stale.
    at: u64,
    in_order: Option<u64>,
    /// Last overtaken message, which arrives after all messages that are in order.
    overtaken: Option<u64>,
}

const EMPTY: Slot = Slot {
    at: NEVER,
    in_order: None,
    overtaken: None,
};

impl Arrivals {
    /// Creates an empty state: nothing in transit, nothing received.
    pub(super) fn new() -> Self {
        Self {
            slots: vec![EMPTY; DEPTH],
            received: None,
            overruled: 0,
        }
    }

    /// Starts with nothing in transit and a receiver that has this message.
    pub(super) fn begin(&mut self, received: Option<u64>) {
        self.slots.fill(EMPTY);
        self.received = received;
        self.overruled = 0;
    }

    /// Continues from the state of another instance.
    pub(super) fn continue_from(&mut self, other: &Self) {
        self.slots.copy_from_slice(&other.slots);
        self.received = other.received;
        self.overruled = other.overruled;
    }

    /// Restores a saved state.
    pub(super) fn restore(&mut self, saved: &Self) -> Result<(), Invalid> {
        if saved.slots.len() != DEPTH {
            return Err(Invalid("the state of the link is not valid".into()));
        }
        self.continue_from(saved);
        Ok(())
    }

    /// Ends a fault of the link: messages that it delayed no longer replace newer ones.
    pub(super) const fn overrule(&mut self, step: u64) {
        self.overruled = step;
    }

    /// Sends the message of a step.
    pub(super) fn send(&mut self, step: u64, passage: &Passage) {
        for (late_steps, overtaken) in passage.copies.into_iter().zip(passage.overtaken) {
            let Some(late_steps) = late_steps.filter(|&late| late <= Passage::LATEST_STEPS) else {
                continue;
            };
            let at = step + u64::from(late_steps);
            let slot = &mut self.slots[(at % DEPTH as u64) as usize];
            if slot.at != at {
                *slot = Slot { at, ..EMPTY };
            }
            // Steps rise, so this message was sent after all in the slots.
            if overtaken && late_steps > 0 {
                slot.overtaken = Some(step);
            } else {
                slot.in_order = Some(step);
            }
        }
    }

    /// Processes the arrivals at a step and returns the message that the receiver has afterwards.
    pub(super) fn receive(&mut self, step: u64) -> Option<u64> {
        let slot = self.slots[(step % DEPTH as u64) as usize];
        if slot.at == step {
            for message in [slot.in_order, slot.overtaken].into_iter().flatten() {
                let older = self.received.is_some_and(|received| message < received);
                if !(older && message < self.overruled) {
                    self.received = Some(message);
                }
            }
        }
        self.received
    }
}

/// Returns the steps since a message was sent; without a message, as if one had been sent just before step 0.
pub(super) fn age_steps(step: u64, received: Option<u64>) -> u32 {
    let age = received.map_or(step + 1, |received| step - received);
    u32::try_from(age).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn copies(late_steps: &[u32]) -> Passage {
        let mut passage = Passage::healthy(0);
        passage.copies = [None; Passage::MOST_COPIES];
        for (copy, late) in passage.copies.iter_mut().zip(late_steps) {
            *copy = Some(*late);
        }
        passage
    }

    fn overtaken(late_steps: &[u32]) -> Passage {
        Passage {
            overtaken: [true; Passage::MOST_COPIES],
            ..copies(late_steps)
        }
    }

    /// Sends messages 10, 11, 12 .. each with its passage, after 9 was received; returns the receiver's message at each
    /// step.
    fn received(passages: &[Passage]) -> Vec<u64> {
        let mut arrivals = Arrivals::new();
        arrivals.begin(Some(9));
        let mut pass = |(step, passage): (u64, &Passage)| {
            arrivals.send(step, passage);
            arrivals
                .receive(step)
                .expect("there was one from the begin")
        };
        (10..).zip(passages).map(&mut pass).collect()
    }

    #[test]
    fn the_receiver_has_the_last_arrival() {
        let (healthy, lost, late) = (copies(&[0]), copies(&[]), copies(&[2]));
        let swapped = overtaken(&[1]);
        #[rustfmt::skip] // a table
        let cases: [(&str, &[Passage], &[u64]); 9] = [
            ("healthy", &[healthy, healthy], &[10, 11]),
            ("loss leaves the last one", &[lost, lost, healthy], &[9, 9, 12]),
            ("a delay shows the past", &[late; 4], &[9, 9, 10, 11]),
            ("a late one gives way to one that was sent later", &[copies(&[1]), healthy, healthy], &[9, 11, 12]),
            ("jitter brings the past back", &[copies(&[3]), healthy, healthy, copies(&[1]), healthy], &[9, 11, 12, 10, 14]),
            ("a second copy brings the past back where nothing newer comes", &[copies(&[0, 2]), healthy, lost, healthy], &[10, 11, 10, 13]),
            ("an overtaken copy brings it back in any case", &[overtaken(&[0, 2]), healthy, healthy, healthy], &[10, 11, 10, 13]),
            ("two change places, twice", &[swapped, healthy, swapped, healthy, healthy], &[9, 10, 10, 12, 14]),
            ("all copies of a message are its own", &[copies(&[1, 1, 0, 2]), lost, lost, lost], &[10, 10, 10, 10]),
        ];
        for (what, passages, expected) in cases {
            assert_eq!(received(passages), expected, "{what}");
        }
    }

    #[test]
    fn a_message_arrives_after_the_longest_delay_but_not_after_a_longer_one() {
        for (late, expected) in [(1000, Some(5)), (1001, None)] {
            let mut arrivals = Arrivals::new();
            arrivals.send(5, &copies(&[late]));
            let mut last = None;
            for step in 6..2100 {
                last = arrivals.receive(step);
                assert!(step >= 1005 || last.is_none());
            }
            assert_eq!(last, expected);
        }
    }

    #[test]
    fn a_message_delayed_by_an_ended_fault_replaces_only_older_ones() {
        // Message 1 would arrive at 4 and message 2 at 6. The fault ends at 3.
        let mut arrivals = Arrivals::new();
        let mut pass = |step, passage: &Passage, ended: bool| {
            if ended {
                arrivals.overrule(step);
            }
            arrivals.send(step, passage);
            arrivals.receive(step)
        };
        assert_eq!(pass(0, &copies(&[0]), false), Some(0));
        assert_eq!(pass(1, &copies(&[3]), false), Some(0));
        assert_eq!(pass(2, &overtaken(&[4]), false), Some(0));
        assert_eq!(pass(3, &copies(&[]), true), Some(0));
        assert_eq!(
            pass(4, &copies(&[]), false),
            Some(1),
            "newer than what it has"
        );
        assert_eq!(pass(5, &copies(&[0]), false), Some(5));
        assert_eq!(
            pass(6, &copies(&[]), false),
            Some(5),
            "older than what it has"
        );
    }

    #[test]
    fn an_age_counts_from_the_step_of_sending() {
        assert_eq!(age_steps(7, Some(7)), 0);
        assert_eq!(age_steps(7, Some(3)), 4);
        assert_eq!(age_steps(0, None), 1);
        assert_eq!(age_steps(1 << 40, None), u32::MAX);
    }
}
