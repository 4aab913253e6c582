//! `hil`, the one program a person calls.

use std::process::ExitCode;

use shared_types::program::with_stack;

fn main() -> ExitCode {
    with_stack(hil::main)
}
