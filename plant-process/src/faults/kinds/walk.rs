//! Errors that wander: a Gauss-Markov process and a random walk.

use shared_types::describe::{ActsOn, Invalid};
use shared_types::random::RandomStream;
use shared_types::state::StateOf;

use super::LARGEST;
use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

shared_types::table! {
    /// Parameters of [`GaussMarkov`].
    pub struct GaussMarkovParameters {
        /// Standard deviation s.
        standard_deviation: "target" = 0.0 in 0.0..=LARGEST,
        /// Correlation time T; inf: one value is drawn and stays.
        time_constant_s: "s" = 1.0 in 1e-9..=(f64::INFINITY),
    }
}

/// An error that wanders about 0 and gradually forgets its past.
pub struct GaussMarkov {
    standard_deviation: f64,
    /// Share of the value that remains after a step, `exp(-dt / T)`.
    decay: f64,
    /// Standard deviation of the random part added in a step.
    fresh: f64,
    random: Option<RandomStream>,
    value: Option<f64>,
}

impl FaultKind for GaussMarkov {
    const NAME: &'static str = "gauss-markov";
    const SUMMARY: &'static str = "An error is added that wanders about 0 with a correlation time (Gauss-Markov process of first order).";
    const EQUATION: &'static str = "y = x + b g; b(k0) = s n(k0), b(k) = a b(k - 1) + s sqrt(1 - a^2) n(k), a = exp(-dt / T), n normal with mean 0 and variance 1";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = GaussMarkovParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| (fault.random.clone(), fault.value),
            |fault, (random, value)| (fault.random, fault.value) = (random, value),
        ))
    }

    fn start(setup: &Setup<'_, GaussMarkovParameters>) -> Result<Self, Invalid> {
        let GaussMarkovParameters {
            standard_deviation,
            time_constant_s,
        } = setup.parameters;
        let steps = setup.rate.period_s() / time_constant_s;
        Ok(Self {
            standard_deviation,
            decay: libm::exp(-steps),
            fresh: standard_deviation * (-libm::expm1(-2.0 * steps)).sqrt(),
            random: None,
            value: None,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.random = Some(random);
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let random = self.random.as_mut();
        let b = match self.value {
            // Drawn once and for all.
            Some(b) if self.fresh == 0.0 => b * self.decay,
            Some(b) => {
                self.decay * b + self.fresh * random.map_or(0.0, RandomStream::normal_by_layers)
            }
            None => self.standard_deviation * random.map_or(0.0, RandomStream::normal_by_layers),
        };
        self.value = Some(b);
        Reading {
            value: x.value + b * at.gain,
            ..x
        }
    }
}

shared_types::table! {
    /// Parameters of [`RandomWalk`].
    pub struct RandomWalkParameters {
        /// Growth K of the standard deviation: after a time t it is K sqrt(t).
        walk_per_sqrt_s: "target/sqrt(s)" = 0.0 in 0.0..=LARGEST,
    }
}

/// An error that wanders without bound.
pub struct RandomWalk {
    /// Standard deviation of one step.
    step: f64,
    random: Option<RandomStream>,
    value: Option<f64>,
}

impl FaultKind for RandomWalk {
    const NAME: &'static str = "random-walk";
    const SUMMARY: &'static str = "An error is added that walks away at random, from 0 at the step at which the fault took effect.";
    const EQUATION: &'static str = "y = x + b g; b(k0) = 0, b(k) = b(k - 1) + K sqrt(dt) n(k), n normal with mean 0 and variance 1";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = RandomWalkParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| (fault.random.clone(), fault.value),
            |fault, (random, value)| (fault.random, fault.value) = (random, value),
        ))
    }

    fn start(setup: &Setup<'_, RandomWalkParameters>) -> Result<Self, Invalid> {
        Ok(Self {
            step: setup.parameters.walk_per_sqrt_s * setup.rate.period_s().sqrt(),
            random: None,
            value: None,
        })
    }

    fn hold(&mut self, random: RandomStream) {
        self.random = Some(random);
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let b = self.value.map_or(0.0, |b| {
            b + self.step
                * self
                    .random
                    .as_mut()
                    .map_or(0.0, RandomStream::normal_by_layers)
        });
        self.value = Some(b);
        Reading {
            value: x.value + b * at.gain,
            ..x
        }
    }
}
