//! A controller process with one law for each way to spoil a run. Not a program of the workspace: the
//! tests of failures give it to `hil run --controller-bin`.

use std::process::ExitCode;

use controller_process::controller::{Controller, LawKind, Sample, Setup};
use shared_types::describe::Invalid;
use shared_types::table;
use shared_types::table::Empty;

/// The sample at which a law misbehaves.
const WHEN: u64 = 100;
/// What every law commands before.
const BEFORE_N: f64 = 0.5;

table! {
    /// What every plant of these tests measures.
    struct Position {
        /// Position.
        position_m: "m",
    }
}

table! {
    /// What no plant measures.
    struct Missing {
        /// Phase of the moon.
        positron_m: "m",
    }
}

table! {
    /// What the teaching plant takes.
    struct Force {
        /// Force.
        force_n: "N",
    }
}

macro_rules! law {
    ($law:ident, $name:literal, $measured:ty, $deed:expr) => {
        struct $law {
            samples: u64,
        }

        impl Controller for $law {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = "Misbehaves.";
            type Parameters = Empty;
            type Model = Empty;
            type Measured = $measured;
            type Reference = Empty;
            type Command = Force;
            type Internals = Empty;

            fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
                Ok(Self { samples: 0 })
            }

            fn step(&mut self, _: &Sample<Self>) -> (Force, Empty) {
                self.samples += 1;
                let deed: fn() -> f64 = $deed;
                let force_n = if self.samples > WHEN {
                    deed()
                } else {
                    BEFORE_N
                };
                (Force { force_n }, Empty {})
            }
        }
    };
}

law!(Leaves, "leaves", Position, || std::process::exit(0));
law!(Panics, "panics", Position, || panic!("the law fell over"));
law!(Sleeps, "sleeps", Position, || loop {
    std::thread::park();
});
law!(Babbles, "babbles", Position, || f64::NAN);
law!(Pushes, "pushes", Position, || 1e12);
law!(Hoards, "hoards", Position, || {
    let mut hoard = Vec::new();
    loop {
        hoard.push(std::hint::black_box(vec![1_u8; 1 << 24]));
    }
});
law!(Moons, "moons", Missing, || 0.0);

fn main() -> ExitCode {
    let laws = vec![
        LawKind::of::<Leaves>(),
        LawKind::of::<Panics>(),
        LawKind::of::<Sleeps>(),
        LawKind::of::<Babbles>(),
        LawKind::of::<Pushes>(),
        LawKind::of::<Hoards>(),
        LawKind::of::<Moons>(),
    ];
    controller_process::program::run("misbehaving-controller", "0.1.0", laws)
}
