//! Signals over a part of a run, as a page draws them, and figures of the signals between two cursors.
//!
//! Made from a recording, with every step where a page has room for it, or from what the panel of a session has kept.

use serde::Serialize;
use serde_json::{Value, json};
use shared_types::extremes::{larger, smaller};

/// First byte of a message with a reading.
const READING: u64 = 2;
/// Bit behind it that marks a reading of the run that is laid over the other.
const OVER: u64 = 1 << 8;

/// Signals over equal stretches of steps.
#[derive(Debug, PartialEq)]
pub(super) struct Reading {
    /// First step of the first stretch.
    pub first: u64,
    /// Steps of a stretch.
    pub length: u64,
    /// Number of stretches.
    pub count: usize,
    /// Index of each signal, with the least and the greatest value of each stretch; NaN without a value.
    pub signals: Vec<(usize, Vec<[f64; 2]>)>,
}

impl Reading {
    /// Encodes the reading. Stretches of one step have one number.
    pub(super) fn encode(&self, number: u32, is_over: bool) -> Vec<u8> {
        let per_stretch = if self.length == 1 { 1 } else { 2 };
        let words = 5 + self.signals.len() * (1 + per_stretch * self.count);
        let mut bytes = Vec::with_capacity(8 * words);
        let kind = READING | if is_over { OVER } else { 0 } | (u64::from(number) << 32);
        bytes.extend(kind.to_le_bytes());
        let head = [
            self.first,
            self.length,
            self.count as u64,
            self.signals.len() as u64,
        ];
        for number in head {
            bytes.extend((number as f64).to_le_bytes());
        }
        for (index, stretches) in &self.signals {
            bytes.extend((*index as f64).to_le_bytes());
            for range in stretches {
                for value in &range[..per_stretch] {
                    bytes.extend(value.to_le_bytes());
                }
            }
        }
        bytes
    }
}

/// Adds a value to the least and the greatest value; NaN is ignored.
pub(super) fn widen([least, greatest]: &mut [f64; 2], value: f64) {
    if value.is_nan() {
        return;
    }
    *least = if least.is_nan() {
        value
    } else {
        smaller(*least, value)
    };
    *greatest = if greatest.is_nan() {
        value
    } else {
        larger(*greatest, value)
    };
}

/// Value of a signal at a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub(super) enum At {
    /// Value; NaN without one.
    Exact(f64),
    /// Least and greatest value of the steps around it: the value of the step itself is not kept.
    Between([f64; 2]),
}

/// Figures of a signal between two steps, both included.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Figures {
    /// Index of the signal.
    pub signal: usize,
    /// Value at the first and at the last step.
    pub at: [At; 2],
    /// Mean; NaN if it is unknown.
    pub mean: f64,
    /// Root of the mean square; NaN if it is unknown.
    pub rms: f64,
    /// Least value.
    pub least: f64,
    /// Greatest value.
    pub greatest: f64,
    /// Steps with a value.
    pub count: u64,
}

/// Sums of a signal between two steps.
#[derive(Clone, Debug)]
pub(super) struct Sums {
    at: [f64; 2],
    sum: Sum,
    squares: Sum,
    ends: [f64; 2],
    count: u64,
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            at: [f64::NAN; 2],
            sum: Sum::default(),
            squares: Sum::default(),
            ends: [f64::NAN; 2],
            count: 0,
        }
    }
}

impl Sums {
    /// Adds the value of a step; `at` tells whether the step is the first and whether it is the last.
    pub(super) fn take(&mut self, value: f64, at: [bool; 2]) {
        for (end, is_it) in self.at.iter_mut().zip(at) {
            if is_it {
                *end = value;
            }
        }
        if value.is_nan() {
            return;
        }
        widen(&mut self.ends, value);
        self.sum.add(value);
        self.squares.add(value * value);
        self.count += 1;
    }

    /// Returns the figures of the signal with this index.
    pub(super) fn figures(&self, signal: usize) -> Figures {
        let count = self.count as f64; // 0 / 0 is not a number either
        Figures {
            signal,
            at: self.at.map(At::Exact),
            mean: self.sum.value() / count,
            rms: (self.squares.value() / count).sqrt(),
            least: self.ends[0],
            greatest: self.ends[1],
            count: self.count,
        }
    }
}

/// Sum with the error of its rounding (Neumaier 1974).
#[derive(Clone, Debug, Default)]
struct Sum {
    sum: f64,
    error: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.error += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    fn value(&self) -> f64 {
        self.sum + self.error
    }
}

/// Answer about the figures between two steps.
#[derive(Debug)]
pub(super) struct Measured {
    pub from: u64,
    pub to: u64,
    /// Steps of the stretches of which only the least and the greatest values are known; 1 if every step is.
    pub length: u64,
    pub signals: Vec<Figures>,
}

impl Measured {
    pub(super) fn json(&self, number: u32, is_over: bool) -> Value {
        json!({
            "tell": "measured", "number": number, "over": is_over,
            "from": self.from, "to": self.to, "length": self.length, "signals": self.signals,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_the_closed_form() {
        // A sine over whole periods: mean 0, RMS 1/sqrt(2); on an offset that swallows a plain sum's last digits.
        let mut sums = Sums::default();
        let value = |i: u32| 1e6 + libm::sin(f64::from(i) * std::f64::consts::TAU / 1000.0);
        for i in 0..3000 {
            sums.take(value(i), [i == 0, i == 2999]);
        }
        sums.take(f64::NAN, [false; 2]);
        let figures = sums.figures(7);
        assert_eq!((figures.signal, figures.count), (7, 3000));
        assert_eq!(figures.at, [value(0), value(2999)].map(At::Exact));
        assert!((figures.mean - 1e6).abs() < 1e-9, "{figures:?}");
        let rms = (1e12_f64 + 0.5).sqrt();
        assert!((figures.rms - rms).abs() < 1e-9, "{figures:?}");
        assert_eq!(figures.greatest - figures.least, 2.0);
        let none = Sums::default().figures(0);
        assert!(none.mean.is_nan() && none.least.is_nan() && none.count == 0);
    }

    #[test]
    fn a_stretch_of_one_step_is_sent_as_one_number() {
        let mut reading = Reading {
            first: 10,
            length: 1,
            count: 2,
            signals: vec![(3, vec![[1.0; 2], [2.0; 2]])],
        };
        assert_eq!(reading.encode(9, false).len(), 8 * (5 + 1 + 2));
        reading.length = 2;
        let bytes = reading.encode(9, true);
        assert_eq!(bytes.len(), 8 * (5 + 1 + 4));
        assert_eq!(&bytes[..8], [2, 1, 0, 0, 9, 0, 0, 0]);
    }
}
