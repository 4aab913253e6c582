//! `hil-rig plant RIG.port.toml`: a rig behind a port as a plant program.

use std::process::ExitCode;

fn main() -> ExitCode {
    hil_rig::program::main()
}
