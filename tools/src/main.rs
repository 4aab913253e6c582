//! `hil`, the one program a person calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    let command_line = tools::cli::CommandLine::of_process();
    let executed = tools::interruption::end_at_once().and_then(|()| tools::execute(&command_line));
    match executed {
        Ok(exit) => exit.into(),
        Err(failure) => {
            let told = failure.to_string();
            tools::output::tell(&told);
            if let Some(advice) = tools::advice::on(&told) {
                tools::output::tell(&format!("  = help: {advice}"));
            }
            failure.exit().into()
        }
    }
}
