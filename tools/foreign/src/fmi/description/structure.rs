//! Structure of a model: the variables that each output depends on directly, and the continuous states.

use super::tree::Element;
use super::{ContinuousState, Dependency, Variable, Version};

/// Reads the direct dependencies of the outputs that the model structure lists. An entry that is not an output is
/// skipped, and an output whose dependencies cannot be read may depend on all inputs.
pub(super) fn dependencies(
    root: &Element,
    version: Version,
    variables: &[Variable],
    notes: &mut Vec<String>,
) -> Vec<Dependency> {
    let Some(structure) = root.child("ModelStructure") else {
        return Vec::new();
    };
    let (outputs, name): (Vec<&Element>, _) = match version {
        Version::Two => (structure.list("Outputs").iter().collect(), "index"),
        Version::Three => {
            let outputs = structure.children.iter();
            let outputs = outputs.filter(|child| child.name == "Output");
            (outputs.collect(), "valueReference")
        }
    };
    let mut dependencies = Vec::new();
    for output in outputs {
        let reference = |number: u32| match version {
            Version::Two => {
                let place = usize::try_from(number).ok().and_then(|n| n.checked_sub(1));
                let variable = place.and_then(|place| variables.get(place));
                variable.map(|variable| variable.reference)
            }
            Version::Three => Some(number),
        };
        let wrong = |name: &str| output.wrong(name, "names no variable");
        let number = output.value(name).map(|number| number.and_then(reference));
        let Some(of) = number.unwrap_or_default() else {
            notes.push(format!("{}; it is ignored", wrong(name).reason()));
            continue;
        };
        let on = output.text("dependencies").and_then(|text| {
            let numbers = text.split_ascii_whitespace().map(|word| word.parse().ok());
            let on: Option<Vec<u32>> = numbers.map(|number| reference(number?)).collect();
            if on.is_none() {
                let reason = wrong("dependencies").reason();
                notes.push(format!("{reason}; it may depend on all inputs"));
            }
            on
        });
        dependencies.push(Dependency { output: of, on });
    }
    dependencies
}

/// Reads the continuous states: those whose derivatives the model structure lists. If one cannot be read there are none,
/// because a part of them describes no model.
pub(super) fn states(
    root: &Element,
    version: Version,
    variables: &[Variable],
) -> Vec<ContinuousState> {
    let Some(structure) = root.child("ModelStructure") else {
        return Vec::new();
    };
    let elements = root.list("ModelVariables");
    let of_reference = |reference: u32| {
        let mut all = variables.iter();
        all.position(|variable| variable.reference == reference)
    };
    let of_index = |number: usize| {
        number
            .checked_sub(1)
            .filter(|place| *place < variables.len())
    };
    let all: Option<Vec<ContinuousState>> = match version {
        Version::Two => { structure.list("Derivatives").iter() }
            .map(|unknown| {
                let derivative = of_index(unknown.value("index").ok()??)?;
                let real = elements.get(derivative)?.child("Real")?;
                Some(ContinuousState {
                    variable: of_index(real.value("derivative").ok()??)?,
                    derivative: variables[derivative].reference,
                })
            })
            .collect(),
        Version::Three => { structure.children.iter() }
            .filter(|child| child.name == "ContinuousStateDerivative")
            .map(|unknown| {
                let derivative: u32 = unknown.value("valueReference").ok()??;
                let element = elements.get(of_reference(derivative)?)?;
                Some(ContinuousState {
                    variable: of_reference(element.value("derivative").ok()??)?,
                    derivative,
                })
            })
            .collect(),
    };
    all.unwrap_or_default()
}
