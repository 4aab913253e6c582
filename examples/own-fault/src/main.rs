//! Play in a linkage: the driven side, a sensor or a valve, stands still until the play is taken up.
//!
//! A table lists the keys of a scenario, `impl FaultKind` is the fault, and `main` offers it in addition to the
//! built-in plants and kinds.

use std::process::ExitCode;

use plant_process::faults::kind::{FaultKind, FaultKindEntry, Moment, Reading, Setup};
use plant_process::faults::kinds;
use plant_process::models;
use shared_types::describe::{ActsOn, Invalid};
use shared_types::table;

table! {
    /// Parameters that an effect can set.
    struct Parameters {
        /// Play p: how far the driving side moves from one stop to the other.
        play: "target" = 0.0 in 0.0..=1e9,
    }
}

/// Backlash: the play operator of Brokate and Sprekels, Hysteresis and Phase Transitions (1996).
struct Backlash {
    play: f64,
    /// Position of the driven side, once the fault has taken effect.
    driven: Option<f64>,
}

impl FaultKind for Backlash {
    const NAME: &'static str = "gear-play";
    const SUMMARY: &'static str = "Play in a linkage: the value follows when the play is taken up.";
    const EQUATION: &'static str = "y(k) = min(max(y(k - 1), x - g p / 2), x + g p / 2)";
    const ACTS_ON: ActsOn = ActsOn::Signals;
    type Parameters = Parameters;

    fn start(setup: &Setup<'_, Parameters>) -> Result<Self, Invalid> {
        Ok(Self {
            play: setup.parameters.play,
            driven: None,
        })
    }

    fn number(&mut self, at: &Moment, x: Reading) -> Reading {
        // A play below 0 means as much as none.
        let half = if at.gain > 0.0 {
            at.gain * self.play / 2.0
        } else {
            0.0
        };
        let (low, high) = (x.value - half, x.value + half);
        let value = match self.driven {
            None => x.value,
            Some(driven) if driven < low => low,
            Some(driven) if driven > high => high,
            Some(driven) => driven,
        };
        self.driven = Some(value);
        Reading { value, ..x }
    }
}

fn main() -> ExitCode {
    let mut kinds = kinds::all();
    kinds.push(FaultKindEntry::of::<Backlash>());
    // The version, and the source that it was built from, as build.rs noted it.
    let (program, origin) = (env!("CARGO_PKG_NAME"), shared_types::origin!());
    plant_process::program::run_with_faults(program, origin, models::all(), kinds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_driven_side_follows_when_the_play_is_taken_up() {
        let mut backlash = Backlash {
            play: 2.0,
            driven: None,
        };
        // Profile, driving side, driven side: up, back through the play, then less play, then none.
        let steps = [
            (1.0, 5.0, 5.0),
            (1.0, 5.5, 5.0),
            (1.0, 7.0, 6.0),
            (1.0, 6.0, 6.0),
            (1.0, 5.0, 6.0),
            (1.0, 4.5, 5.5),
            (0.5, 4.5, 5.0),
            (0.0, 4.5, 4.5),
        ];
        for (since_steps, (gain, driving, expected)) in (0..).zip(steps) {
            let at = Moment {
                step: since_steps,
                since_steps,
                since_s: since_steps as f64,
                gain,
            };
            let reading = Reading {
                value: driving,
                valid: true,
            };
            let driven = backlash.number(&at, reading).value;
            assert_eq!(driven, expected, "step {since_steps}");
        }
    }
}
