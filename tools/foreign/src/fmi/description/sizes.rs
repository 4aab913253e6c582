//! Array sizes, some of which are structural parameters, and the sizes that a scenario chooses.

use std::collections::BTreeMap;

use shared_types::table::listed;

use super::tree::Element;
use super::{Causality, DescriptionError, Variable};

/// Maximum number of elements of an array.
const MOST_ELEMENTS: usize = 65_536;

/// Sets the values of structural parameters.
///
/// # Errors
/// If a parameter does not exist, or a value is outside its range.
pub(super) fn resize(
    variables: &mut [Variable],
    sizes: &BTreeMap<String, u64>,
) -> Result<(), DescriptionError> {
    let mut before: BTreeMap<u32, (&str, u64)> = BTreeMap::new();
    for (name, &size) in sizes {
        let is_structural = |one: &&Variable| one.causality == Causality::StructuralParameter;
        let known: Vec<String> = (variables.iter().filter(is_structural))
            .map(|one| one.name.clone())
            .collect();
        let place = variables
            .iter()
            .position(|one| is_structural(&one) && one.name == *name);
        let Some(place) = place else {
            let existing = match &known[..] {
                [] => "it has none".to_owned(),
                known => format!("it has {}", listed(known)),
            };
            return Err(DescriptionError::Unsupported(format!(
                "`structural.{name}` is not a structural parameter of the FMU; {existing}"
            )));
        };
        let variable = &variables[place];
        let (min, max) = variable.bounds();
        let min = if min > 0.0 { min } else { 0.0 };
        #[expect(clippy::cast_precision_loss, reason = "larger ones are out of range")]
        let value = size as f64;
        if !(min..=max).contains(&value) {
            return Err(DescriptionError::Unsupported(format!(
                "`structural.{name}` is {size}; expected {min} to {max}"
            )));
        }
        let reference = variable.reference;
        let other = before.insert(reference, (name, size));
        if let Some((other, value)) = other.filter(|(_, value)| *value != size) {
            return Err(DescriptionError::Unsupported(format!(
                "`structural.{other}` is {value} and `structural.{name}` is {size}, but both name the same variable"
            )));
        }
        // Set under each of its names, because a dimension uses the first variable with the reference.
        let aliases = variables.iter_mut().filter(|one| {
            one.causality == Causality::StructuralParameter && one.reference == reference
        });
        aliases.for_each(|one| one.start = vec![value]);
    }
    Ok(())
}

/// Determines the sizes of an array, some of which are start values of structural parameters.
pub(super) fn dimensions(
    sizes: &[&Element],
    starts: &BTreeMap<u32, f64>,
) -> Result<Vec<usize>, DescriptionError> {
    let mut dimensions = Vec::new();
    let mut elements = 1_usize;
    for size in sizes {
        let fixed: Option<usize> = size.value("start")?;
        let reference: Option<u32> = size.value("valueReference")?;
        let named = reference.and_then(|reference| starts.get(&reference));
        let size = match (fixed, named) {
            (Some(fixed), _) => fixed,
            (None, Some(&value)) if (0.0..=1e9).contains(&value) => {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "in range"
                )]
                let size = value as usize;
                size
            }
            _ => return Err(size.wrong("size", "is not known")),
        };
        elements = elements.saturating_mul(size);
        if elements > MOST_ELEMENTS {
            return Err(DescriptionError::Unsupported(format!(
                "one of its arrays has more than {MOST_ELEMENTS} elements"
            )));
        }
        dimensions.push(size);
    }
    Ok(dimensions)
}
