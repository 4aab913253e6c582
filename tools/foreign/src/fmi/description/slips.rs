//! Tolerated mistakes of vendors' tools that are no reason to refuse a model: unusable parts are left out and listed.

use std::collections::BTreeMap;

use super::tree::{Element, shortened};
use super::{
    BASE_UNITS, BaseUnit, Causality, DescriptionError, Initial, UNREFERENCED, Unit, Variable,
    VariableType,
};

/// Converts a variable that cannot be read into an inner variable, which keeps its place among the others, and stores
/// the reason. A variable of an unknown role counts as inner.
///
/// # Errors
/// If the variable is not inner; the error is the reason.
pub(super) fn unusable(
    element: &Element,
    (kind, causality): (Option<VariableType>, Option<Causality>),
    number: usize,
    error: DescriptionError,
) -> Result<Variable, DescriptionError> {
    let reference = element.value("valueReference").ok().flatten();
    let variable = Variable {
        name: (element.text("name")).map_or_else(|| format!("(variable {number})"), str::to_owned),
        description: String::new(),
        reference: reference.unwrap_or(UNREFERENCED),
        // One that has no column, whatever it is.
        kind: kind.unwrap_or(VariableType::Binary),
        causality: causality.unwrap_or(Causality::Local),
        is_tunable: false,
        is_constant: false,
        is_clocked: false,
        is_resized: false,
        initial: Initial::Calculated,
        start: Vec::new(),
        items: Vec::new(),
        unusable: Some(error.clone().reason()),
        unit: None,
        is_difference: false,
        min: None,
        max: None,
        dimensions: Vec::new(),
    };
    match variable.is_inner() {
        true => Ok(variable),
        false => Err(error),
    }
}

/// Keeps one variable for each name: of two, the one that is not inner, or else the first.
///
/// # Errors
/// If two variables that are not inner share a name.
pub(super) fn name_once(variables: &mut [Variable]) -> Result<(), DescriptionError> {
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    for place in 0..variables.len() {
        let name = variables[place].name.clone();
        let Some(&first) = places.get(&name) else {
            places.insert(name, place);
            continue;
        };
        let other = match (variables[first].is_inner(), variables[place].is_inner()) {
            (_, true) => place,
            (true, false) => {
                places.insert(name, place);
                first
            }
            (false, false) => {
                return Err(DescriptionError::Content(format!(
                    "variable {name:?} is defined twice"
                )));
            }
        };
        let other = &mut variables[other];
        other.reference = UNREFERENCED;
        let reason = "another variable has its name".to_owned();
        other.unusable.get_or_insert(reason);
    }
    Ok(())
}

/// Reads the units. A unit without a name is left out, and a unit with an unreadable definition gets none.
pub(super) fn units(root: &Element, notes: &mut Vec<String>) -> Vec<Unit> {
    let mut units = Vec::new();
    for unit in root.list("UnitDefinitions") {
        let Some(name) = unit.text("name") else {
            notes.push("a unit has no name; it is ignored".into());
            continue;
        };
        let base = unit.child("BaseUnit").map(base).transpose();
        if let Err(error) = &base {
            let (name, reason) = (shortened(name), error.clone().reason());
            notes.push(format!(
                "unit {name:?}: {reason}; it is not used for conversions"
            ));
        }
        units.push(Unit {
            name: name.into(),
            base: base.unwrap_or_default(),
        });
    }
    units
}

fn base(base: &Element) -> Result<BaseUnit, DescriptionError> {
    let mut exponents = [0; 8];
    for (exponent, name) in exponents.iter_mut().zip(BASE_UNITS) {
        *exponent = base.value(name)?.unwrap_or(0);
    }
    Ok(BaseUnit {
        exponents,
        factor: base.value("factor")?.unwrap_or(1.0),
        offset: base.value("offset")?.unwrap_or(0.0),
    })
}

/// Reads a number that the standard requires to be above 0. Any other value counts as missing, with a note.
pub(super) fn positive(element: &Element, name: &str, notes: &mut Vec<String>) -> Option<f64> {
    let text = element.text(name)?;
    let number: Option<f64> = text.trim().parse().ok();
    let usable = number.filter(|number| number.is_finite() && *number > 0.0);
    if usable.is_none() {
        let (element, text) = (&element.name, shortened(text));
        notes.push(format!(
            "`{name}` of {element} is {text:?} and not a number above 0; it is ignored"
        ));
    }
    usable
}

/// Returns a note about a unit whose definition is unusable.
pub(super) fn unusable_unit(unit: &Unit) -> Option<String> {
    let BaseUnit { factor, offset, .. } = unit.base?;
    let is_usable = factor.is_finite() && factor != 0.0 && offset.is_finite();
    let name = shortened(&unit.name);
    (!is_usable).then(|| {
        format!("unit {name:?} has the factor {factor} and the offset {offset}; it is not used for conversions")
    })
}

/// Removes bounds that are not numbers, with a note.
pub(super) fn drop_bounds(variable: &mut Variable, notes: &mut Vec<String>) {
    let name = shortened(&variable.name);
    for (which, bound) in [("min", &mut variable.min), ("max", &mut variable.max)] {
        if bound.take_if(|bound| bound.is_nan()).is_some() {
            notes.push(format!("`{which}` of {name:?} is NaN; it is ignored"));
        }
    }
}
