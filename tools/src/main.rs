//! `hil`, the one program a person calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    let command_line = tools::arguments::CommandLine::of_process();
    let executed = tools::terminal::interruption::end_at_once()
        .and_then(|()| tools::commands::execute(&command_line));
    match executed {
        Ok(exit) => exit.into(),
        Err(failure) => {
            let told = failure.to_string();
            tools::terminal::output::tell(&told);
            if let Some(advice) = tools::terminal::advice::on(&told) {
                tools::terminal::output::tell(&format!("  = help: {advice}"));
            }
            failure.exit().into()
        }
    }
}
