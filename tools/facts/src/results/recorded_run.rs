//! Recorded run reconstructed from its recording: both programs, the scenario, its plan and the indices of its
//! signals.
//!
//! Created by all readers that need more of a recording than its columns. Needs none of the programs on this machine,
//! and reads no records.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use hil_config::expression::{Columns, Group};
use hil_config::plan::Plan;
use hil_config::scenario::read_regular;
use hil_console::terminal::exit::Failure;
use hil_recording::reader::RunReader;
use hil_recording::schema::column_name;
use shared_types::describe::{Description, LawDescription, PlantDescription};
use shared_types::layout::SignalKind;
use shared_types::number::exact_in;
use shared_types::record::Validity;
use shared_types::table::Field;

use crate::programs::checked::checked;
use crate::results::evaluation::RecordEvaluation;
use crate::results::held_commands::HeldCommands;

/// A recorded run.
pub struct RecordedRun {
    /// Answer of the run's plant program to `--describe`.
    pub plant_program: Description,
    /// Answer of the run's controller program.
    pub controller_program: Description,
    /// Description of the plant.
    pub plant: PlantDescription,
    /// Law with the signal names used on the link.
    pub law: LawDescription,
    /// Plan that the run followed.
    pub plan: Plan,
}

/// Spells a name as recordings do.
fn recorded(name: &str) -> String {
    match name.split_once('.') {
        Some((group, name)) => column_name(group, name),
        None => name.into(),
    }
}

impl RecordedRun {
    /// Returns the aliases of the run's signals, each with the recorded name.
    pub fn aliases(&self) -> Vec<(String, String)> {
        let layout = self.plan.record_layout(&self.plant, &self.law);
        let aliases = Columns::from(&layout).aliases().into_iter();
        aliases
            .map(|(alias, name)| (alias, recorded(&name)))
            .collect()
    }

    /// Returns the recorded name of a signal, given that name or an alias.
    #[must_use]
    pub fn own_name(reader: &RunReader, name: &str) -> String {
        let spelt = recorded(name);
        for name in [name, &spelt] {
            if reader.place(name).is_some() {
                return name.into();
            }
        }
        // A recording of another program has no further names.
        let run = Self::of(reader, reader.path());
        let mut aliases = run.map(|run| run.aliases()).unwrap_or_default().into_iter();
        let own = aliases.find(|(alias, _)| alias == name || recorded(alias) == name);
        own.map_or_else(|| name.into(), |(_, own)| own)
    }

    /// Reads a run from its recording; problems of its scenario name `origin`.
    ///
    /// # Errors
    /// If a part of the run is missing from the recording or invalid.
    pub fn of(reader: &RunReader, origin: &Path) -> Result<Self, Failure> {
        Self::planned(reader, |text, plant, controller| {
            checked(text, origin, plant, controller)
        })
    }

    /// Reads a run from its recording, with a plan made from its scenario and both descriptions.
    ///
    /// # Errors
    /// If a part of the run is missing from the recording; also the errors of the plan.
    pub fn planned(
        reader: &RunReader,
        plan: impl FnOnce(&str, &Description, &Description) -> Result<Plan, Failure>,
    ) -> Result<Self, Failure> {
        let description = |name| reader.attached::<Description>(name).map_err(Failure::usage);
        let plant_program = description("plant-description.json")?;
        let controller_program = description("controller-description.json")?;
        let text = reader.attachment("scenario.toml").map_err(Failure::usage)?;
        let plan = plan(text, &plant_program, &controller_program)?;
        let plant = plan.plant_among(&plant_program.plants);
        let law = plan.law_among(&controller_program.laws);
        // A scenario can be checked only with both descriptions.
        let (Some(plant), Some(law)) = (plant, law) else {
            let path = reader.path().display();
            return Err(Failure::usage(format!(
                "{path} does not describe both its plant and its law"
            )));
        };
        Ok(Self {
            plant_program,
            controller_program,
            plant,
            law,
            plan,
        })
    }

