//! Records of a run according to its plan: the matching descriptions, and the resulting signals.

use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::record::RecordLayout;
use shared_types::table::Field;

use super::{Plan, Stimulus};
use crate::expression::Columns;

impl Plan {
    /// Selects the plan's plant from these descriptions.
    #[must_use]
    pub fn plant_among<'d>(&self, plants: &'d [PlantDescription]) -> Option<&'d PlantDescription> {
        plants.iter().find(|plant| plant.name == self.plant.model)
    }

    /// Selects the plan's law from these descriptions, by name and plant, and returns it as seen on the wire: with its
    /// signals as the plan [connects](shared_types::connection::Connection) them.
    #[must_use]
    pub fn law_among(&self, laws: &[LawDescription]) -> Option<LawDescription> {
        let plan = &self.controller;
        let is_it = |law: &&LawDescription| law.name == plan.law && law.suits(&plan.made_for);
        laws.iter().find(is_it)?.connected(&plan.connections).ok()
    }

    /// Lists the reference signals, in order.
    #[must_use]
    pub fn reference(&self) -> Vec<Field> {
        self.stimuli.iter().flat_map(Stimulus::fields).collect()
    }

    /// Returns each derived signal's name and the text of its expression.
    #[must_use]
    pub fn derived_texts(&self) -> Vec<(String, String)> {
        (self.derived.iter())
            .map(|derived| (derived.name.clone(), derived.expression.to_string()))
            .collect()
    }

    /// Drops everything except the sources of its signals.
    #[must_use]
    pub fn without_judgement(self) -> Self {
        Self {
            metrics: Vec::new(),
            analyses: Vec::new(),
            requirements: Vec::new(),
            ..self
        }
    }

    /// Returns the record layout of a run of its plant and its law as seen on the wire.
    #[must_use]
    pub fn record_layout(&self, plant: &PlantDescription, law: &LawDescription) -> RecordLayout {
        let command = SignalTable::of(SignalKind::Command, law.sent_commands(plant))
            .and(SignalKind::Internal, &law.internals);
        let [sensor, actuator] = self.tap_fields(plant);
        RecordLayout {
            sensor,
            actuator,
            ..RecordLayout::of(plant, self.reference(), &command)
        }
    }
}

impl Columns {
    /// Names the columns of a record of this plant, these stimuli and a law with these internal signals.
    #[must_use]
    pub fn of(plant: &PlantDescription, stimuli: &[Stimulus], internals: &[Field]) -> Self {
        let reference = stimuli.iter().flat_map(Stimulus::fields).collect();
        let internals = SignalTable::of(SignalKind::Internal, internals);
        Self::from(&RecordLayout::of(plant, reference, &internals))
    }
}
