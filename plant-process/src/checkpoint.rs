//! State of the plant's process in a checkpoint: the model, its instruments and faults, and the last record.
//!
//! The engine saves this state before a step, when everything about the previous steps has been published, and starts
//! from it in a resumed run. All other data follows from the job and the step: the reference signals, and every row
//! that a step writes before reading it.

use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::state::State;

use crate::faults::SavedFaults;
use crate::plant::Model;
use crate::tuning::SavedTuning;

/// State of the plant before a step.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SavedPlant {
    pub(crate) model: State,
    /// State of each stage of the sensors, then of the actuators, then of both directions of a bus.
    pub(crate) instruments: Vec<State>,
    pub(crate) faults: SavedFaults,
    pub(crate) tuning: SavedTuning,
    /// Words of the previous step's record, for evaluating conditions.
    pub(crate) record: Vec<u64>,
}

impl SavedPlant {
    /// Restores the state of a model that was just started.
    ///
    /// # Errors
    /// If this is not a state of the model.
    pub(crate) fn restore_model(&self, model: &mut dyn Model) -> Result<(), Invalid> {
        let retuned = model.retune(self.faults.parameters());
        retuned.map_err(|failure| Invalid(failure.to_string()))?;
        model.restore(&self.model)
    }
}
