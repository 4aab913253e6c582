//! Sizes of arrays that a scenario chooses: structural parameters in place of their start values.

use std::collections::BTreeMap;

use shared_types::table::listed;

use super::{Causality, DescriptionError, Variable};

/// Gives structural parameters these values.
///
/// # Errors
/// If there is none of a name, or a value is outside its range.
pub(super) fn resize(
    variables: &mut [Variable],
    sizes: &BTreeMap<String, u64>,
) -> Result<(), DescriptionError> {
    for (name, &size) in sizes {
        let is_structural = |one: &&Variable| one.causality == Causality::StructuralParameter;
        let known: Vec<String> = (variables.iter().filter(is_structural))
            .map(|one| one.name.clone())
            .collect();
        let place = variables
            .iter()
            .position(|one| is_structural(&one) && one.name == *name);
        let Some(place) = place else {
            let there = match &known[..] {
                [] => "it has none".to_owned(),
                known => format!("it has {}", listed(known)),
            };
            return Err(DescriptionError::Unsupported(format!(
                "`structural.{name}` names no structural parameter of the FMU; {there}"
            )));
        };
        let variable = &mut variables[place];
        let (_, high) = variable.kind.range().unwrap_or((0.0, 0.0));
        let min = variable.min.filter(|min| *min > 0.0).unwrap_or(0.0);
        let max = variable.max.filter(|max| *max < high).unwrap_or(high);
        #[expect(clippy::cast_precision_loss, reason = "larger ones are out of range")]
        let value = size as f64;
        if !(min..=max).contains(&value) {
            return Err(DescriptionError::Unsupported(format!(
                "`structural.{name}` is {size}; expected {min} to {max}"
            )));
        }
        variable.start = vec![value];
    }
    Ok(())
}
