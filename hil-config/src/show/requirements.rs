//! A requirement as `[[requirements]]` of a scenario.

use std::fmt::Write;

use super::{Written, forgotten, section, string, strings};
use crate::keys::REQUIREMENT;
use crate::plan::Requirement;

pub(super) fn requirement(text: &mut String, requirement: &Requirement) -> Written {
    writeln!(text, "\n[[requirements]]")?;
    let description = &requirement.description;
    section(text, REQUIREMENT, |key| match key {
        "name" => Some(string(&requirement.name)),
        "formula" => Some(string(&requirement.formula.to_string())),
        "description" => (!description.is_empty()).then(|| string(description)),
        "id" => requirement.trace.id.as_deref().map(string),
        "verifies" => {
            let verifies = &requirement.trace.verifies;
            (!verifies.is_empty()).then(|| strings(verifies))
        }
        "unit" => Some(string(&requirement.unit)),
        other => forgotten(other),
    })
}
