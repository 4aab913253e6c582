//! The recorded run in the form that a replay needs: its participants and the layout of its records.
//!
//! Built from the recording alone, so the plant of the run need not be on this machine. Recordings that lack
//! part of the controller's input are refused.

use std::path::{Path, PathBuf};

use hil_config::plan::Plan;
use hil_config::scenario::Advice;
use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::Binary;
use hil_facts::programs::checked::{checked_beside, of_run};
use hil_facts::programs::scenario::kept;
use hil_facts::results::recorded_run::RecordedRun;
use hil_recording::reader::{RunReader, folder_of};
use hil_recording::schema::column_name;
use shared_types::describe::{Description, LawDescription, PlantDescription};
use shared_types::table::Field;

/// Recorded run, opened for a replay.
pub(crate) struct Original {
    pub(super) run: PathBuf,
    pub(super) plan: Plan,
    pub(super) plant: PlantDescription,
    /// Reference signals in the samples.
    pub(super) reference: Vec<Field>,
    /// Hash of the controller's binary.
    pub(super) blake3: Option<String>,
    pub(super) places: Places,
    plant_program: Description,
    scenario: String,
}

/// Word indices of values in a record.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// Validity bits of the sample and of the answer.
    pub(super) sample_invalid: Vec<usize>,
    pub(super) answer_invalid: Vec<usize>,
    /// Measured and reference signals, in the order of the sample.
    pub(super) sample: Vec<usize>,
    /// Values that the controller sent, in the order of the record.
    pub(super) answer: Vec<AnswerPlace>,
    pub(super) sample_age_steps: Option<usize>,
    pub(super) held_steps: Option<usize>,
    pub(super) answered: Option<usize>,
    pub(super) directive: Option<usize>,
    pub(super) epoch: Option<usize>,
}

/// Recorded command or internal signal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AnswerPlace {
    /// Full name, `command.x` or `internal.x`.
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) word: usize,
    /// Number of the value's own validity bit in the frame; `None` for a command, whose recorded bit reflects faults on
    /// its way to the plant.
    pub(super) bit: Option<usize>,
}

impl Original {
    /// Reads the part of a recording that precedes the records.
    ///
    /// # Errors
    /// If the recording lacks something that a replay needs.
    pub(crate) fn of(reader: &RunReader, run: &Path) -> Result<Self, Failure> {
        let mut scenario = String::new();
        let origin = format!("the scenario of {}", run.display());
        let recorded = RecordedRun::planned(reader, |text, plant, controller| {
            let document = kept(text).map_err(|error| {
                Failure::usage(format!("{}: its scenario: {error}", run.display()))
            })?;
            scenario = document.to_string();
            let folder = folder_of(run);
            checked_beside(
                folder,
                of_run(),
                &scenario,
                origin.as_ref(),
                plant,
                controller,
            )
        })?;
        let RecordedRun {
            plant_program,
            plant,
            law,
            plan,
            ..
        } = recorded;
        let reference = plan.reference();
        let places = Places::of(reader, &plant, &reference, &law)
            .map_err(|what| Failure::usage(format!("{}: {what}", run.display())))?;
        Ok(Self {
            run: run.to_owned(),
            blake3: reader.fact("controller_blake3").map(str::to_owned),
            plan,
            plant,
            reference,
            places,
            plant_program,
            scenario,
        })
    }

    /// Builds the plan for another controller, with the run's parameters and the defaults of parameters that the run
    /// did not have.
    ///
    /// # Errors
    /// If the controller has no such law for the plant, or the law lacks a parameter of the run.
    pub(super) fn plan_for(&self, controller: &Binary) -> Result<Plan, Failure> {
        let origin = format!("the scenario of {}", self.run.display());
        let advice = Advice {
            law: controller.advice("law", "--controller-bin PATH"),
            ..Advice::default()
        };
        checked_beside(
            folder_of(&self.run),
            advice,
            &self.scenario,
            origin.as_ref(),
            &self.plant_program,
            &controller.description,
        )
    }
}

impl Places {
    fn of(
        reader: &RunReader,
        plant: &PlantDescription,
        reference: &[Field],
        law: &LawDescription,
    ) -> Result<Self, String> {
        let columns = reader.columns();
        let place = |name: &str| reader.place(name);
        let bits = |group: &str| -> Vec<usize> {
            let words = (0..).map_while(|number| place(&format!("{group}[{number}]")));
            words.collect()
        };
        let mut sample = Vec::new();
        for (group, fields) in [("measured", &plant.measured[..]), ("reference", reference)] {
            for field in fields {
                let name = column_name(group, &field.name);
                let index = place(&name);
                sample.push(index.ok_or_else(|| {
                    format!("it was recorded without `{name}`; a replay needs the complete input of the controller")
                })?);
            }
        }
        let commands = law.sent_commands(plant);
        let sent: Vec<String> = (commands
            .iter()
            .map(|field| column_name("command", &field.name)))
        .chain(
            law.internals
                .iter()
                .map(|field| column_name("internal", &field.name)),
        )
        .collect();
        let answer: Vec<AnswerPlace> = (columns.iter().enumerate())
            .filter_map(|(word, column)| {
                let bit = sent.iter().position(|name| *name == column.name)?;
                let bit = (bit >= commands.len()).then_some(bit);
                Some(AnswerPlace {
                    name: column.name.clone(),
                    unit: column.unit.clone(),
                    word,
                    bit,
                })
            })
            .collect();
        if answer.is_empty() {
            return Err("it contains no output of a controller".into());
        }
        Ok(Self {
            sample_invalid: bits("sample_invalid"),
            answer_invalid: bits("command_invalid"),
            sample,
            answer,
            sample_age_steps: place("sample_age_steps"),
            held_steps: place("held_steps"),
            answered: place("answered"),
            directive: place("directive"),
            epoch: place("epoch"),
        })
    }
}
