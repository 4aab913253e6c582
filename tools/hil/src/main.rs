//! `hil`, the command-line program of the framework.

use std::process::ExitCode;

use hil_session::program::with_stack;

fn main() -> ExitCode {
    with_stack(hil::main)
}
