//! `hil sessions`: what runs, and what was left by what does not any more. Every command removes that;
//! this one tells of it.

use shared_types::session;

use crate::cli::config::SessionsArguments;
use crate::exit::{Exit, Failure};
use crate::output;

/// Runs the command.
///
/// # Errors
/// If shared memory cannot be looked at or cleaned.
pub fn sessions(arguments: &SessionsArguments) -> Result<Exit, Failure> {
    let removed = session::sweep().map_err(Failure::infrastructure)?;
    let live = session::list().map_err(Failure::infrastructure)?;
    if arguments.json {
        let all = serde_json::json!({ "sessions": live, "removed": removed });
        output::write(&format!("{all}\n"))?;
        return Ok(Exit::Pass);
    }
    let mut text = String::new();
    for name in &removed {
        text += &format!("removed what session `{name}` left\n");
    }
    if live.is_empty() {
        text += "no session is running\n";
    } else {
        text += &format!("{:<24}  {:>8}  RUN\n", "SESSION", "PROCESS");
    }
    for session in live {
        let run = session
            .run_dir
            .map_or("-".into(), |path| path.display().to_string());
        text += &format!("{:<24}  {:>8}  {run}\n", session.name, session.owner.pid);
    }
    output::write(&text)?;
    Ok(Exit::Pass)
}
