//! The least and the greatest value of a signal in each bucket of a grid.
//!
//! Both are kept, so a spike of one step is as high in the report as in the record however far away it is
//! seen from. What a bucket of one step shows is the value itself, in single precision.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// A signal over a grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Envelope {
    least: Vec<f32>,
    greatest: Vec<f32>,
}

/// An envelope as the page reads it: a value that does not change, or little-endian single precision.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub(super) enum Written {
    /// It has one value wherever it exists.
    Constant {
        /// The value.
        value: f32,
    },
    /// It is another signal's.
    Same {
        /// That signal's name.
        same: String,
    },
    /// It has these.
    Values {
        /// The least of each bucket.
        least: String,
        /// The greatest; empty where there is one step to a bucket and both are the same.
        greatest: String,
    },
}

impl Envelope {
    /// One without any value.
    pub(super) fn new(buckets: usize) -> Self {
        Self {
            least: vec![f32::NAN; buckets],
            greatest: vec![f32::NAN; buckets],
        }
    }

    /// Takes a value in; one that does not exist changes nothing.
    #[inline]
    pub(super) fn take(&mut self, bucket: usize, value: f64) {
        // What is beyond single precision is shown at its end.
        let value = value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
        // Comparisons that NaN makes true: the first value replaces it, and as a value it replaces none.
        if !(self.least[bucket] <= value) && !value.is_nan() {
            self.least[bucket] = value;
        }
        if !(self.greatest[bucket] >= value) && !value.is_nan() {
            self.greatest[bucket] = value;
        }
    }

    /// Whether there is a value at all.
    pub(super) fn exists(&self) -> bool {
        self.least.iter().any(|value| !value.is_nan())
    }

    /// Its one value, if it exists in every bucket and never changes.
    pub(super) fn constant(&self) -> Option<f32> {
        let first = *self.least.first()?;
        let is_it = |value: &f32| *value == first;
        (self.least.iter().all(is_it) && self.greatest.iter().all(is_it)).then_some(first)
    }

    /// Whether it looks the same as another.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let bits = |values: &[f32]| {
            values
                .iter()
                .map(|value| value.to_bits())
                .collect::<Vec<_>>()
        };
        // Cheap differences first.
        self.least[self.least.len() / 2].to_bits() == other.least[self.least.len() / 2].to_bits()
            && bits(&self.least) == bits(&other.least)
            && bits(&self.greatest) == bits(&other.greatest)
    }

    /// As the page reads it.
    pub(super) fn written(&self) -> Written {
        if let Some(value) = self.constant() {
            return Written::Constant { value };
        }
        let is_thin =
            (self.least.iter().zip(&self.greatest)).all(|(a, b)| a.to_bits() == b.to_bits());
        Written::Values {
            least: text_of(&self.least),
            greatest: if is_thin {
                String::new()
            } else {
                text_of(&self.greatest)
            },
        }
    }
}

fn text_of(values: &[f32]) -> String {
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_of_one_step_is_kept_at_its_full_height() {
        let mut envelope = Envelope::new(3);
        for step in 0..300_u32 {
            let value = if step == 123 {
                -7.5
            } else {
                f64::from(step % 2)
            };
            envelope.take((step / 100) as usize, value);
        }
        assert_eq!(envelope.least, [0.0, -7.5, 0.0]);
        assert_eq!(envelope.greatest, [1.0, 1.0, 1.0]);
    }

    #[test]
    fn what_does_not_exist_leaves_a_gap() {
        let mut envelope = Envelope::new(2);
        envelope.take(1, f64::NAN);
        assert!(!envelope.exists());
        envelope.take(1, 2.0);
        envelope.take(1, f64::NAN);
        assert!(envelope.exists() && envelope.least[0].is_nan());
        assert_eq!((envelope.least[1], envelope.greatest[1]), (2.0, 2.0));
        assert_eq!(envelope.constant(), None);
    }

    #[test]
    fn numbers_beyond_single_precision_stay_finite() {
        let mut envelope = Envelope::new(1);
        envelope.take(0, 1e300);
        envelope.take(0, f64::NEG_INFINITY);
        assert_eq!(
            (envelope.least[0], envelope.greatest[0]),
            (f32::MIN, f32::MAX)
        );
    }

    #[test]
    fn one_value_is_written_once_and_others_as_little_endian_numbers() {
        let mut envelope = Envelope::new(2);
        envelope.take(0, 1.0);
        envelope.take(1, 1.0);
        assert_eq!(envelope.written(), Written::Constant { value: 1.0 });
        envelope.take(1, 2.0);
        // 1.0 is 00 00 80 3f and 2.0 is 00 00 00 40.
        let expected = Written::Values {
            least: "AACAPwAAgD8=".into(),
            greatest: "AACAPwAAAEA=".into(),
        };
        assert_eq!(envelope.written(), expected);
    }
}
