//! Structure of a model: the variables that each output depends on directly.

use super::tree::Element;
use super::{Dependency, DescriptionError, Variable, Version};

/// Reads the direct dependencies of the outputs that the model structure lists.
pub(super) fn dependencies(
    root: &Element,
    version: Version,
    variables: &[Variable],
) -> Result<Vec<Dependency>, DescriptionError> {
    let Some(structure) = root.child("ModelStructure") else {
        return Ok(Vec::new());
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
        let number = (output.value(name)?).and_then(reference);
        let on = match output.text("dependencies") {
            None => None,
            Some(text) => {
                let numbers = text.split_ascii_whitespace().map(|word| word.parse().ok());
                let on: Option<Vec<u32>> = numbers.map(|number| reference(number?)).collect();
                Some(on.ok_or_else(|| wrong("dependencies"))?)
            }
        };
        let output = number.ok_or_else(|| wrong(name))?;
        dependencies.push(Dependency { output, on });
    }
    Ok(dependencies)
}
