//! Limits of a drive: a limited rate, a dead band, and play in a gear.

use shared_types::describe::{ActsOn, Invalid};
use shared_types::state::StateOf;

use super::{LARGEST, towards};
use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

/// Moves a reading towards a value by the fraction that the profile gives.
fn moved(x: Reading, value: f64, at: &Moment) -> Reading {
    Reading {
        value: towards(x.value, value, at.gain),
        ..x
    }
}

shared_types::table! {
    /// Parameters of [`RateLimit`].
    pub struct RateLimitParameters {
        /// Largest rate r of the value, up and down.
        rate_limit_per_s: "target/s" = 0.0 in 0.0..=LARGEST,
    }
}

/// A limited rate.
pub struct RateLimit {
    /// Largest change in a step.
    step: f64,
    last: Option<f64>,
}

impl FaultKind for RateLimit {
    const NAME: &'static str = "rate-limit";
    const SUMMARY: &'static str = "The value follows with a limited rate.";
    const EQUATION: &'static str =
        "v(k0) = x(k0), v(k) = v(k - 1) + min(max(x - v(k - 1), -r dt), r dt); y = x + (v - x) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = RateLimitParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.last,
            |fault, last| fault.last = last,
        ))
    }

    fn start(setup: &Setup<'_, RateLimitParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            step: setup.parameters.rate_limit_per_s / setup.rate.hz(),
            last: None,
        })
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let last = self.last.unwrap_or(x.value);
        let way = x.value - last;
        let value = if way > self.step {
            last + self.step
        } else if way < -self.step {
            last - self.step
        } else {
            x.value
        };
        self.last = Some(value);
        moved(x, value, at)
    }
}

shared_types::table! {
    /// Parameters of [`DeadBand`].
    pub struct DeadBandParameters {
        /// Half width w of the band.
        dead_band: "target" = 0.0 in 0.0..=LARGEST,
    }
}

/// A band about 0 in which nothing happens.
pub struct DeadBand(f64);

impl FaultKind for DeadBand {
    const NAME: &'static str = "dead-band";
    const SUMMARY: &'static str =
        "Values about 0 become 0, and the others come closer to 0 by the width of the band.";
    const EQUATION: &'static str = "y = x - min(max(x, -w), w) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = DeadBandParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, DeadBandParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters.dead_band))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let w = self.0;
        Reading {
            value: x.value - x.value.clamp(-w, w) * at.gain,
            ..x
        }
    }
}

shared_types::table! {
    /// Parameters of [`Backlash`].
    pub struct BacklashParameters {
        /// Play b, from one side to the other.
        backlash: "target" = 0.0 in 0.0..=LARGEST,
    }
}

/// Play in a gear.
pub struct Backlash {
    half: f64,
    last: Option<f64>,
}

impl FaultKind for Backlash {
    const NAME: &'static str = "backlash";
    const SUMMARY: &'static str =
        "The value is pushed and pulled through a play, inside which it stands still.";
    const EQUATION: &'static str =
        "v(k0) = x(k0), v(k) = min(max(v(k - 1), x - b / 2), x + b / 2); y = x + (v - x) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = BacklashParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.last,
            |fault, last| fault.last = last,
        ))
    }

    fn start(setup: &Setup<'_, BacklashParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            half: setup.parameters.backlash / 2.0,
            last: None,
        })
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let last = self.last.unwrap_or(x.value);
        let value = if last < x.value - self.half {
            x.value - self.half
        } else if last > x.value + self.half {
            x.value + self.half
        } else {
            last
        };
        self.last = Some(value);
        moved(x, value, at)
    }
}
