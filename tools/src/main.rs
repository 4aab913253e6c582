//! `hil`, the one program a person calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    tools::main()
}
