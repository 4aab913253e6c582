//! A plant process with plants that behave until they have to run many cases. Not a program of the workspace: the tests
//! of campaigns give it to `hil campaign plan --plant-bin`.

#[macro_use]
#[path = "../shared/plant.rs"]
mod plant;
#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::process::ExitCode;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

use plant_process::plant::PlantKind;
use shared_types::table;

use position_and_force::{Force, Position};

/// Position at which a plant exits.
const DEADLY_M: f64 = 3.0;

/// Starts of the plant in this process.
static STARTS: AtomicU32 = AtomicU32::new(0);
/// Position of the first plant in this process.
static FIRST: OnceLock<f64> = OnceLock::new();

table! {
    /// Parameters of the plants.
    struct Parameters {
        /// Position of the mass.
        position_m: "m" = 0.0,
    }
}

macro_rules! spoiler {
    ($plant:ident, $name:literal, $start:expr, $deed:expr) => {
        struct $plant(f64);

        plant!(
            $plant,
            $name,
            "Spoils campaigns.",
            Parameters,
            |parameters| {
                let start: fn(f64) -> f64 = $start;
                Self(start(parameters.position_m))
            },
            |plant| plant.0,
            |plant| {
                let deed: fn(f64) = $deed;
                deed(plant.0);
            }
        );
    };
}

spoiler!(Behaves, "behaves", |position_m| position_m, |_| {});
// Whoever runs many cases in a process gets one that differs from start to start.
spoiler!(
    Leaks,
    "leaks",
    |position_m| position_m + f64::from(STARTS.fetch_add(1, Ordering::Relaxed)),
    |_| {}
);
spoiler!(Dies, "dies", |position_m| position_m, |position_m| {
    if position_m == DEADLY_M {
        std::process::abort();
    }
});

// Once, if there is a file to tell it.
spoiler!(Hangs, "hangs", |position_m| position_m, |_| {
    let told = std::env::var_os("CASE_PLANT_HANGS");
    if told.is_some_and(|file| std::fs::remove_file(file).is_ok()) {
        loop {
            std::thread::park();
        }
    }
});

spoiler!(Mortal, "mortal", |position_m| position_m, die_if_told);
// Dies with the job of the next case too: between two cases, as far as anybody can see.
spoiler!(
    Stumbles,
    "stumbles",
    |position_m| {
        if *FIRST.get_or_init(|| position_m) != position_m {
            std::process::abort();
        }
        position_m
    },
    die_if_told
);

/// Exits in one case, once for each line of a file, if there is one.
fn die_if_told(position_m: f64) {
    let file = std::env::var_os("CASE_PLANT_DIES").filter(|_| position_m == DEADLY_M);
    let told = file.and_then(|file| Some((std::fs::read_to_string(&file).ok()?, file)));
    if let Some((lines, file)) = told
        && let Some((_, rest)) = lines.split_once('\n')
    {
        std::fs::write(file, rest).expect("written");
        std::process::abort();
    }
}

fn main() -> ExitCode {
    let plants = vec![
        PlantKind::of::<Behaves>(),
        PlantKind::of::<Leaks>(),
        PlantKind::of::<Dies>(),
        PlantKind::of::<Hangs>(),
        PlantKind::of::<Mortal>(),
        PlantKind::of::<Stumbles>(),
    ];
    plant_process::program::run("case-plant", "0.1.0", plants)
}
