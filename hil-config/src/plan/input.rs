//! Inputs of the plant that the scenario drives and no law commands: an ambient temperature, a load torque, wind.
//!
//! A constant stands in [`PlantPlan::inputs`], an input with a course is a [`Stimulus`]. Controller and records see the
//! plant without these commands; an input with a course is recorded in the group `input`.

use shared_types::describe::PlantDescription;
use shared_types::table::Field;

use super::{PlantPlan, Stimulus};

/// Prefix of a stimulus' target that is an input of the plant.
pub(crate) const PLANT_TARGET: &str = "plant.";

impl Stimulus {
    /// Returns the name of the plant's input that it drives; `None` for a reference signal.
    #[must_use]
    pub fn input(&self) -> Option<&str> {
        self.target.strip_prefix(PLANT_TARGET)
    }

    /// Returns the recorded signal of the input that it drives; `None` for a reference signal.
    #[must_use]
    pub fn input_field(&self) -> Option<Field> {
        Some(Field {
            aliases: self.aliases.clone(),
            ..Field::signal(
                self.input()?,
                &self.unit,
                "Input of the plant, driven by the scenario.",
            )
        })
    }
}

/// Lists the inputs that these stimuli drive, in order.
#[must_use]
pub fn driven(stimuli: &[Stimulus]) -> Vec<Field> {
    stimuli.iter().filter_map(Stimulus::input_field).collect()
}

impl PlantPlan {
    /// Returns the plant as its controller and its records see it: without the commands that the scenario drives.
    #[must_use]
    pub fn commanded(&self, plant: &PlantDescription, stimuli: &[Stimulus]) -> PlantDescription {
        let is_driven = |field: &Field| {
            self.inputs.get(&field.name).is_some() || { stimuli.iter() }
                .any(|one| one.input() == Some(&field.name))
        };
        let mut plant = plant.clone();
        plant.commands.retain(|field| !is_driven(field));
        plant
    }
}
