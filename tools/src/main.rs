//! `hil`, the one program a person calls.

use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    let command_line = tools::cli::CommandLine::of_process();
    match tools::execute(&command_line) {
        Ok(exit) => exit.into(),
        Err(failure) => {
            // Standard error may be gone, as a terminal that was closed.
            let _ = writeln!(std::io::stderr(), "{failure}");
            failure.exit().into()
        }
    }
}
