//! Inputs of the model that the scenario drives: their places among its commands.
//!
//! Owned by the engine. The controller commands the others; the model gets one row of all of them. Without driven
//! inputs that row is the applied commands themselves, and nothing is copied.

use hil_config::plan::driven;
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::table::Field;

use crate::guard::Guard;
use crate::job::Job;

/// Command row of a model, joined from commands and driven inputs.
#[derive(Debug)]
pub(crate) struct InputRow {
    /// Ranges of the inputs with a course.
    pub(crate) guard: Guard,
    /// Every command of the model; empty if the scenario drives none.
    row: Vec<f64>,
    /// Index in the row of each command of the controller.
    commands: Vec<usize>,
    /// Index in the row of each input with a course.
    driven: Vec<usize>,
}

impl InputRow {
    /// Creates the row of a plant, described with all its commands, for a job.
    ///
    /// # Errors
    /// If the job drives an input that the plant does not have.
    pub(crate) fn new(plant: &PlantDescription, job: &Job) -> Result<Self, Invalid> {
        let place = |name: &str| {
            let place = plant.commands.iter().position(|field| field.name == name);
            place.ok_or_else(|| Invalid(format!("plant `{}` has no input `{name}`", plant.name)))
        };
        let inputs = driven(&job.stimuli);
        let driven: Vec<usize> = { inputs.iter() }
            .map(|field| place(&field.name))
            .collect::<Result<_, _>>()?;
        let constants = job.plant.inputs.0.iter();
        let constants: Vec<(usize, f64)> = constants
            .map(|(name, value)| Ok((place(name)?, value.0)))
            .collect::<Result<_, Invalid>>()?;
        let is_commanded = |place: &usize| {
            !driven.contains(place) && { constants.iter() }.all(|(other, _)| other != place)
        };
        let ranges: Vec<Field> = { driven.iter() }
            .map(|place| plant.commands[*place].clone())
            .collect();
        let mut row = Vec::new();
        if !(driven.is_empty() && constants.is_empty()) {
            row = vec![0.0; plant.commands.len()];
        }
        for (place, value) in &constants {
            row[*place] = *value;
        }
        Ok(Self {
            guard: Guard::new(&ranges, &[])?,
            row,
            commands: (0..plant.commands.len()).filter(is_commanded).collect(),
            driven,
        })
    }

    /// Puts the applied commands and the inputs of a step into the row.
    #[inline]
    pub(crate) fn join(&mut self, applied: &[f64], inputs: &[f64]) {
        if self.row.is_empty() {
            return;
        }
        let places = self.commands.iter().chain(&self.driven);
        for (place, value) in places.zip(applied.iter().chain(inputs)) {
            self.row[*place] = *value;
        }
    }

    /// Returns the joined row.
    #[inline]
    pub(crate) fn joined<'r>(&'r self, applied: &'r [f64]) -> &'r [f64] {
        match self.row.is_empty() {
            true => applied,
            false => &self.row,
        }
    }
}
