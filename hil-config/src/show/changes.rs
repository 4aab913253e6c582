//! `[[changes]]` of a scenario.

use std::fmt::Write;

use shared_types::record::ChangedValue;
use shared_types::time::{Rate, Step};

use super::{Failure, ShowError, Written, comment, dotted, strings, toml_float};
use crate::plan::Change;

/// Writes a change.
pub(super) fn change(text: &mut String, change: &Change, rate: Rate) -> Written {
    let step = (change.step).ok_or(Failure::Show(ShowError::NowChange(change.id)))?;
    writeln!(text, "\n[[changes]]")?;
    writeln!(
        text,
        "at_s = {} # step {step}",
        toml_float(rate.seconds(step))
    )?;
    if change.ramp_steps > 0 {
        let ramp_s = rate.seconds(Step(change.ramp_steps));
        writeln!(text, "ramp_s = {}", toml_float(ramp_s))?;
    }
    if !change.clear.is_empty() {
        writeln!(text, "clear = {}", strings(&change.clear))?;
    }
    if !change.set.is_empty() {
        writeln!(text, "[changes.set]")?;
    }
    for ChangedValue { key, unit, value } in &change.set {
        let (key, value) = (dotted(key), toml_float(*value));
        writeln!(text, "{key} = {value} # {}", comment(unit))?;
    }
    Ok(())
}
