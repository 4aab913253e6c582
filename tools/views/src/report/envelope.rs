//! Minimum, maximum, sum and sum of squares of a signal in each bucket of a grid.
//!
//! The first two are drawn, so that a one-step spike has its full height in the report at any zoom level; from the sums
//! follow mean and RMS between two buckets. A bucket of one step shows the value itself, in single precision where that
//! is enough.

use std::ops::Range;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use shared_types::extremes::larger;

/// Half the range of single precision: larger magnitudes, and those below its inverse, are written in double
/// precision.
const SINGLE: f64 = 1e37;
/// Relative difference of values below which double precision is also used.
const FINE: f64 = 1e-4;

/// Number that stands for the whole height of a bucket in its written mean and deviation; larger ones stand for none.
const PARTS: u16 = u16::MAX - 1;

/// Envelope of a signal over a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    least: Vec<f64>,
    greatest: Vec<f64>,
    sums: Vec<Sums>,
}

/// Sums over the values in a bucket.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    values: f64,
    squares: f64,
    count: u32,
}

/// Envelope in the encoding of the page.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub(crate) enum Written {
    /// Same value wherever the signal exists.
    Constant {
        /// Value.
        value: f64,
    },
    /// Envelope equal to that of another signal.
    Same {
        /// Name of the other signal.
        same: String,
    },
    /// Values, little-endian.
    Values {
        /// `true` for double precision, `false` for single.
        is_double: bool,
        /// Minimum of each bucket.
        least: String,
        /// Maximum of each bucket of several values; empty if minimum and maximum are equal in all buckets.
        greatest: String,
        /// For each bucket with different values, where the mean is between minimum and maximum, and the standard
        /// deviation as a part of half their distance: two integers of 16 bits with [`PARTS`] for 1.
        #[serde(skip_serializing_if = "String::is_empty")]
        sums: String,
    },
}

impl Envelope {
    /// Creates an envelope without values.
    pub(crate) fn new(buckets: usize) -> Self {
        Self {
            least: vec![f64::NAN; buckets],
            greatest: vec![f64::NAN; buckets],
            sums: vec![Sums::default(); buckets],
        }
    }

    /// Returns the number of values in each bucket.
    pub(super) fn counts(&self) -> impl Iterator<Item = u32> {
        self.sums.iter().map(|sums| sums.count)
    }

    /// Takes over some buckets of another envelope.
    pub(super) fn insert(&mut self, other: &Self, buckets: Range<usize>) {
        self.least[buckets.clone()].copy_from_slice(&other.least[buckets.clone()]);
        self.greatest[buckets.clone()].copy_from_slice(&other.greatest[buckets.clone()]);
        self.sums[buckets.clone()].copy_from_slice(&other.sums[buckets]);
    }

    /// Returns the minimum and maximum of a bucket, NaN without a value; `None` beyond the last bucket.
    pub(crate) fn range(&self, bucket: usize) -> Option<[f64; 2]> {
        self.least
            .get(bucket)
            .copied()
            .zip(self.greatest.get(bucket).copied())
            .map(Into::into)
    }

    /// Returns the minimum and maximum of a bucket, if it has values.
    pub(crate) fn ends(&self, bucket: usize) -> impl Iterator<Item = f64> {
        let ends = [self.least[bucket], self.greatest[bucket]];
        ends.into_iter().filter(|value| !value.is_nan())
    }

    /// Returns `true` if there is any value.
    pub(crate) fn exists(&self) -> bool {
        self.least.iter().any(|value| !value.is_nan())
    }

    /// Returns the largest finite magnitude; 0 if there is none.
    pub(super) fn largest(&self) -> f64 {
        let values = self.least.iter().chain(&self.greatest);
        let sizes = values.map(|value| value.abs());
        sizes.filter(|size| size.is_finite()).fold(0.0, larger)
    }

    /// Returns the value if every bucket has the same value.
    pub(crate) fn constant(&self) -> Option<f64> {
        let first = *self.least.first()?;
        let is_it = |value: &f64| *value == first;
        (first.is_finite() && self.least.iter().all(is_it) && self.greatest.iter().all(is_it))
            .then_some(first)
    }

