//! A law that exposes the quality of what it measures, and does not refresh its command for a while.

use controller_process::controller::{Controller, Sample, Setup};
use shared_types::describe::Invalid;
use shared_types::quality::{Quality, SignalSet};
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::table::Empty;

/// Samples at which the law does not refresh its command.
pub(crate) const HELD: std::ops::Range<u64> = 50..60;

table! {
    /// Measured.
    pub(crate) struct Measured {
        /// Position.
        position_m: "m",
        /// Rate.
        rate_mps: "m/s",
    }
}

table! {
    /// Command.
    pub(crate) struct Command {
        /// Rate.
        rate_mps: "m/s",
    }
}

table! {
    /// Internals.
    pub(crate) struct Internals {
        /// 1 if the position is valid.
        is_valid: "1",
        /// Age of the position.
        position_age: "steps",
        /// Age of the rate.
        rate_age: "steps",
    }
}

/// The law: `u = 1 - x`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Watchful {
    samples: u64,
}

impl Controller for Watchful {
    const NAME: &'static str = "watchful";
    const SUMMARY: &'static str = "Approaches 1 m and shows the quality of its sample.";
    const PLANTS: &'static [&'static str] = &["patchy"];
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Measured;
    type Reference = Empty;
    type Command = Command;
    type Internals = Internals;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |law: &Self| law.samples,
            |law, samples| law.samples = samples,
        ))
    }

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self { samples: 0 })
    }

    fn step(&mut self, _: &Sample<Self>) -> (Command, Internals) {
        unreachable!("`answer` is called instead")
    }

    fn answer(
        &mut self,
        sample: &Sample<Self>,
        quality: &Quality<'_>,
        held: &mut SignalSet,
    ) -> (Command, Internals) {
        let is_valid = quality.is_valid(|measured: &Measured| measured.position_m);
        let internals = Internals {
            is_valid: if is_valid { 1.0 } else { 0.0 },
            position_age: quality
                .age_steps_of(|measured: &Measured| measured.position_m)
                .into(),
            rate_age: quality
                .age_steps_of(|measured: &Measured| measured.rate_mps)
                .into(),
        };
        let mut rate_mps = 1.0 - sample.measured.position_m;
        if HELD.contains(&self.samples) {
            held.insert_in(|command: &Command| command.rate_mps);
            rate_mps = f64::NAN;
        }
        self.samples += 1;
        (Command { rate_mps }, internals)
    }
}
