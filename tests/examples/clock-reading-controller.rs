//! A controller process with laws that depend on more than their samples. Not a program of the workspace: the tests of
//! `hil run --audit` give it to `--controller-bin`.
//!
//! Each law contains a common mistake: a derivative over wall-clock time, a number of workers taken from the number of
//! cores, a state that lacks a field. One law has none, to show that the program itself is not the cause.

#[macro_use]
#[path = "../shared/law.rs"]
mod law;
#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::process::ExitCode;
use std::time::Instant;

use controller_process::controller::LawKind;
use shared_types::state::StateOf;

use position_and_force::{Force, Position};

/// Returns the force in N of a spring towards the middle and a damper.
fn force_n(position_m: f64, velocity_mps: f64) -> f64 {
    -50.0 * (position_m - 0.01) - 2.0 * velocity_mps
}

struct Honest {
    position_m: f64,
}

impl Honest {
    fn force_n(&mut self, position_m: f64) -> f64 {
        let velocity_mps = 1000.0 * (position_m - self.position_m);
        self.position_m = position_m;
        force_n(position_m, velocity_mps)
    }
}

law!(
    Honest,
    "honest",
    "Knows the period of its samples.",
    Position,
    Some(StateOf::new(
        |law: &Self| law.position_m,
        |law, x_m| law.position_m = x_m
    )),
    Self { position_m: 0.0 },
    |law, measured| law.force_n(measured.position_m)
);

struct Forgets(Honest);

law!(
    Forgets,
    "forgets",
    "Leaves the last position out of its state.",
    Position,
    Some(StateOf::none()),
    Self(Honest { position_m: 0.0 }),
    |law, measured| law.0.force_n(measured.position_m)
);

struct ReadsClock {
    last: Instant,
    position_m: f64,
}

law!(
    ReadsClock,
    "reads-clock",
    "Takes the time between two calls for the period.",
    Position,
    None,
    Self {
        last: Instant::now(),
        position_m: 0.0,
    },
    |law, measured| {
        let position_m = measured.position_m;
        let elapsed_s = law.last.elapsed().as_secs_f64();
        let velocity_mps = 1e-3 * (position_m - law.position_m) / elapsed_s;
        (law.last, law.position_m) = (Instant::now(), position_m);
        force_n(position_m, velocity_mps)
    }
);

struct CountsCores;

law!(
    CountsCores,
    "counts-cores",
    "Splits its sum by the number of cores.",
    Position,
    None,
    Self,
    |_, measured| {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let share_m = measured.position_m / (3.0 * cores as f64);
        let position_m: f64 = (0..3 * cores).map(|_| share_m).sum();
        force_n(position_m, 0.0)
    }
);

fn main() -> ExitCode {
    let laws = vec![
        LawKind::of::<Honest>(),
        LawKind::of::<Forgets>(),
        LawKind::of::<ReadsClock>(),
        LawKind::of::<CountsCores>(),
    ];
    controller_process::program::run("clock-reading-controller", "0.1.0", laws)
}
