//! State of the plant's process in a checkpoint: the model, its instruments and faults, and the last record.
//!
//! The engine saves it before a step, when everything of the steps before was told to observers, and
//! begins with it in a run that goes on. What is not here follows from the job and the step: the
//! reference signals, and every row that a step writes before it reads it.

use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::state::State;

use crate::faults::SavedFaults;
use crate::plant::Model;
use crate::tuning::SavedTuning;

/// The plant's state before a step.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SavedPlant {
    pub(crate) model: State,
    /// Of each stage of the sensors, then of the actuators.
    pub(crate) instruments: Vec<State>,
    pub(crate) faults: SavedFaults,
    pub(crate) tuning: SavedTuning,
    /// The words of the record of the step before, which conditions are asked of.
    pub(crate) record: Vec<u64>,
}

impl SavedPlant {
    /// Brings a model that was just started to where it was.
    ///
    /// # Errors
    /// If this is not a state of it.
    pub(crate) fn restore_model(&self, model: &mut dyn Model) -> Result<(), Invalid> {
        let retuned = model.retune(self.faults.parameters());
        retuned.map_err(|failure| Invalid(failure.to_string()))?;
        model.restore(&self.model)
    }
}
