//! The job: a launcher's instructions to a plant process. A JSON file in the session's folder.

use hil_config::plan::{
    BusPlan, Change, Definition, FaultEvent, Instrument, Plan, PlantPlan, Run, Stimulus, tap_fields,
};
use serde::{Deserialize, Serialize};
use shared_types::checkpoint::Checkpoints;
use shared_types::describe::{LawDescription, PROTOCOL, PlantDescription};
use shared_types::realtime;
use shared_types::table::{Field, number};

use crate::repeat::Missed;

/// Name of the file in the session's folder.
pub const JOB_FILE: &str = hil_session::program::PLANT_JOB;

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
    /// Bus in simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bus: Option<BusPlan>,
    /// Faults of the scenario.
    pub faults: Vec<FaultEvent>,
    /// Changes of values of the scenario.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Change>,
    /// Names and definitions of the scenario's derived signals, for conditions of faults.
    pub derived: Vec<(String, Definition)>,
    /// Steps at which the controller of a repeated real-time run was late, in order.
    #[serde(default)]
    pub missed: Vec<Missed>,
    /// Law as described by the first controller's binary; a controller with a different hello is refused.
    #[serde(default)]
    pub law: Option<LawDescription>,
    /// Pauses the run before the first step at or after this time in s.
    pub pause_at_s: Option<f64>,
    /// `true` if a recorder must receive every record: the loop then waits for the recorder.
    pub observed: bool,
    /// `true` if the process will receive another job after this one. It then serves no live requests.
    #[serde(default)]
    pub is_kept: bool,
    /// `true` if the controller is started manually: the wait for its hello is unlimited.
    #[serde(default)]
    pub is_controller_by_hand: bool,
    /// Checkpoints that the plant saves, and the one from which it resumes.
    #[serde(default)]
    pub checkpoints: Checkpoints,
    /// Real-time settings of the plant's loop.
    #[serde(default)]
    pub realtime: realtime::Settings,
    /// Longest time in s that the other side may take.
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
    /// Returns the columns of the recorded inputs of sensors and of actuators of this plant.
    pub(crate) fn tap_fields(&self, plant: &PlantDescription) -> [Vec<Field>; 2] {
        tap_fields(plant, [&self.sensors, &self.actuators], self.run.rate)
    }

    /// Creates the job of a plant without reference signals, faults and checkpoints.
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
            bus: None,
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
            is_tuned: false,
        }
    }

    /// Creates the job of a scenario's plant.
    #[must_use]
    pub fn of(plan: &Plan, session: u64, wait_limit_s: f64) -> Self {
        Self {
            stimuli: plan.stimuli.clone(),
            sensors: plan.sensors.clone(),
            actuators: plan.actuators.clone(),
            bus: plan.bus.clone(),
            faults: plan.faults.clone(),
            changes: plan.changes.clone(),
            derived: plan.definitions(),
            ..Self::new(session, plan.run, plan.plant.clone(), wait_limit_s)
        }
    }
}
