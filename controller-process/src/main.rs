//! The laws that ship with the framework, as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    controller_process::program::run(
        env!("CARGO_PKG_NAME"),
        shared_types::origin!(),
        controller_process::laws::all(),
    )
}
