//! The law's answer to `--linearise`: its map at a point, on the named numbers of its state.
//!
//! Called by the program in place of a run. The law alone: no link, no delay and no held command, and every signal of
//! the sample counts as valid and new.

use shared_types::checkpoint::Saves;
use shared_types::describe::Invalid;
use shared_types::local_map::{Columns, LocalMap, Question, changed};
use shared_types::quality::{Quality, SignalSet};
use shared_types::side::Side;
use shared_types::state::State;
use shared_types::table::Field;

use super::saved::SavedController;
use super::tuning::Tuning;
use super::{period_s, start};
use crate::controller::{Answer, Law, LawKind, Row};
use crate::job::Job;

/// Answers a question about a law; writes the controller's state at the point where the job saves one.
///
/// # Errors
/// If the state has no named numbers, the law does not start, or there is no linear model at the point.
pub(crate) fn answer(kind: &LawKind, question: &Question<Job>) -> Result<LocalMap, Invalid> {
    let Question { job, step, .. } = question;
    let (described, name) = (&kind.description, &kind.description.name);
    let commands = described.commands.as_deref().unwrap_or(&question.commands);
    let mut law = start(kind, job, commands)?;
    let saved: Option<SavedController> = { job.checkpoints.resume.as_ref() }
        .map(|resume| resume.read(name))
        .transpose()?;
    if let Some(saved) = &saved {
        let mut tuning = Tuning::new(described, &job.parameters, &job.model, period_s(job));
        tuning.restore(&saved.tuning, law.as_mut())?;
        law.restore(&saved.law)?;
    }
    let sampled = [
        named("measured", &described.measured),
        named("reference", &described.reference),
    ]
    .concat();
    let inputs = question.inputs.row(&sampled, "inputs")?;
    let Some(states) = described.state.as_deref() else {
        let map = law.differentiated(&inputs, period_s(job));
        return map.map_err(|reason| Invalid(format!("law `{name}`: {reason}")));
    };
    let bytes = law.save()?;
    let numbers = changed(states, &law.numbers()?, &question.state)?;
    if let Some(mut saved) = saved.filter(|_| !job.checkpoints.steps.is_empty()) {
        law.set_numbers(&numbers)?;
        saved.law = law.save()?;
        let mut saves = Saves::new(Side::Controller, name, job.checkpoints.clone());
        saves.write(*step, &saved).map_err(Invalid)?;
    }
    let columns = Columns {
        states,
        inputs: &sampled,
        outputs: commands,
    };
    let lengths = (described.measured.len(), described.internals.len());
    let time_s = job.rate.seconds(*step);
    let mut map = |point: &[f64]| {
        let (numbers, inputs) = point.split_at(states.len());
        let command = answered(
            law.as_mut(),
            &bytes,
            numbers,
            inputs,
            time_s,
            lengths,
            commands,
        );
        let command = command?;
        Ok([law.numbers()?, command].concat())
    };
    let point = [numbers, inputs].concat();
    let point = (&point[..], question.passes_kinks);
    LocalMap::at(columns, period_s(job), point, &mut map)
}

/// Returns fields named with their group: a reference may have the name of a measured signal.
fn named(group: &str, fields: &[Field]) -> Vec<Field> {
    let with_group = |field: &Field| Field {
        name: format!("{group}.{}", field.name),
        ..field.clone()
    };
    fields.iter().map(with_group).collect()
}

/// Answers one sample from a state, and returns the commands.
fn answered(
    law: &mut dyn Law,
    bytes: &State,
    numbers: &[f64],
    inputs: &[f64],
    time_s: f64,
    (measured, internals): (usize, usize),
    commands: &[Field],
) -> Result<Vec<f64>, Invalid> {
    law.restore(bytes)?;
    law.set_numbers(numbers)?;
    let (measured, reference) = inputs.split_at(measured);
    let row = Row {
        time_s,
        measured,
        reference,
        valid: true,
        held_steps: 0,
    };
    let quality = Quality {
        measured: &SignalSet::EMPTY,
        reference: &SignalSet::EMPTY,
        age_steps: &vec![0; measured.len()],
    };
    let (mut command, mut internals) = (vec![0.0; commands.len()], vec![0.0; internals]);
    let mut held = SignalSet::EMPTY;
    let answer = Answer {
        command: &mut command,
        internals: &mut internals,
        held: &mut held,
    };
    (law.answer(&row, &quality, answer)).map_err(|failure| Invalid(failure.to_string()))?;
    match commands
        .iter()
        .enumerate()
        .find(|(place, _)| held.contains(*place))
    {
        None => Ok(command),
        Some((_, field)) => Err(Invalid(format!(
            "the law does not refresh its command `{}` at this sample",
            field.name
        ))),
    }
}
