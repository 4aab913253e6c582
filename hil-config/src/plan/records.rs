//! Records of a run according to its plan: the matching descriptions, and the resulting signals.

use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::record::RecordLayout;
use shared_types::table::Field;

use super::{Definition, DerivedSource, Plan, Stimulus, driven};
use crate::expression::Columns;
use crate::table::Table;

impl Plan {
    /// Selects the plan's plant from these descriptions and returns it as its controller and its records see it:
    /// without the commands that the scenario drives.
    #[must_use]
    pub fn plant_among(&self, plants: &[PlantDescription]) -> Option<PlantDescription> {
        let plant = self.whole_plant_among(plants)?;
        Some(self.plant.commanded(plant, &self.stimuli))
    }

    /// Selects the plan's plant from these descriptions.
    #[must_use]
    pub fn whole_plant_among<'d>(
        &self,
        plants: &'d [PlantDescription],
    ) -> Option<&'d PlantDescription> {
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

    /// Returns each derived signal's name and definition.
    #[must_use]
    pub fn definitions(&self) -> Vec<(String, Definition)> {
        (self.derived.iter())
            .map(|derived| (derived.name.clone(), derived.source.definition()))
            .collect()
    }

    /// Returns every table over time: of stimuli and of derived signals.
    pub fn tables_mut(&mut self) -> impl Iterator<Item = &mut Table> {
        let stimuli = (self.stimuli.iter_mut()).flat_map(|one| one.waveform.tables_mut());
        let derived = (self.derived.iter_mut()).filter_map(|one| match &mut one.source {
            DerivedSource::Table(table) => Some(table),
            DerivedSource::Expression(_) => None,
        });
        stimuli.chain(derived)
    }

    /// Drops everything except the sources of the plan's signals.
    #[must_use]
    pub fn without_judgement(self) -> Self {
        Self {
            metrics: Vec::new(),
            analyses: Vec::new(),
            requirements: Vec::new(),
            ..self
        }
    }

    /// Returns the record layout of a run of this plan with this plant and law, both as seen on the wire.
    #[must_use]
    pub fn record_layout(&self, plant: &PlantDescription, law: &LawDescription) -> RecordLayout {
        let command = SignalTable::of(SignalKind::Command, law.sent_commands(plant))
            .and(SignalKind::Internal, &law.internals);
        let [sensor, actuator] = self.tap_fields(plant);
        RecordLayout {
            sensor,
            actuator,
            ..RecordLayout::of(plant, self.reference(), &command).with_inputs(driven(&self.stimuli))
        }
    }
}

impl Columns {
    /// Names the columns of a record of this plant without its driven inputs, these stimuli and a law with these internal signals.
    #[must_use]
    pub fn of(plant: &PlantDescription, stimuli: &[Stimulus], internals: &[Field]) -> Self {
        let reference = stimuli.iter().flat_map(Stimulus::fields).collect();
        let internals = SignalTable::of(SignalKind::Internal, internals);
        let layout = RecordLayout::of(plant, reference, &internals);
        Self::from(&layout.with_inputs(driven(stimuli)))
    }
}
