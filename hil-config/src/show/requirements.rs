//! A requirement as `[[requirements]]` of a scenario.

use std::fmt::Write;

use super::{Written, forgotten, section, string};
use crate::keys::REQUIREMENT;
use crate::plan::Requirement;

pub(super) fn requirement(text: &mut String, requirement: &Requirement) -> Written {
    writeln!(text, "\n[[requirements]]")?;
    let description = &requirement.description;
    section(text, REQUIREMENT, |key| match key {
        "name" => Some(string(&requirement.name)),
        "formula" => Some(string(&requirement.formula.to_string())),
        "description" => (!description.is_empty()).then(|| string(description)),
        "unit" => Some(string(&requirement.unit)),
        other => forgotten(other),
    })
}
