//! `hil`, the one program a person calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    let command_line = tools::cli::CommandLine::of_process();
    match tools::execute(&command_line) {
        Ok(exit) => exit.into(),
        Err(failure) => {
            eprintln!("{failure}");
            failure.exit().into()
        }
    }
}
