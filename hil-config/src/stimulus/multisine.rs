//! Sum of sines, with the phases that keep its peaks low.

use serde::{Deserialize, Serialize};

use super::sine;
use super::taylor::Taylor;

/// `offset + sum of a_k sin(2 pi f_k t + phase_k)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Multisine {
    /// f in Hz.
    pub frequencies_hz: Vec<f64>,
    /// a, as many as frequencies.
    pub amplitudes: Vec<f64>,
    /// Phases in rad, as many as frequencies.
    pub phases_rad: Vec<f64>,
    /// Offset.
    pub offset: f64,
}

impl Multisine {
    pub(super) fn at(&self, time_s: f64) -> Taylor {
        let tones = self.frequencies_hz.iter().zip(&self.amplitudes);
        let tones = tones.zip(&self.phases_rad);
        let constant = Taylor::time(0.0) * 0.0 + self.offset;
        tones.fold(constant, |sum, ((frequency_hz, amplitude), phase_rad)| {
            sum + sine(Taylor::time(time_s) * *frequency_hz, *phase_rad, *amplitude)
        })
    }
}

/// Computes Schroeder's phases for tones of these amplitudes, in rad from -pi to pi.
///
/// `phase_n = -2 pi sum of (n - l) p_l over l < n` with the share `p_l` of tone l in the power; for equal amplitudes
/// `-pi n (n - 1) / N` (M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with low
/// autocorrelation, IEEE Transactions on Information Theory 16, 1970, equation 11).
pub(crate) fn schroeder(amplitudes: &[f64]) -> Vec<f64> {
    let power: f64 = amplitudes.iter().map(|a| a * a).sum();
    let (mut turns, mut share) = (0.0, 0.0);
    let phase = |amplitude: &f64| {
        turns -= share;
        turns -= f64::round(turns);
        share += if power > 0.0 {
            amplitude * amplitude / power
        } else {
            0.0
        };
        turns * std::f64::consts::TAU
    };
    amplitudes.iter().map(phase).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;

    #[test]
    fn a_sum_of_sines_has_the_sum_of_their_values_and_derivatives() {
        let multisine = Multisine {
            frequencies_hz: vec![1.0, 3.0],
            amplitudes: vec![2.0, 0.5],
            phases_rad: vec![0.0, PI / 2.0],
            offset: 1.0,
        };
        for time_s in [0.0, 0.1, 0.37, 12.25] {
            let (w1, w3) = (TAU, 3.0 * TAU);
            let (s1, c1) = libm::sincos(w1 * time_s);
            let (s3, c3) = libm::sincos(w3 * time_s + PI / 2.0);
            let expected = [
                1.0 + 2.0 * s1 + 0.5 * s3,
                2.0 * w1 * c1 + 0.5 * w3 * c3,
                -2.0 * w1 * w1 * s1 - 0.5 * w3 * w3 * s3,
            ];
            let row = multisine.at(time_s).derivatives();
            for (order, (value, expected)) in row.iter().zip(expected).enumerate() {
                let scale = libm::pow(w3, order as f64);
                assert!(
                    (value - expected).abs() <= 1e-11 * scale,
                    "{time_s} {order}"
                );
            }
        }
    }

    #[test]
    fn schroeders_phases_are_those_of_the_closed_form_and_keep_the_crest_low() {
        let count = 31_u32;
        let phases_rad = schroeder(&vec![1.0; count as usize]);
        for (n, phase) in (1..=count).zip(&phases_rad) {
            let expected = -PI * f64::from(n) * f64::from(n - 1) / f64::from(count);
            let difference = (phase - expected) / TAU;
            assert!((difference - difference.round()).abs() < 1e-12, "tone {n}");
        }
        let multisine = |phases_rad: Vec<f64>| Multisine {
            frequencies_hz: (1..=count).map(f64::from).collect(),
            amplitudes: vec![1.0; count as usize],
            phases_rad,
            offset: 0.0,
        };
        let peak = |multisine: &Multisine| {
            let values = (0..10_000_u32).map(|k| multisine.at(f64::from(k) / 1e4).value());
            values.fold(0.0, |peak: f64, value| {
                if value.abs() > peak {
                    value.abs()
                } else {
                    peak
                }
            })
        };
        let rms = f64::sqrt(f64::from(count) / 2.0);
        // By a program in Python with the closed form: with all phases 0 the crest is 5.80.
        let crest = peak(&multisine(phases_rad)) / rms;
        assert!((crest - 1.913715704459411).abs() < 1e-9, "{crest}");
        // Cosines in phase add up at t = 0.
        let aligned = multisine(vec![PI / 2.0; count as usize]);
        assert!((peak(&aligned) - f64::from(count)).abs() < 1e-9);
    }
}