    /// Replaces the computed signals, and everything that judges the run, by those of another scenario.
    ///
    /// # Errors
    /// If the scenario cannot be read, or does not fit the run.
    pub fn judged_by(mut self, other: &Path) -> Result<Self, Failure> {
        let path_text = other.display();
        let text = read_regular(other)
            .map_err(|error| Failure::usage(format!("cannot read {path_text}: {error}")))?;
        let other = checked(&text, other, &self.plant_program, &self.controller_program)?;
        let (rate, others) = (self.plan.run.rate, other.run.rate);
        if rate != others {
            return Err(Failure::usage(format!(
                "{path_text} runs at {} but the run at {}, so their steps differ in time",
                exact_in(others.hz(), "Hz"),
                exact_in(rate.hz(), "Hz")
            )));
        }
        self.plan = Plan {
            name: other.name,
            derived: other.derived,
            metrics: other.metrics,
            analyses: other.analyses,
            requirements: other.requirements,
            plots: other.plots,
            further_plots: other.further_plots,
            ..self.plan
        };
        Ok(self)
    }

    /// Returns the names of the signals in the run's records, and their range among the words.
    ///
    /// # Errors
    /// If a signal belongs to an unknown group.
    pub fn columns(&self, reader: &RunReader) -> Result<(Columns, Range<usize>), String> {
        // A flag may have recorded more inputs of instruments than the scenario names.
        let mut plan = self.plan.clone();
        plan.tap(&self.plant, |_| true);
        let layout = plan.record_layout(&self.plant, &self.law);
        let groups = Group::ALL.iter().zip(layout.groups());
        let names: BTreeMap<String, &Field> = groups
            .flat_map(|(group, fields)| fields.iter().map(move |field| (group, field)))
            .map(|(group, field)| (column_name(group.prefix(), &field.name), field))
            .collect();
        let mut columns = Columns::default();
        let words = reader.columns();
        let first = words.iter().position(|word| word.is_signal()).unwrap_or(0);
        for word in words[first..].iter().take_while(|word| word.is_signal()) {
            let (prefix, name) = word.name.split_once('.').unwrap_or_default();
            let group = (Group::ALL.into_iter()).find(|group| group.prefix() == prefix);
            let group =
                group.ok_or_else(|| format!("the recording has an unknown group `{prefix}`"))?;
            let field = names.get(word.name.as_str());
            columns.push(group, field.map_or(name, |field| &field.name));
        }
        let places = first..first + columns.len();
        Ok((columns, places))
    }

    /// Lists the commands of the run's command frames in order, by their recorded names.
    pub fn sent_commands(&self) -> Vec<String> {
        let name = |field: &Field| column_name("command", &field.name);
        let sent = self.law.sent_commands(&self.plant).iter();
        sent.map(name).collect()
    }

    /// Starts the evaluation of a plan over the run's records.
    ///
    /// # Errors
    /// If the plan does not fit the run's signals.
    pub fn evaluation(&self, reader: &RunReader, plan: &Plan) -> Result<RecordEvaluation, String> {
        let (columns, places) = self.columns(reader)?;
        let evaluation = RecordEvaluation::new(plan, &columns, places, self.validity(reader));
        evaluation.map_err(|error| error.to_string())
    }

    /// Returns the counts of held commands before the first record.
    #[must_use]
    pub fn held_commands(&self, reader: &RunReader) -> HeldCommands {
        let layout = self.plan.record_layout(&self.plant, &self.law);
        let names: Vec<String> = layout
            .command
            .iter()
            .map(|field| field.name.clone())
            .collect();
        let sent = self.sent_commands();
        let prefix = SignalKind::Command.prefix();
        let bits = names.iter().enumerate().filter_map(|(index, name)| {
            let (word, bit) = reader.invalid_bit(&format!("{prefix}.{name}"), &sent)?;
            Some((word, bit, index))
        });
        let validity = Validity::new(bits);
        HeldCommands::new(names, validity)
    }

    /// Finds the validity bits of the run's signals, counted from the first signal.
    #[must_use]
    pub fn validity(&self, reader: &RunReader) -> Validity {
        let sent = self.sent_commands();
        let signals = reader.columns().iter().filter(|column| column.is_signal());
        Validity::new((0..).zip(signals).filter_map(|(number, column)| {
            let (word, bit) = reader.invalid_bit(&column.name, &sent)?;
            Some((word, bit, number))
        }))
    }
}
