//! A plant process whose sensors have gaps and ages. Not a program of the workspace: the tests of validity give it to
//! `--plant-bin`.

#[path = "../shared/patchy_plant.rs"]
mod patchy_plant;

use std::process::ExitCode;

use plant_process::plant::PlantKind;

fn main() -> ExitCode {
    let plants = vec![PlantKind::of::<patchy_plant::Patchy>()];
    plant_process::program::run("patchy-plant", "0.1.0", plants)
}
