//! A requirement as `[[requirements]]` of a scenario.

use std::fmt::Write;

use super::{Written, string};
use crate::plan::Requirement;

pub(super) fn requirement(text: &mut String, requirement: &Requirement) -> Written {
    writeln!(text, "\n[[requirements]]")?;
    writeln!(text, "name = {}", string(&requirement.name))?;
    writeln!(
        text,
        "formula = {}",
        string(&requirement.formula.to_string())
    )?;
    if !requirement.description.is_empty() {
        writeln!(text, "description = {}", string(&requirement.description))?;
    }
    writeln!(text, "unit = {}", string(&requirement.unit))?;
    Ok(())
}
