//! Faults that distort a number: coarse converters and hard limits.

use shared_types::describe::{ActsOn, Invalid};
use shared_types::number::exact;
use shared_types::state::StateOf;

use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

shared_types::table! {
    /// Parameters of [`Quantisation`].
    pub struct QuantisationParameters {
        /// Step q between two distinguishable values.
        step: "target" = 1.0 in 1e-30..=1e30,
    }
}

/// A coarse converter.
pub struct Quantisation(QuantisationParameters);

impl FaultKind for Quantisation {
    const NAME: &'static str = "quantisation";
    const SUMMARY: &'static str =
        "The value is rounded to multiples of a step, halves away from 0.";
    const EQUATION: &'static str = "y = q round(x / q) where g is not 0, else y = x";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = QuantisationParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, QuantisationParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        if at.gain == 0.0 {
            return x;
        }
        let q = self.0.step;
        Reading {
            value: q * libm::round(x.value / q),
            ..x
        }
    }
}

shared_types::table! {
    /// Parameters of [`Saturation`].
    pub struct SaturationParameters {
        /// Lower limit of the value.
        min: "target",
        /// Upper limit of the value.
        max: "target",
    }
}

/// A hard limit.
pub struct Saturation(SaturationParameters);

impl FaultKind for Saturation {
    const NAME: &'static str = "saturation";
    const SUMMARY: &'static str = "The value is limited to a range.";
    const EQUATION: &'static str = "y = min(max(x, min), max) where g is not 0, else y = x";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = SaturationParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, SaturationParameters>) -> Result<Self, Invalid> {
        let SaturationParameters { min, max } = setup.parameters;
        if min > max {
            return Err(Invalid(format!(
                "`min` {} is above `max` {}",
                exact(min),
                exact(max)
            )));
        }
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let SaturationParameters { min, max } = self.0;
        let value = if at.gain == 0.0 {
            x.value
        } else if x.value < min {
            min
        } else if x.value > max {
            max
        } else {
            x.value
        };
        Reading { value, ..x }
    }
}
