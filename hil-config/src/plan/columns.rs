//! The columns of a record, by the plant and the stimuli of a plan.

use shared_types::describe::PlantDescription;
use shared_types::table::Field;

use super::Stimulus;
use crate::expression::{Columns, Group};

impl Columns {
    /// The columns of a record of this plant and stimuli and a law that shows these internals.
    #[must_use]
    pub fn of(plant: &PlantDescription, stimuli: &[Stimulus], internals: &[Field]) -> Self {
        let mut columns = Self::default();
        columns.push_fields(Group::Truth, &plant.truth);
        columns.push_fields(Group::Measured, &plant.measured);
        for stimulus in stimuli {
            columns.push_fields(Group::Reference, &stimulus.fields());
        }
        columns.push_fields(Group::Command, &plant.commands);
        columns.push_fields(Group::Applied, &plant.commands);
        columns.push_fields(Group::Internal, internals);
        columns.push_fields(Group::Sensed, &plant.measured);
        for stimulus in stimuli {
            columns.push_fields(Group::Stimulus, &stimulus.fields());
        }
        let faultable = plant.parameters.iter().filter(|field| field.faultable);
        for field in faultable {
            columns.push_with_unit(Group::Parameter, &field.name, &field.unit);
        }
        columns
    }
}
