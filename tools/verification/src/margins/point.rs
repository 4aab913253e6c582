//! Measured response of an open loop at one frequency.

use super::extremes::larger;
use super::probe::{Complex, WINDOWS};

/// Measured response at one frequency.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) frequency_hz: f64,
    pub(super) l: Complex,
    /// Response in each window.
    pub(super) windows: [Complex; WINDOWS],
    /// Response at half the amplitude.
    pub(super) half: Complex,
    /// Amplitude of the response at the probe's output.
    pub(super) amplitude: f64,
    pub(super) coherence: f64,
    /// Amplitude of the loop's own motion, as a share of the response.
    pub(super) own: f64,
}

impl Point {
    /// Returns the largest relative change of L from one window to another.
    pub(super) fn unsteadiness(&self) -> f64 {
        let all = self.windows.iter().map(|window| change(*window, self.l));
        all.fold(0.0, larger)
    }

    /// Returns the relative change of L at half the amplitude.
    pub(super) fn nonlinearity(&self) -> f64 {
        change(self.half, self.l)
    }
}

/// Returns the absolute value.
pub(super) fn size((re, im): Complex) -> f64 {
    libm::hypot(re, im)
}

/// Returns the relative difference of two responses.
pub(super) fn change(a: Complex, b: Complex) -> f64 {
    size((a.0 - b.0, a.1 - b.1)) / size(b)
}
