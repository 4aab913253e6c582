//! Oscillatory failures of a channel: a spurious sine on the signal (additive, also called liquid)
//! or in its place (replacing, also called solid).

use std::f64::consts::TAU;

use shared_types::describe::{ActsOn, Invalid};
use shared_types::state::StateOf;

use super::{LARGEST, towards};
use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

/// Computes `sin(2 pi f t + p)`.
///
/// Whole turns are removed before the multiplication by 2 pi, which would otherwise round the angle of a long run ever
/// more coarsely.
fn sine(frequency_hz: f64, phase_rad: f64, since_s: f64) -> f64 {
    let turns = frequency_hz * since_s;
    libm::sin(TAU * (turns - turns.floor()) + phase_rad)
}

shared_types::table! {
    /// Parameters of [`Additive`].
    pub struct AdditiveParameters {
        /// Amplitude A.
        amplitude: "target" = 0.0 in (-LARGEST)..=LARGEST,
        /// Frequency f.
        frequency_hz: "Hz" = 1.0 in 1e-6..=1e6,
        /// Phase p when the fault takes effect.
        phase_rad: "rad" = 0.0 in (-1e3)..=1e3,
    }
}

/// Sine added to the signal.
pub struct Additive(AdditiveParameters);

impl FaultKind for Additive {
    const NAME: &'static str = "oscillation-additive";
    const SUMMARY: &'static str = "A spurious sine is added: a liquid oscillatory failure.";
    const EQUATION: &'static str = "y = x + A g sin(2 pi f t + p)";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = AdditiveParameters;
    const OPTIONAL: &'static [&'static str] = &["phase_rad"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, AdditiveParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let p = &self.0;
        let sine = sine(p.frequency_hz, p.phase_rad, at.since_s);
        Reading {
            value: x.value + p.amplitude * at.gain * sine,
            ..x
        }
    }
}

shared_types::table! {
    /// Parameters of [`Replacing`].
    pub struct ReplacingParameters {
        /// Amplitude A.
        amplitude: "target" = 0.0 in (-LARGEST)..=LARGEST,
        /// Frequency f.
        frequency_hz: "Hz" = 1.0 in 1e-6..=1e6,
        /// Phase p when the fault takes effect.
        phase_rad: "rad" = 0.0 in (-1e3)..=1e3,
        /// Mean c.
        offset: "target" = 0.0 in (-LARGEST)..=LARGEST,
    }
}

/// Sine in place of the signal.
pub struct Replacing(ReplacingParameters);

impl FaultKind for Replacing {
    const NAME: &'static str = "oscillation-replacing";
    const SUMMARY: &'static str =
        "A spurious sine takes the signal's place: a solid oscillatory failure.";
    const EQUATION: &'static str = "y = x + (c + A sin(2 pi f t + p) - x) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = ReplacingParameters;
    const OPTIONAL: &'static [&'static str] = &["phase_rad", "offset"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, ReplacingParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let p = &self.0;
        let sine = sine(p.frequency_hz, p.phase_rad, at.since_s);
        let spurious = p.offset + p.amplitude * sine;
        Reading {
            value: towards(x.value, spurious, at.gain),
            ..x
        }
    }
}
