//! The job: what a launcher tells a plant process to do. A JSON file in the session's folder.

use hil_config::plan::{Change, FaultEvent, Instrument, Plan, PlantPlan, Run, Stimulus};
use serde::{Deserialize, Serialize};
use shared_types::checkpoint::Checkpoints;
use shared_types::describe::{LawDescription, PROTOCOL};
use shared_types::realtime;
use shared_types::table::number;

use crate::repeat::Missed;

/// Name of the file in the session's folder.
pub const JOB_FILE: &str = shared_types::program::PLANT_JOB;

/// A plant's part of a checked scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// [`PROTOCOL`] of the launcher.
    pub protocol: u32,
    /// Random number of the session.
    pub session: u64,
    /// Duration, rate and clock.
    pub run: Run,
    /// Model and parameters.
    pub plant: PlantPlan,
    /// Reference signals.
    pub stimuli: Vec<Stimulus>,
    /// Sensors of the scenario.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<Instrument>,
    /// Actuators of the scenario.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actuators: Vec<Instrument>,
    /// Faults of the scenario.
    pub faults: Vec<FaultEvent>,
    /// Changes of values of the scenario.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Change>,
    /// Names and expressions of the scenario's derived signals, which conditions of faults may use.
    pub derived: Vec<(String, String)>,
    /// Steps at which the controller of a run in real time was not in time, if such a run is
    /// repeated; in order.
    #[serde(default)]
    pub missed: Vec<Missed>,
    /// Law as the first controller's binary describes it; a controller that says other things at hello
    /// is refused.
    #[serde(default)]
    pub law: Option<LawDescription>,
    /// Hold before the first step at or after this time in s.
    pub pause_at_s: Option<f64>,
    /// True if a recorder must see every record: the loop then waits for the recorder.
    pub observed: bool,
    /// True if the process is kept for another job after this one. It takes no live requests then.
    #[serde(default)]
    pub is_kept: bool,
    /// True if somebody starts the controller by hand: nothing limits the wait for its hello.
    #[serde(default)]
    pub is_controller_by_hand: bool,
    /// Checkpoints that the plant saves, and the one that it begins from.
    #[serde(default)]
    pub checkpoints: Checkpoints,
    /// Real-time settings of the plant's loop.
    #[serde(default)]
    pub realtime: realtime::Settings,
    /// Longest time that the other side may take, in s.
    #[serde(with = "number")]
    pub wait_limit_s: f64,
    /// Longest time in s that the other side may take until the first step, if that is more than `wait_limit_s`: an FMU
    /// may compute for long at its start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_limit_s: Option<f64>,
}

impl Job {
    /// Makes the job of a plant without reference signals, faults and checkpoints.
    #[must_use]
    pub fn new(session: u64, run: Run, plant: PlantPlan, wait_limit_s: f64) -> Self {
        Self {
            protocol: PROTOCOL,
            session,
            run,
            plant,
            stimuli: Vec::new(),
            sensors: Vec::new(),
            actuators: Vec::new(),
            faults: Vec::new(),
            changes: Vec::new(),
            derived: Vec::new(),
            missed: Vec::new(),
            law: None,
            pause_at_s: None,
            observed: true,
            is_kept: false,
            is_controller_by_hand: false,
            checkpoints: Checkpoints::default(),
            realtime: realtime::Settings::default(),
            wait_limit_s,
            start_limit_s: None,
        }
    }

    /// Makes the job of a scenario's plant.
    #[must_use]
    pub fn of(plan: &Plan, session: u64, wait_limit_s: f64) -> Self {
        Self {
            stimuli: plan.stimuli.clone(),
            sensors: plan.sensors.clone(),
            actuators: plan.actuators.clone(),
            faults: plan.faults.clone(),
            changes: plan.changes.clone(),
            derived: plan.derived_texts(),
            ..Self::new(session, plan.run, plan.plant.clone(), wait_limit_s)
        }
    }
}
