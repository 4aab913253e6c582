//! `hil sessions`: lists running sessions, and reports the remains of dead ones that were removed. Every command
//! removes those.

use std::time::Duration;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_facts::session::observer::Notice;
use hil_session::session;

use crate::arguments::config::SessionsArguments;

/// Runs the command.
///
/// # Errors
/// If shared memory cannot be read or cleaned.
pub(crate) fn sessions(arguments: &SessionsArguments) -> Result<Exit, Failure> {
    let removed = session::sweep().map_err(Failure::infrastructure)?;
    let live = session::list().map_err(Failure::infrastructure)?;
    if arguments.json {
        let all = serde_json::json!({ "sessions": live, "removed": removed });
        output::write(&format!("{all}\n"))?;
        return Ok(Exit::Pass);
    }
    let mut text = String::new();
    for name in &removed {
        text += &format!("removed the remains of session `{name}`\n");
    }
    if live.is_empty() {
        text += "no session is running\n";
    }
    let mut table = Table::new(0, [left(24), right(8), left(20), right(10), left(0)]);
    if !live.is_empty() {
        table.cells(["SESSION", "PROCESS", "SCENARIO", "AGE", "RUN"]);
    }
    for session in live {
        let scenario = Notice::read(&session).and_then(|notice| notice.scenario_name());
        let age = Notice::age(&session).map(|age| Duration::from_secs(age.as_secs()));
        let age = age.map(|age| humantime::format_duration(age).to_string());
        let run = (session.run_dir.as_ref()).map(|path| path.display().to_string());
        let [scenario, age, run] = [scenario, age, run].map(|one| one.unwrap_or("-".into()));
        table.row(&[&session.name, &session.owner.pid, &scenario, &age, &run]);
    }
    output::write(&format!("{text}{table}"))?;
    Ok(Exit::Pass)
}
