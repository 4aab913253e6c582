//! The plants that ship with the framework, as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    plant_process::program::run(
        env!("CARGO_PKG_NAME"),
        env!("CARGO_PKG_VERSION"),
        plant_process::models::all(),
    )
}
