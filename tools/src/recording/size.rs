//! How large a recording can get, before the run.

use hil_config::expression::Columns;
use hil_config::plan::Plan;
use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::record::Timing;

use super::excerpt::Choice;

/// Bytes of a message besides its words: its head, its encapsulation and its entry in the index.
const BESIDES: u64 = 31 + 4 + 16;

/// The largest size in bytes without compression; without what happens around faults, whose number
/// is not known.
///
/// # Errors
/// If the choice names no signal of this run.
pub fn largest(
    plan: &Plan,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    choice: &Choice,
) -> Result<u64, String> {
    let model = &plan.plant.model;
    let plant = plants.iter().find(|plant| plant.name == *model);
    let plant = plant.ok_or_else(|| format!("there is no plant `{model}`"))?;
    let law = plan.law_among(laws);
    let law =
        law.ok_or_else(|| format!("there is no law `{}` for `{model}`", plan.controller.law))?;
    let columns = Columns::of(plant, &plan.stimuli, &law.internals);
    // As recordings name them.
    let name = |path: &str| match path.split_once('.') {
        Some((group, name)) => format!("{group}.{}", name.replace('.', "_")),
        None => path.to_owned(),
    };
    let names: Vec<String> = columns.names().map(name).collect();
    let kept = choice.kept(&names)?;
    let signals = kept.iter().filter(|kept| **kept).count() as u64;
    let validity = |signals: usize| signals.div_ceil(64).max(1) as u64;
    let reference: usize = (plan.stimuli.iter()).map(|one| one.fields().len()).sum();
    let bits = validity(plant.measured.len() + reference)
        + validity(plant.commands.len() + law.internals.len());
    let words = 1 + bits + signals + Timing::WORDS as u64;
    let records = match (choice.every, choice.around_s) {
        (Some(every), _) => plan.run.steps / every + 2,
        (None, Some(_)) => 2,
        (None, None) => plan.run.steps + 1,
    };
    Ok(records * (8 * words + BESIDES))
}

/// A size as a person reads it.
#[must_use]
pub fn shown(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}
