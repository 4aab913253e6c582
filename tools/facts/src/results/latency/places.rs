//! Words of a recording's records that contain the timing of steps.

use shared_types::record::Timing;
use shared_types::zerocopy::{FromBytes, IntoBytes};

use hil_recording::reader::RunReader;

/// Indices of the timing words in a recording's records.
pub struct TimingPlaces([Option<usize>; Timing::WORDS]);

impl TimingPlaces {
    /// Finds the words by name: an older recording has fewer words, and missing ones read as 0.
    pub fn of(reader: &RunReader) -> Self {
        Self(Timing::NAMES.map(|name| reader.place(name)))
    }

    /// Returns `true` if records state which controller's command they have, and the command's age.
    pub(crate) fn tell_answers(&self) -> bool {
        let is_there = |name| {
            let place = Timing::NAMES.iter().position(|word| *word == name);
            place.is_some_and(|place| self.0[place].is_some())
        };
        is_there("epoch") && is_there("held_steps")
    }

    /// Returns the timing in a record.
    pub fn timing(&self, record: &[u64]) -> Timing {
        // A loop: `map` of an array as long as this calls a function for each word.
        let mut words = [0; Timing::WORDS];
        for (word, place) in words.iter_mut().zip(&self.0) {
            *word = place.map_or(0, |place| record[place]);
        }
        Timing::read_from_bytes(words.as_bytes()).expect("as many words as names")
    }
}
