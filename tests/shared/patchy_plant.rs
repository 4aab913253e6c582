//! A plant whose sensor of the position has a gap, and whose sensor of the rate is slow and says how old its value is.

use plant_process::plant::Plant;
use shared_types::describe::Invalid;
use shared_types::quality::SignalSet;
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::table::Empty;
use shared_types::time::Interval;

/// Steps at which the position is invalid.
pub(crate) const GAP: std::ops::Range<u64> = 20..35;
/// Steps from one sample of the rate to the next.
pub(crate) const EVERY: u64 = 4;

table! {
    /// Truth.
    pub(crate) struct Truth {
        /// Position.
        position_m: "m",
    }
}

table! {
    /// Readings.
    pub(crate) struct Readings {
        /// Position.
        position_m: "m" in (-10.0)..=10.0,
        /// Rate, sampled at every fourth step.
        rate_mps: "m/s",
        /// Age of the rate.
        rate_mps_age_steps: "steps",
    }
}

table! {
    /// Command.
    pub(crate) struct Command {
        /// Rate.
        rate_mps: "m/s",
    }
}

/// The plant: `x' = u`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patchy {
    step: u64,
    position_m: f64,
    rate_mps: f64,
    sampled_mps: f64,
}

impl Plant for Patchy {
    const NAME: &'static str = "patchy";
    const SUMMARY: &'static str = "A position with a gap in its measurement.";
    type Parameters = Empty;
    type Truth = Truth;
    type Measured = Readings;
    type Command = Command;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |plant: &Self| {
                (
                    plant.step,
                    plant.position_m,
                    plant.rate_mps,
                    plant.sampled_mps,
                )
            },
            |plant, (step, position_m, rate_mps, sampled_mps)| {
                *plant = Self {
                    step,
                    position_m,
                    rate_mps,
                    sampled_mps,
                };
            },
        ))
    }

    fn start(_: &Empty) -> Result<Self, Invalid> {
        Ok(Self {
            step: 0,
            position_m: 0.0,
            rate_mps: 0.0,
            sampled_mps: 0.0,
        })
    }

    fn retune(&mut self, _: &Empty) {}

    fn measure(&self) -> Readings {
        Readings {
            position_m: self.position_m,
            rate_mps: self.sampled_mps,
            rate_mps_age_steps: (self.step % EVERY) as f64,
        }
    }

    fn read(&self, invalid: &mut SignalSet) -> Readings {
        let mut readings = self.measure();
        if GAP.contains(&self.step) {
            readings.position_m = f64::NAN;
            invalid.insert_in(|readings: &Readings| readings.position_m);
        }
        readings
    }

    fn truth(&self, _: f64, _: &Command) -> Truth {
        Truth {
            position_m: self.position_m,
        }
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        self.step += 1;
        self.position_m += interval.length_s * command.rate_mps;
        self.rate_mps = command.rate_mps;
        if self.step.is_multiple_of(EVERY) {
            self.sampled_mps = self.rate_mps;
        }
    }
}
