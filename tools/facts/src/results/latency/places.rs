//! The words of a recording's records that tell how long steps took.

use shared_types::record::Timing;
use shared_types::zerocopy::{FromBytes, IntoBytes};

use hil_recording::reader::RunReader;

/// Places of the words in a recording's records that say how long steps took.
pub struct TimingPlaces([Option<usize>; Timing::WORDS]);

impl TimingPlaces {
    /// By name: an older recording has fewer words, which are then 0.
    pub fn of(reader: &RunReader) -> Self {
        Self(Timing::NAMES.map(|name| reader.place(name)))
    }

    /// Checks that records say whose command they have, and how old the command is.
    pub(crate) fn tell_answers(&self) -> bool {
        let is_there = |name| {
            let place = Timing::NAMES.iter().position(|known| *known == name);
            place.is_some_and(|place| self.0[place].is_some())
        };
        is_there("epoch") && is_there("held_steps")
    }

    /// Returns the timing that a record holds.
    pub fn timing(&self, record: &[u64]) -> Timing {
        let word = |place: Option<usize>| place.map_or(0, |place| record[place]);
        let words = self.0.map(word);
        Timing::read_from_bytes(words.as_bytes()).expect("as many words as names")
    }
}
