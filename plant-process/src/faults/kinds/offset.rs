//! Faults that add to a number or scale it.

use shared_types::describe::{ActsOn, Invalid};
use shared_types::random::RandomStream;
use shared_types::state::StateOf;

use super::LARGEST;
use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

/// Replaces the value of a reading.
fn with(reading: Reading, value: f64) -> Reading {
    Reading { value, ..reading }
}

shared_types::table! {
    /// Parameters of [`Bias`].
    pub struct BiasParameters {
        /// Addend b.
        bias: "target" = 0.0 in (-LARGEST)..=LARGEST,
    }
}

/// A constant error.
pub struct Bias(BiasParameters);

impl FaultKind for Bias {
    const NAME: &'static str = "bias";
    const SUMMARY: &'static str = "A constant error is added.";
    const EQUATION: &'static str = "y = x + b g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = BiasParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, BiasParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        with(x, x.value + self.0.bias * at.gain)
    }
}

shared_types::table! {
    /// Parameters of [`Scale`].
    pub struct ScaleParameters {
        /// Factor f.
        factor: "1" = 1.0 in (-LARGEST)..=LARGEST,
    }
}

/// A wrong gain.
pub struct Scale(ScaleParameters);

impl FaultKind for Scale {
    const NAME: &'static str = "scale";
    const SUMMARY: &'static str = "The value is multiplied: a wrong gain.";
    const EQUATION: &'static str = "y = x (1 + (f - 1) g)";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = ScaleParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, ScaleParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        with(x, x.value * (1.0 + (self.0.factor - 1.0) * at.gain))
    }
}

shared_types::table! {
    /// Parameters of [`Drift`].
    pub struct DriftParameters {
        /// Growth rate r of the error.
        rate_per_s: "target/s" = 0.0 in (-LARGEST)..=LARGEST,
    }
}

/// An error that grows.
pub struct Drift(DriftParameters);

impl FaultKind for Drift {
    const NAME: &'static str = "drift";
    const SUMMARY: &'static str =
        "An error grows linearly from the step at which the fault took effect.";
    const EQUATION: &'static str = "y = x + r t g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = DriftParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, DriftParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        with(x, x.value + self.0.rate_per_s * at.since_s * at.gain)
    }
}

shared_types::table! {
    /// Parameters of [`Noise`].
    pub struct NoiseParameters {
        /// Standard deviation s.
        standard_deviation: "target" = 0.0 in 0.0..=LARGEST,
    }
}

/// White noise.
pub struct Noise {
    parameters: NoiseParameters,
    /// Source of normal numbers: faults keep the sequence that they have had from the beginning.
    draw: fn(&mut RandomStream) -> f64,
    random: Option<RandomStream>,
}

impl FaultKind for Noise {
    const NAME: &'static str = "noise";
    const SUMMARY: &'static str =
        "White Gaussian noise is added, the same numbers for the same seed.";
    const EQUATION: &'static str =
        "y = x + s n g, n normal with mean 0 and variance 1, a new one each step";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = NoiseParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.random.clone(),
            |fault, random| fault.random = random,
        ))
    }

    fn start(setup: &Setup<'_, NoiseParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            parameters: setup.parameters,
            draw: match setup.is_instrument {
                true => RandomStream::normal_by_layers,
                false => RandomStream::normal,
            },
            random: None,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.random = Some(random);
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let n = self.random.as_mut().map_or(0.0, self.draw);
        with(
            x,
            x.value + self.parameters.standard_deviation * n * at.gain,
        )
    }
}

shared_types::table! {
    /// Parameters of [`Spike`].
    pub struct SpikeParameters {
        /// Height a of a spike.
        amplitude: "target" = 0.0 in (-LARGEST)..=LARGEST,
        /// Time from spike to spike, rounded up to steps; 0: one spike.
        period_s: "s" = 0.0 in 0.0..=1e6,
        /// Length of a spike, rounded up to steps; 0: one step.
        width_s: "s" = 0.0 in 0.0..=1e6,
    }
}

/// Short pulses.
pub struct Spike {
    amplitude: f64,
    period_steps: u64,
    width_steps: u64,
}

impl FaultKind for Spike {
    const NAME: &'static str = "spike";
    const SUMMARY: &'static str = "Short errors are added, once or periodically.";
    const EQUATION: &'static str = "y = x + a g in the first w of each period, else y = x";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = SpikeParameters;
    const OPTIONAL: &'static [&'static str] = &["period_s", "width_s"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, SpikeParameters>) -> Result<Self, Invalid> {
        let steps = |time_s| setup.rate.step_at_or_after(time_s).0;
        let (period_steps, width) = (
            steps(setup.parameters.period_s),
            steps(setup.parameters.width_s),
        );
        let width_steps = if width == 0 { 1 } else { width };
        if period_steps > 0 && width_steps >= period_steps {
            return Err(Invalid(format!(
                "spikes of {width_steps} steps every {period_steps} steps never end; make `period_s` longer than `width_s`"
            )));
        }
        Ok(Self {
            amplitude: setup.parameters.amplitude,
            period_steps,
            width_steps,
        })
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let since = if self.period_steps == 0 {
            at.since_steps
        } else {
            at.since_steps % self.period_steps
        };
        if since < self.width_steps {
            with(x, x.value + self.amplitude * at.gain)
        } else {
            x
        }
    }
}
