//! `hil sessions`: what runs, and cleaning up after what does not any more.

use shared_types::session;

use crate::cli::SessionsArguments;
use crate::exit::{Exit, Failure};

/// Runs the command.
///
/// # Errors
/// If shared memory cannot be looked at or cleaned.
pub fn sessions(arguments: &SessionsArguments) -> Result<Exit, Failure> {
    let removed = if arguments.clean {
        session::sweep().map_err(Failure::infrastructure)?
    } else {
        Vec::new()
    };
    let live = session::list().map_err(Failure::infrastructure)?;
    if arguments.json {
        println!(
            "{}",
            serde_json::json!({ "sessions": live, "removed": removed })
        );
        return Ok(Exit::Pass);
    }
    for name in &removed {
        println!("removed what session `{name}` left");
    }
    if live.is_empty() {
        println!("no session is running");
    } else {
        println!("{:<24}  {:>8}  RUN", "SESSION", "PROCESS");
    }
    for session in live {
        let run = session
            .run_dir
            .map_or("-".into(), |path| path.display().to_string());
        println!("{:<24}  {:>8}  {run}", session.name, session.owner.pid);
    }
    Ok(Exit::Pass)
}