    /// Returns `true` if the other envelope looks the same.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let are_same = |a: &[f64], b: &[f64]| {
            let bits = a.iter().zip(b).map(|(a, b)| (a.to_bits(), b.to_bits()));
            a.len() == b.len() && bits.into_iter().all(|(a, b)| a == b)
        };
        are_same(&self.least, &other.least)
            && are_same(&self.greatest, &other.greatest)
            && self.sums == other.sums
    }

    /// Returns `true` if single precision would distort the values.
    fn is_double(&self) -> bool {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in self
            .least
            .iter()
            .chain(&self.greatest)
            .filter(|value| !value.is_nan())
        {
            let size = value.abs();
            if size > SINGLE || (size > 0.0 && size < 1.0 / SINGLE) {
                return true;
            }
            low = if *value < low { *value } else { low };
            high = if *value > high { *value } else { high };
        }
        let size = if high.abs() > low.abs() {
            high.abs()
        } else {
            low.abs()
        };
        high - low < FINE * size
    }

    /// Returns the encoding for the page.
    pub(crate) fn written(&self) -> Written {
        if let Some(value) = self.constant() {
            return Written::Constant { value };
        }
        let is_double = self.is_double();
        let is_thin =
            (self.least.iter().zip(&self.greatest)).all(|(a, b)| a.to_bits() == b.to_bits());
        let wide: Vec<f64> = (self.greatest.iter().zip(self.counts()))
            .filter(|(_, count)| *count > 1 && !is_thin)
            .map(|(greatest, _)| *greatest)
            .collect();
        Written::Values {
            is_double,
            least: text_of(&self.least, is_double),
            greatest: text_of(&wide, is_double),
            sums: STANDARD.encode(self.moments(is_double)),
        }
    }

    /// Returns mean and standard deviation of the buckets with different values, as parts of their height. Both are
    /// those of the written ends.
    fn moments(&self, is_double: bool) -> Vec<u8> {
        let written = |value: &f64| match is_double {
            true => *value,
            false => f64::from(*value as f32),
        };
        let part = |part: f64| match part.is_finite() {
            true => (part.clamp(0.0, 1.0) * f64::from(PARTS)).round() as u16,
            false => u16::MAX,
        };
        let ends = (self.least.iter().map(written)).zip(self.greatest.iter().map(written));
        let differ = (ends.zip(&self.sums)).filter(|((least, greatest), _)| greatest > least);
        let moments = differ.flat_map(|((least, greatest), sums)| {
            let height = greatest - least;
            let mean = sums.values / f64::from(sums.count);
            let variance = sums.squares / f64::from(sums.count) - mean * mean;
            // Rounding may leave less than nothing; NaN remains.
            let deviation = if variance < 0.0 { 0.0 } else { variance.sqrt() };
            [
                part((mean - least) / height),
                part(2.0 * deviation / height),
            ]
        });
        moments.flat_map(u16::to_le_bytes).collect()
    }
}

/// Values of several signals in one bucket, side by side because a record touches all of them.
pub(super) struct Bucket {
    least: Vec<f64>,
    greatest: Vec<f64>,
    values: Vec<f64>,
    squares: Vec<f64>,
    /// As wide as the values, so that the compiler handles several signals at once.
    counts: Vec<u64>,
}

impl Bucket {
    /// Creates a bucket without values.
    pub(super) fn new(signals: usize) -> Self {
        Self {
            least: vec![f64::INFINITY; signals],
            greatest: vec![f64::NEG_INFINITY; signals],
            values: vec![0.0; signals],
            squares: vec![0.0; signals],
            counts: vec![0; signals],
        }
    }

    /// Adds a value of each signal; NaN is ignored.
    pub(super) fn take(&mut self, values: &[f64]) {
        let ends = self.least.iter_mut().zip(&mut self.greatest);
        let sums = self.values.iter_mut().zip(&mut self.squares);
        let own = ends.zip(sums).zip(&mut self.counts);
        for ((((least, greatest), (sum, squares)), count), &value) in own.zip(values) {
            // A comparison with NaN is false.
            *least = if value < *least { value } else { *least };
            *greatest = if value > *greatest { value } else { *greatest };
            *count += u64::from(!value.is_nan());
            // A sum of positive zero and other numbers is never negative zero, so zero changes nothing.
            let value = if value.is_nan() { 0.0 } else { value };
            *sum += value;
            *squares += value * value;
        }
    }

    /// Moves the values into a bucket of the signals' envelopes, which has none.
    pub(super) fn close(&mut self, envelopes: &mut [Envelope], bucket: usize) {
        for (signal, envelope) in envelopes.iter_mut().enumerate() {
            if self.counts[signal] > 0 {
                envelope.least[bucket] = self.least[signal];
                envelope.greatest[bucket] = self.greatest[signal];
                envelope.sums[bucket] = Sums {
                    values: self.values[signal],
                    squares: self.squares[signal],
                    count: self.counts[signal] as u32,
                };
            }
        }
        *self = Self::new(envelopes.len());
    }
}

