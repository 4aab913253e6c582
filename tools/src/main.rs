//! `hil`, the one program a person calls.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let command_line = tools::cli::CommandLine::parse();
    match tools::execute(&command_line) {
        Ok(exit) => exit.into(),
        Err(failure) => {
            eprintln!("{failure}");
            failure.exit().into()
        }
    }
}
