//! Transfer that keeps a command continuous if parameters jump and no integral absorbs the difference.
//!
//! Used by the laws of this folder at the sample of such a change. A law with an integral re-initialises the integral
//! instead ([`pid`](super::pid)); parameters on a ramp need neither.

use serde::{Deserialize, Serialize};

/// Time within which the difference fades.
pub(super) const TRANSFER_S: f64 = 0.1;

/// Decaying difference between the commands before and after a change.
///
/// `u = u_new + d (1 - j / n)` at the j-th of the n samples of [`TRANSFER_S`] from the change on, with
/// `d = u_old - u_new` at the change itself, where u is u_old to the last bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Transfer {
    difference: f64,
    /// Total number of samples, and the number left.
    samples: u32,
    left: u32,
}

impl Transfer {
    /// Begins at a sample whose command was `old` and would be `new`, provided that both are finite; returns the
    /// command.
    pub(super) fn begin(&mut self, old: f64, new: f64, period_s: f64) -> f64 {
        let difference = old - new;
        if !difference.is_finite() || difference == 0.0 {
            *self = Self::default();
            return new;
        }
        let samples = (TRANSFER_S / period_s)
            .round()
            .clamp(1.0, f64::from(u32::MAX)) as u32;
        *self = Self {
            difference,
            samples,
            left: samples,
        };
        old
    }

    /// Returns the remaining difference at the next sample.
    pub(super) fn next(&mut self) -> f64 {
        if self.left == 0 {
            return 0.0;
        }
        self.left -= 1;
        self.difference * (f64::from(self.left) / f64::from(self.samples))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_fades_in_a_straight_line_within_the_time() {
        let mut transfer = Transfer::default();
        assert_eq!(transfer.next(), 0.0);
        assert_eq!(transfer.begin(3.0, 1.0, 0.025), 3.0);
        let remainders: Vec<f64> = (0..5).map(|_| transfer.next()).collect();
        assert_eq!(remainders, [1.5, 1.0, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn a_nan_starts_no_transfer() {
        let mut transfer = Transfer::default();
        for (old, new) in [(f64::INFINITY, 1.0), (f64::NAN, 1.0), (2.0, 2.0)] {
            assert_eq!(transfer.begin(old, new, 0.01), new);
            assert_eq!(transfer, Transfer::default());
        }
    }

    #[test]
    fn a_slower_law_has_a_transfer_of_one_sample() {
        let mut transfer = Transfer::default();
        assert_eq!(transfer.begin(3.0, 1.0, 5.0), 3.0);
        assert_eq!(transfer.next(), 0.0);
    }
}
