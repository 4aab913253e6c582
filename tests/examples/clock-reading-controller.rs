//! A controller process with laws that depend on more than their samples. Not a program of the
//! workspace: the tests of `hil run --audit` give it to `--controller-bin`.
//!
//! Each makes a mistake that people make: a derivative over the time of the wall clock, a number of
//! workers after the number of cores, a state that lacks a field, and, to show that neither comes from this program, none.

#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::process::ExitCode;
use std::time::Instant;

use controller_process::controller::{Controller, LawKind, Sample, Setup};
use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table::Empty;

use position_and_force::{Force, Position};

/// A spring to the middle and a damper.
fn force(position_m: f64, velocity_mps: f64) -> Force {
    Force {
        force_n: -50.0 * (position_m - 0.01) - 2.0 * velocity_mps,
    }
}

struct Honest {
    position_m: f64,
}

impl Controller for Honest {
    const NAME: &'static str = "honest";
    const SUMMARY: &'static str = "Knows the period of its samples.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Position;
    type Reference = Empty;
    type Command = Force;
    type Internals = Empty;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self { position_m: 0.0 })
    }

    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(|law: &Self| law.position_m, |law, x_m| law.position_m = x_m);
        Some(state)
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Force, Empty) {
        let position_m = sample.measured.position_m;
        let velocity_mps = 1000.0 * (position_m - self.position_m);
        self.position_m = position_m;
        (force(position_m, velocity_mps), Empty {})
    }
}

struct Forgets(Honest);

impl Controller for Forgets {
    const NAME: &'static str = "forgets";
    const SUMMARY: &'static str = "Leaves the last position out of its state.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Position;
    type Reference = Empty;
    type Command = Force;
    type Internals = Empty;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self(Honest { position_m: 0.0 }))
    }

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Force, Empty) {
        let (law, position_m) = (&mut self.0, sample.measured.position_m);
        let velocity_mps = 1000.0 * (position_m - law.position_m);
        law.position_m = position_m;
        (force(position_m, velocity_mps), Empty {})
    }
}

struct ReadsClock {
    last: Instant,
    position_m: f64,
}

impl Controller for ReadsClock {
    const NAME: &'static str = "reads-clock";
    const SUMMARY: &'static str = "Takes the time between two calls for the period.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Position;
    type Reference = Empty;
    type Command = Force;
    type Internals = Empty;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self {
            last: Instant::now(),
            position_m: 0.0,
        })
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Force, Empty) {
        let position_m = sample.measured.position_m;
        let elapsed_s = self.last.elapsed().as_secs_f64();
        let velocity_mps = 1e-3 * (position_m - self.position_m) / elapsed_s;
        (self.last, self.position_m) = (Instant::now(), position_m);
        (force(position_m, velocity_mps), Empty {})
    }
}

struct CountsCores;

impl Controller for CountsCores {
    const NAME: &'static str = "counts-cores";
    const SUMMARY: &'static str = "Splits its sum by the number of cores.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Position;
    type Reference = Empty;
    type Command = Force;
    type Internals = Empty;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self)
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Force, Empty) {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let share_m = sample.measured.position_m / (3.0 * cores as f64);
        let position_m: f64 = (0..3 * cores).map(|_| share_m).sum();
        (force(position_m, 0.0), Empty {})
    }
}

fn main() -> ExitCode {
    let laws = vec![
        LawKind::of::<Honest>(),
        LawKind::of::<Forgets>(),
        LawKind::of::<ReadsClock>(),
        LawKind::of::<CountsCores>(),
    ];
    controller_process::program::run("clock-reading-controller", "0.1.0", laws)
}
