//! The plants that ship with the framework, as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    plant_process::program::run(
        env!("CARGO_PKG_NAME"),
        shared_types::origin!(),
        plant_process::models::all(),
    )
}
