//! Questions to the programs of a point about their maps. Answers nothing itself.

use std::path::Path;

use controller_process::job::Job as LawJob;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::checkpoint::state_file;
use hil_facts::programs::binaries::Binary;
use hil_run::jobs;
use plant_process::job::Job as PlantJob;
use serde::Serialize;
use shared_types::checkpoint::{Checkpoints, Resume};
use shared_types::describe::{LawDescription, PlantDescription, Settings};
use shared_types::local_map::{LocalMap, Question};
use shared_types::side::Side;
use shared_types::time::Step;

use crate::point::Point;

/// Session number in jobs that no session runs.
const NO_SESSION: u64 = 0;

/// Asker of both programs at a point.
pub(crate) struct Asker<'a> {
    /// The point.
    pub(crate) point: &'a Point,
    /// Folder for question files.
    pub(crate) folder: &'a Path,
    /// Signals that end the command early.
    pub(crate) interruption: &'a Interruption,
}

/// Values that differ from those of the point, and where a side writes its state.
#[derive(Default)]
pub(crate) struct Changed<'a> {
    /// Rows of the state.
    pub(crate) state: Settings,
    /// Folder for the state.
    pub(crate) save: Option<&'a Path>,
    /// `true` if the derivatives only lead an iteration.
    pub(crate) passes_kinks: bool,
    /// Steps between the point and the period that is evaluated.
    pub(crate) later_steps: u64,
}

impl Asker<'_> {
    /// Returns the plant of the point, with all its commands.
    ///
    /// # Errors
    /// If the program has no such plant.
    pub(crate) fn plant(&self) -> Result<&PlantDescription, Failure> {
        let (plants, ..) = self.point.binaries.described();
        let model = &self.point.plan.plant.model;
        let plant = plants.iter().find(|plant| plant.name == *model);
        plant.ok_or_else(|| Failure::infrastructure(format!("there is no plant `{model}`")))
    }

    /// Returns the law of the point.
    ///
    /// # Errors
    /// If the program has no such law.
    pub(crate) fn law(&self) -> Result<LawDescription, Failure> {
        let (_, laws, _) = self.point.binaries.described();
        let law = self.point.plan.law_among(laws);
        law.ok_or_else(|| Failure::infrastructure("the law is missing in its program"))
    }

    /// Asks the plant for its map with these inputs.
    ///
    /// # Errors
    /// If the plant refuses; the error has its reason.
    pub(crate) fn ask_plant(
        &self,
        inputs: &Settings,
        changed: &Changed<'_>,
    ) -> Result<LocalMap, Failure> {
        let plan = &self.point.plan;
        let job = PlantJob {
            checkpoints: self.checkpoints(Side::Plant, changed),
            ..PlantJob::of(plan, NO_SESSION, f64::INFINITY)
        };
        let question = Question {
            job,
            step: Step(self.point.step.0 + changed.later_steps),
            state: changed.state.clone(),
            inputs: inputs.clone(),
            passes_kinks: changed.passes_kinks,
            commands: Vec::new(),
        };
        self.ask(&self.point.binaries.plant, &question)
    }

    /// Asks the law for its map with this sample.
    ///
    /// # Errors
    /// If the law refuses; the error has its reason.
    pub(crate) fn ask_law(
        &self,
        sample: &Settings,
        changed: &Changed<'_>,
    ) -> Result<LocalMap, Failure> {
        let plan = &self.point.plan;
        let job = LawJob {
            checkpoints: self.checkpoints(Side::Controller, changed),
            ..jobs::controller(plan, NO_SESSION, f64::INFINITY)
        };
        let commanded = plan.plant.commanded(self.plant()?, &plan.stimuli);
        let question = Question {
            job,
            step: self.point.step,
            state: changed.state.clone(),
            inputs: sample.clone(),
            passes_kinks: changed.passes_kinks,
            commands: commanded.commands,
        };
        self.ask(&self.point.binaries.controller, &question)
    }

    fn ask<J: Serialize>(
        &self,
        binary: &Binary,
        question: &Question<J>,
    ) -> Result<LocalMap, Failure> {
        let path = self.folder.join("question.json");
        let text = serde_json::to_string(question).map_err(Failure::infrastructure)?;
        std::fs::write(&path, text).map_err(|error| {
            Failure::infrastructure(format!("cannot write {}: {error}", path.display()))
        })?;
        binary.local_map(&path, self.interruption)
    }

    fn checkpoints(&self, side: Side, changed: &Changed<'_>) -> Checkpoints {
        let step = self.point.step;
        let folder = self.point.checkpoint.as_ref();
        Checkpoints {
            steps: changed.save.map(|_| step).into_iter().collect(),
            folder: changed.save.map(Into::into).unwrap_or_default(),
            resume: folder.map(|folder| Resume {
                step,
                state: folder.join(state_file(side)),
                memory: None,
            }),
        }
    }
}
