//! Faults that show the past or nothing: a number is frozen, delayed, sampled periodically, or missing.

use shared_types::describe::{ActsOn, Invalid};
use shared_types::state::StateOf;
use shared_types::table::Empty;

use super::{LARGEST, towards, whole};
use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

/// Frozen value.
pub struct Stuck(Option<f64>);

impl FaultKind for Stuck {
    const NAME: &'static str = "stuck";
    const SUMMARY: &'static str = "The value freezes when the profile leaves 0.";
    const EQUATION: &'static str =
        "y = x(t0) where g is not 0, t0 the first step of that; else y = x";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = Empty;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.0,
            |fault, value| fault.0 = value,
        ))
    }

    fn start(_: &Setup<'_, Empty>) -> Result<Self, Invalid> {
        Ok(Self(None))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        if at.gain == 0.0 {
            self.0 = None;
            return x;
        }
        let value = *self.0.get_or_insert(x.value);
        Reading { value, ..x }
    }
}

shared_types::table! {
    /// Parameters of [`StuckAt`].
    pub struct StuckAtParameters {
        /// Target value v.
        value: "target" = 0.0 in (-LARGEST)..=LARGEST,
    }
}

/// Value frozen at a given level.
pub struct StuckAt(StuckAtParameters);

impl FaultKind for StuckAt {
    const NAME: &'static str = "stuck-at";
    const SUMMARY: &'static str = "The value moves to a given value and stays there.";
    const EQUATION: &'static str = "y = x + (v - x) g";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = StuckAtParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, StuckAtParameters>) -> Result<Self, Invalid> {
        Ok(Self(setup.parameters))
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        Reading {
            value: towards(x.value, self.0.value, at.gain),
            ..x
        }
    }
}

shared_types::table! {
    /// Parameters of [`Delay`].
    pub struct DelayParameters {
        /// Delay n, a whole number.
        steps: "steps" = 1.0 in 0.0..=1e5,
    }
}

/// Delayed value.
pub struct Delay {
    steps: u64,
    /// Last readings, by steps since the beginning of the fault.
    past: Vec<Reading>,
    /// Next step since the beginning, and its index among the last readings.
    next: (u64, usize),
}

impl FaultKind for Delay {
    const NAME: &'static str = "delay";
    const SUMMARY: &'static str = "The value is n steps old; in the first n steps it is that of the step at which the fault took effect.";
    const EQUATION: &'static str = "y(k) = x(max(k - n, k0)) where g is not 0, else y = x";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = DelayParameters;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::checked(
            |fault: &Self| fault.past.clone(),
            |fault, past| {
                if past.len() != fault.past.len() {
                    let (saved, now) = (past.len().saturating_sub(1), fault.steps);
                    return Err(Invalid(format!(
                        "the delay was saved with {saved} steps and cannot resume with {now}; keep the delay of the saved state"
                    )));
                }
                fault.past = past;
                Ok(())
            },
        ))
    }

    fn start(setup: &Setup<'_, DelayParameters>) -> Result<Self, Invalid> {
        let steps = whole("steps", setup.parameters.steps)?;
        let empty = Reading {
            value: 0.0,
            valid: true,
        };
        Ok(Self {
            steps: u64::from(steps),
            past: vec![empty; steps as usize + 1],
            next: (0, 0),
        })
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        let (since_steps, places) = (at.since_steps, self.past.len());
        let place = match self.next {
            (next_step, place) if next_step == since_steps => place,
            // A restored state; a division costs more than everything else here.
            _ => (since_steps % places as u64) as usize,
        };
        self.past[place] = x;
        let oldest = if place + 1 == places { 0 } else { place + 1 };
        self.next = (since_steps + 1, oldest);
        if at.gain == 0.0 {
            return x;
        }
        self.past[if since_steps < self.steps { 0 } else { oldest }]
    }
}

shared_types::table! {
    /// Parameters of [`SampleHold`].
    pub struct SampleHoldParameters {
        /// Steps n from sample to sample, a whole number.
        every_steps: "steps" = 1.0 in 1.0..=4e9,
        /// Step p of the first sample, a whole number below n.
        phase_steps: "steps" = 0.0 in 0.0..=4e9,
    }
}

/// Takes a sample periodically and holds its value.
pub struct SampleHold {
    every_steps: u64,
    phase_steps: u64,
    held: Option<Reading>,
    /// Step of the next sample; 0 if it is not known.
    next: u64,
}

impl FaultKind for SampleHold {
    const NAME: &'static str = "sample-hold";
    const SUMMARY: &'static str = "The value is sampled at every n-th step of the run and held in between; before the first sample it is that of the step at which the fault took effect.";
    const EQUATION: &'static str =
        "y(k) = x(s) where g is not 0, s the last step with s mod n = p, at least k0; else y = x";
    const ACTS_ON: ActsOn = ActsOn::Numbers;
    type Parameters = SampleHoldParameters;
    const OPTIONAL: &'static [&'static str] = &["phase_steps"];

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |fault: &Self| fault.held,
            |fault, held| (fault.held, fault.next) = (held, 0),
        ))
    }

    fn start(setup: &Setup<'_, SampleHoldParameters>) -> Result<Self, Invalid> {
        let every_steps = u64::from(whole("every_steps", setup.parameters.every_steps)?);
        let phase_steps = u64::from(whole("phase_steps", setup.parameters.phase_steps)?);
        if phase_steps >= every_steps {
            return Err(Invalid(format!(
                "`phase_steps` is {phase_steps}; of {every_steps} steps the last has the phase {}",
                every_steps - 1
            )));
        }
        Ok(Self {
            every_steps,
            phase_steps,
            held: None,
            next: 0,
        })
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        if at.step > self.next || self.next == 0 {
            let since_phase = (at.step + self.every_steps - self.phase_steps) % self.every_steps;
            self.next = match since_phase {
                0 => at.step,
                since => at.step + self.every_steps - since,
            };
        }
        let is_sampled = at.step == self.next;
        if is_sampled {
            self.next += self.every_steps;
        }
        let held = *self.held.get_or_insert(x);
        if is_sampled {
            self.held = Some(x);
        }
        if at.gain == 0.0 || is_sampled {
            return x;
        }
        held
    }
}

/// Missing value.
pub struct Dropout;

impl FaultKind for Dropout {
    const NAME: &'static str = "dropout";
    const SUMMARY: &'static str = "The signal is marked invalid and keeps its last valid value.";
    const EQUATION: &'static str = "y = last valid y, marked invalid, where g is not 0; else y = x";
    const ACTS_ON: ActsOn = ActsOn::Signals;
    type Parameters = Empty;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(_: &Setup<'_, Empty>) -> Result<Self, Invalid> {
        Ok(Self)
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        // The layer replaces an invalid value by the last valid one.
        Reading {
            valid: x.valid && at.gain == 0.0,
            ..x
        }
    }
}
