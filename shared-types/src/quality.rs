//! Set of invalid signals, one bit per signal, and the quality of a sample that follows from it.
//!
//! A plant marks readings, a law marks commands that it did not refresh; both in the order of their tables. The words
//! are those of a frame's [header](crate::frame::Header). A [`Quality`] is the view of a sample that a law gets.

use serde::{Deserialize, Serialize};

use crate::frame::{MAX_SIGNALS, VALIDITY_WORDS};
use crate::table::{Field, Table};

/// Set of signals of one row, by index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SignalSet {
    words: [u64; VALIDITY_WORDS],
}

impl SignalSet {
    /// The empty set.
    pub const EMPTY: Self = Self {
        words: [0; VALIDITY_WORDS],
    };

    /// Returns `true` if the set is not empty.
    #[must_use]
    #[inline]
    pub const fn any(&self) -> bool {
        let mut all = 0;
        let mut word = 0;
        while word < VALIDITY_WORDS {
            all |= self.words[word];
            word += 1;
        }
        all != 0
    }

    /// Returns `true` if the set contains the signal at an index.
    ///
    /// # Panics
    /// If no frame has room for such a signal.
    #[must_use]
    #[inline]
    pub const fn contains(&self, index: usize) -> bool {
        self.words[index / 64] >> (index % 64) & 1 == 1
    }

    /// Adds the signal at an index.
    ///
    /// # Panics
    /// If no frame has room for such a signal.
    #[inline]
    pub const fn insert(&mut self, index: usize) {
        self.words[index / 64] |= 1 << (index % 64);
    }

    /// Removes the signal at an index.
    ///
    /// # Panics
    /// If no frame has room for such a signal.
    #[inline]
    pub const fn remove(&mut self, index: usize) {
        self.words[index / 64] &= !(1 << (index % 64));
    }

    /// Removes all signals.
    #[inline]
    pub const fn clear(&mut self) {
        *self = Self::EMPTY;
    }

    /// Adds a signal of a table, as in `invalid.insert_in(|measured: &Measured| measured.angle_rad)`.
    pub fn insert_in<T: Table>(&mut self, signal: impl FnOnce(&T) -> f64) {
        self.insert(index_of(signal));
    }

    /// Lists the indices of the set among the first `count`.
    pub fn iter(&self, count: usize) -> impl Iterator<Item = usize> + '_ {
        (0..count.min(MAX_SIGNALS)).filter(|index| self.contains(*index))
    }

    /// Returns the words of a header's invalid bits.
    #[must_use]
    #[inline]
    pub const fn words(&self) -> &[u64; VALIDITY_WORDS] {
        &self.words
    }

    /// Returns the words for changing them.
    #[inline]
    pub const fn words_mut(&mut self) -> &mut [u64; VALIDITY_WORDS] {
        &mut self.words
    }
}

impl From<[u64; VALIDITY_WORDS]> for SignalSet {
    fn from(words: [u64; VALIDITY_WORDS]) -> Self {
        Self { words }
    }
}

/// Quality of the signals of a sample, each in the order of the law's tables.
#[derive(Clone, Copy, Debug)]
pub struct Quality<'a> {
    /// Invalid measured signals.
    pub measured: &'a SignalSet,
    /// Invalid reference signals.
    pub reference: &'a SignalSet,
    /// Age of each measured signal in steps, at least 1 for an invalid one.
    pub age_steps: &'a [u32],
}

impl Quality<'_> {
    /// Returns `true` if a measured signal is valid, as in `quality.is_valid(|measured: &Measured| measured.angle_rad)`.
    #[must_use]
    pub fn is_valid<T: Table>(&self, signal: impl FnOnce(&T) -> f64) -> bool {
        !self.measured.contains(index_of(signal))
    }

    /// Returns the age of a measured signal in steps, named as in [`is_valid`](Self::is_valid).
    ///
    /// # Panics
    /// If the law's table is another one.
    #[must_use]
    pub fn age_steps_of<T: Table>(&self, signal: impl FnOnce(&T) -> f64) -> u32 {
        self.age_steps[index_of(signal)]
    }
}

/// Returns the index of a column: the closure gets a row in which each column holds its own index.
fn index_of<T: Table>(signal: impl FnOnce(&T) -> f64) -> usize {
    let mut indices = T::new_zeroed();
    for (index, value) in indices.row_mut().iter_mut().enumerate() {
        *value = index as f64;
    }
    signal(&indices) as usize
}

/// Unit of an age.
const STEPS: &str = "steps";

/// Returns the index of the measured signal that is the age of another: `<name>_age_steps`, in steps.
#[must_use]
pub fn age_signal<'a>(fields: impl IntoIterator<Item = &'a Field>, name: &str) -> Option<usize> {
    let is_age =
        |field: &Field| field.unit == STEPS && field.name.strip_suffix("_age_steps") == Some(name);
    fields.into_iter().position(is_age)
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::table! {
        /// Readings.
        struct Readings {
            /// Angle.
            angle_rad: "rad",
            /// Rate.
            rate_radps: "rad/s",
        }
    }

    #[test]
    fn signals_are_added_and_removed_by_index_and_by_column() {
        let mut signals = SignalSet::default();
        assert!(!signals.any());
        for index in [0, 63, 64, 511] {
            signals.insert(index);
        }
        assert_eq!(signals.iter(600).collect::<Vec<_>>(), [0, 63, 64, 511]);
        assert_eq!(signals.words()[..2], [1 | 1 << 63, 1]);
        signals.remove(63);
        assert!(signals.any() && !signals.contains(63) && signals.contains(64));
        signals.clear();
        signals.insert_in(|readings: &Readings| readings.rate_radps);
        assert_eq!(signals.iter(2).collect::<Vec<_>>(), [1]);
    }

    #[test]
    fn quality_is_read_by_column() {
        let mut measured = SignalSet::default();
        measured.insert(1);
        let quality = Quality {
            measured: &measured,
            reference: &SignalSet::default(),
            age_steps: &[0, 7],
        };
        assert!(quality.is_valid(|readings: &Readings| readings.angle_rad));
        assert!(!quality.is_valid(|readings: &Readings| readings.rate_radps));
        assert_eq!(
            quality.age_steps_of(|readings: &Readings| readings.rate_radps),
            7
        );
    }

    #[test]
    fn an_age_is_named_after_its_signal_and_counts_steps() {
        let fields = [
            Field::signal("angle_rad", "rad", "x"),
            Field::signal("angle_rad_age_steps", "s", "x"),
            Field::signal("rate_radps_age_steps", "steps", "x"),
        ];
        assert_eq!(age_signal(&fields, "rate_radps"), Some(2));
        assert_eq!(age_signal(&fields, "angle_rad"), None, "not in steps");
    }
}
