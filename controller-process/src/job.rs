//! The job: a launcher's instructions to a controller process. A JSON file in the session's folder.

use serde::{Deserialize, Serialize};
use shared_types::checkpoint::Checkpoints;
use shared_types::connection::Connection;
use shared_types::describe::{PROTOCOL, Settings};
use shared_types::realtime;
use shared_types::table::number;
use shared_types::time::Rate;

/// Name of the file in the session's folder.
pub const JOB_FILE: &str = hil_session::program::CONTROLLER_JOB;

/// A controller's part of a checked scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// [`PROTOCOL`] of the launcher.
    pub protocol: u32,
    /// Random number of the session.
    pub session: u64,
    /// Number of this controller in the session, from 1.
    pub epoch: u32,
    /// Name of the plant that the law is made for, which selects among laws of the same name.
    pub plant: String,
    /// Name of the law.
    pub law: String,
    /// Every parameter of the law.
    pub parameters: Settings,
    /// The law's model of the plant.
    pub model: Settings,
    /// Signals of the law bound to other names and units.
    #[serde(default)]
    pub connections: Vec<Connection>,
    /// Exchange rate.
    pub rate: Rate,
    /// Ratio n of the law's period to the exchange period: the law runs at every n-th sample and holds its command in
    /// between.
    pub rate_divisor: u32,
    /// Steps between a sample and the command that answers it: 0 or 1.
    pub command_delay_steps: u32,
    /// `true` if the process will receive another job after this one.
    #[serde(default)]
    pub is_kept: bool,
    /// `true` if the plant is started manually: the wait for its first sample is unlimited.
    #[serde(default)]
    pub is_plant_by_hand: bool,
    /// Parameters after each change of the scenario, which the law validates at its start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Settings>,
    /// Checkpoints that the controller writes, and the one from which it resumes.
    #[serde(default)]
    pub checkpoints: Checkpoints,
    /// Real-time settings of the controller's loop.
    #[serde(default)]
    pub realtime: realtime::Settings,
    /// Time that the other side may take, in s.
    #[serde(with = "number")]
    pub wait_limit_s: f64,
    /// Longest time in s that the other side may take until the first step, if longer than `wait_limit_s`: an FMU may
    /// take long to start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_limit_s: Option<f64>,
    /// `true` if the parameters result from a change during the run, so that no process starts with them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_tuned: bool,
}

impl Job {
    /// Creates the job of a session's first controller, whose law has no parameters and runs at every sample.
    #[must_use]
    pub fn new(session: u64, plant: &str, law: &str, rate: Rate, wait_limit_s: f64) -> Self {
        Self {
            protocol: PROTOCOL,
            session,
            epoch: 1,
            plant: plant.into(),
            law: law.into(),
            parameters: Settings::default(),
            model: Settings::default(),
            connections: Vec::new(),
            rate,
            rate_divisor: 1,
            command_delay_steps: 0,
            is_kept: false,
            is_plant_by_hand: false,
            changes: Vec::new(),
            checkpoints: Checkpoints::default(),
            realtime: realtime::Settings::default(),
            wait_limit_s,
            start_limit_s: None,
            is_tuned: false,
        }
    }
}
