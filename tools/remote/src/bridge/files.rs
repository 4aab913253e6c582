//! Files of a run's session: the parts of its jobs that the bridge reads, and the files that it writes.

use hil_session::session::SessionInfo;
use shared_types::describe::Settings;
use shared_types::table::number;
use shared_types::time::Rate;

/// Name of the file in a session's folder with the number of switches of the target's output to the safe command.
pub(super) const SWITCHES_FILE: &str = "target-switches.json";
/// The parts of a controller's job that the bridge uses.
#[derive(serde::Deserialize)]
pub(super) struct Job {
    pub(super) epoch: u32,
    pub(super) rate: Rate,
    #[serde(with = "number")]
    pub(super) wait_limit_s: f64,
}

/// The parts of a plant's job that matter to a target.
#[derive(serde::Deserialize)]
pub(super) struct PlantJob {
    #[serde(with = "number")]
    pub(super) wait_limit_s: f64,
    pub(super) plant: Safe,
}

#[derive(serde::Deserialize)]
pub(super) struct Safe {
    #[serde(default)]
    pub(super) safe_command: Settings,
}

/// Returns the number of switches of the target's output to the safe command in a session, if the desk received one.
#[must_use]
pub fn switches(session: &SessionInfo) -> Option<u32> {
    session.read_file(SWITCHES_FILE).ok()
}

/// Returns the name of the file in a session's folder that shows that the controller of this epoch runs on its target.
#[must_use]
pub fn ready_file(epoch: u32) -> String {
    format!("target-{epoch}.json")
}