/// Writes numbers with many equal neighbours: each number and how often it follows.
pub(super) fn runs_of(numbers: impl Iterator<Item = u32>) -> Vec<[u32; 2]> {
    let mut runs: Vec<[u32; 2]> = Vec::new();
    for number in numbers {
        match runs.last_mut() {
            Some([last, times]) if *last == number => *times += 1,
            _ => runs.push([number, 1]),
        }
    }
    runs
}

fn text_of(values: &[f64], is_double: bool) -> String {
    let bytes: Vec<u8> = match is_double {
        true => values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect(),
        false => values
            .iter()
            .flat_map(|value| (*value as f32).to_le_bytes())
            .collect(),
    };
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates an envelope of buckets with these values.
    fn of(buckets: &[&[f64]]) -> Envelope {
        let mut envelopes = [Envelope::new(buckets.len())];
        let mut open = Bucket::new(1);
        for (number, values) in buckets.iter().enumerate() {
            values.iter().for_each(|value| open.take(&[*value]));
            open.close(&mut envelopes, number);
        }
        let [envelope] = envelopes;
        envelope
    }

    #[test]
    fn a_spike_of_one_step_is_kept_at_its_full_height() {
        let mut values: Vec<f64> = (0..300_u32).map(|step| f64::from(step % 2)).collect();
        values[123] = -7.5;
        let envelope = of(&values.chunks(100).collect::<Vec<_>>());
        assert_eq!(envelope.least, [0.0, -7.5, 0.0]);
        assert_eq!(envelope.greatest, [1.0, 1.0, 1.0]);
    }

    #[test]
    fn missing_values_leave_a_gap() {
        assert!(!of(&[&[], &[f64::NAN]]).exists());
        let envelope = of(&[&[], &[f64::NAN, 2.0, f64::NAN]]);
        assert!(envelope.exists() && envelope.least[0].is_nan());
        assert_eq!((envelope.least[1], envelope.greatest[1]), (2.0, 2.0));
        assert_eq!(envelope.constant(), None);
    }

    #[test]
    fn values_that_need_double_precision_are_written_in_double() {
        for (values, expected) in [
            ([1.0, 2.0], false),
            ([-1.0, 0.0], false),
            ([0.0, 1e300], true),
            ([0.0, f64::INFINITY], true),
            ([0.0, 1e-300], true),
            ([1e6, 1e6 + 1e-6], true),
        ] {
            let envelope = of(&[&values[..1], &values[1..]]);
            let Written::Values {
                is_double,
                least,
                greatest,
                sums,
            } = envelope.written()
            else {
                panic!("{values:?}");
            };
            let texts = [greatest.as_str(), sums.as_str()];
            assert_eq!((is_double, texts), (expected, ["", ""]), "{values:?}");
            let bytes = STANDARD.decode(least).expect("base 64");
            if expected {
                let second: [u8; 8] = bytes[8..].try_into().expect("two numbers");
                assert_eq!(f64::from_le_bytes(second), values[1]);
            }
        }
    }

    #[test]
    fn mean_and_deviation_are_written_for_buckets_whose_written_ends_differ() {
        // The third is one that single precision does not tell apart.
        let envelope = of(&[
            &[0.0, 1.0, 1.0, 2.0],
            &[5.0],
            &[1.0, 1.0 + 1e-12],
            &[-1.0, 3.0],
        ]);
        let Written::Values { sums, .. } = envelope.written() else {
            panic!("values");
        };
        let bytes = STANDARD.decode(sums).expect("base 64");
        let parts: Vec<u16> = (bytes.as_chunks().0.iter())
            .map(|bytes| u16::from_le_bytes(*bytes))
            .collect();
        // Mean 1 of 0 to 2 with deviation sqrt(1/2) of 1; mean 1 of -1 to 3 with deviation 2 of 2.
        assert_eq!(parts, [32_767, 46_340, 32_767, 65_534]);
        assert_eq!(runs_of(envelope.counts()), [[4, 1], [1, 1], [2, 2]]);
    }

    #[test]
    fn a_constant_is_written_once_and_other_values_in_little_endian() {
        let constant = of(&[&[1.0], &[1.0]]).written();
        assert_eq!(constant, Written::Constant { value: 1.0 });
        let envelope = of(&[&[1.0], &[1.0, 2.0]]);
        // 1.0 is 00 00 80 3f and 2.0 is 00 00 00 40; the mean is at 32767 of 65534 and the deviation is all of it.
        let expected = Written::Values {
            is_double: false,
            least: "AACAPwAAgD8=".into(),
            greatest: "AAAAQA==".into(),
            sums: "/3/+/w==".into(),
        };
        assert_eq!(envelope.written(), expected);
    }
}
