//! What travels in a recording and tells more of its signals than their names: the scenario and
//! what plant and controller said of themselves.

use std::collections::BTreeMap;

use hil_config::expression::Columns;
use hil_config::plan::{self, Plan};
use shared_types::describe::{Description, LawDescription, PlantDescription};

use super::table::Column;
use crate::programs::checked::checked;
use crate::recording::reader::RunReader;
use crate::recording::validity;
use crate::results::evaluation::RecordedEvaluation;

/// The scenario of a run with its plant and its law.
pub(super) struct Origin {
    plan: Plan,
    plant: PlantDescription,
    law: LawDescription,
}

impl Origin {
    /// Takes them from a recording; the error says why that cannot be.
    pub(super) fn of(reader: &RunReader) -> Result<Self, String> {
        let read = || -> Result<_, crate::recording::reader::ReadError> {
            let plant: Description = reader.enclosed("plant-description.json")?;
            let controller: Description = reader.enclosed("controller-description.json")?;
            Ok((reader.enclosure("scenario.toml")?, plant, controller))
        };
        let (text, plant, controller) = read().map_err(|error| error.to_string())?;
        let plan = checked(text, reader.path(), &plant, &controller);
        let plan = plan.map_err(|failure| failure.to_string())?;
        // A scenario is checked only if both are there.
        let plant = plan.plant_among(&plant.plants).cloned();
        let law = plan.law_among(&controller.laws).cloned();
        let (Some(plant), Some(law)) = (plant, law) else {
            return Err("the recording does not describe its plant and law".into());
        };
        Ok(Self { plan, plant, law })
    }

    /// The commands of a command frame, in order, as the recording names them.
    pub(super) fn sent_commands(&self) -> Vec<String> {
        validity::sent_commands(&self.plant, &self.law)
    }

    /// The derived signals of the scenario, in its order.
    pub(super) fn derived(mut self, reader: &RunReader) -> Result<Derived, String> {
        let columns = Columns::of(&self.plant, &self.plan.stimuli, &self.law.internals);
        let recorded = reader.columns();
        let first = recorded.iter().position(|column| column.is_signal());
        let signals = recorded.iter().filter(|column| column.is_signal()).count();
        // They stand side by side, in the order of the columns.
        let (Some(first), true) = (first, signals == columns.len()) else {
            return Err("its signals are not those of its scenario".into());
        };
        self.plan.metrics.clear();
        self.plan.analyses.clear();
        self.plan.requirements.clear();
        let evaluation =
            RecordedEvaluation::new(reader, &self.plan, &columns, first..first + signals);
        Ok(Derived {
            evaluation: evaluation.map_err(|error| error.to_string())?,
            signals: self.plan.derived,
        })
    }
}

/// The derived signals of a run, computed again from its records.
pub(super) struct Derived {
    pub(super) signals: Vec<plan::Derived>,
    evaluation: RecordedEvaluation,
}

impl Derived {
    /// Their values at the step of a record.
    pub(super) fn of(&mut self, record: &[u64]) -> &[f64] {
        self.evaluation.observe(record)
    }
}

/// Where a table comes from and the units of its columns, for the metadata of a file.
pub(super) fn metadata(reader: &RunReader, columns: &[Column]) -> Vec<(String, String)> {
    let with_unit = columns.iter().filter(|column| !column.unit.is_empty());
    let units: BTreeMap<&str, &str> = with_unit
        .map(|column| (column.name.as_str(), column.unit.as_str()))
        .collect();
    let facts = [
        ("scenario", "hil.scenario"),
        ("session", "hil.session"),
        ("started_utc", "hil.started_utc"),
        ("evidence", "hil.evidence"),
        ("rate_hz", "hil.rate_hz"),
        ("seed", "hil.seed"),
        ("hil_commit", "hil.commit"),
        ("plant_blake3", "hil.plant_blake3"),
        ("controller_blake3", "hil.controller_blake3"),
    ];
    let facts = facts
        .into_iter()
        .filter_map(|(fact, key)| Some((key.to_owned(), reader.fact(fact)?.to_owned())));
    let mut metadata: Vec<(String, String)> = facts.collect();
    metadata.push(("hil.digest".into(), reader.digest()));
    metadata.push(("hil.whole".into(), reader.is_whole().to_string()));
    metadata.push(("units".into(), serde_json::json!(units).to_string()));
    metadata
}
