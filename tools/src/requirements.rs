//! What requirements mean for a run, and their table.
//!
//! Used by the summary of a run and by `hil judge`, so that both say the same. Judges nothing: that
//! is done while records are read, by [`Evaluation`](hil_config::evaluation::Evaluation).

use std::fmt::Write as _;

use hil_config::monitor::Verdict;
use hil_config::requirements::RequirementValue;

use crate::exit::Exit;
use crate::summary::short;

/// The verdict of a run that ended by itself: one requirement that does not hold is enough.
#[must_use]
pub fn verdict(requirements: &[RequirementValue]) -> &'static str {
    let holds = |requirement: &RequirementValue| requirement.verdict == Verdict::Pass;
    if requirements.iter().all(holds) {
        "pass"
    } else {
        "fail"
    }
}

/// Its exit code.
#[must_use]
pub fn exit(requirements: &[RequirementValue]) -> Exit {
    match verdict(requirements) {
        "pass" => Exit::Pass,
        _ => Exit::Failed,
    }
}

/// Writes the table of requirements, and the formulas of those that do not hold.
pub(crate) fn write(text: &mut String, requirements: &[RequirementValue]) -> std::fmt::Result {
    let Some(width) = requirements.iter().map(|one| one.name.len()).max() else {
        return Ok(());
    };
    let width = if width < 11 { 11 } else { width };
    writeln!(
        text,
        "\n  {:<width$}  {:<9}  {:>11} {:<5}  {:>9}  {:>11}",
        "requirement", "verdict", "robustness", "", "at [s]", "decided [s]"
    )?;
    for one in requirements {
        let verdict = match one.verdict {
            Verdict::Pass => "pass",
            Verdict::Fail => "FAIL",
            Verdict::Undecided => "undecided",
        };
        let robustness = match one.robustness {
            None => "-".into(),
            Some(size) if size.is_finite() => short(size),
            Some(size) => size.to_string(),
        };
        let time = |time_s: Option<f64>| time_s.map_or_else(|| "-".into(), |s| s.to_string());
        let (name, unit) = (&one.name, &one.unit);
        let (at_s, decided_at_s) = (time(one.at_s), time(one.decided_at_s));
        writeln!(
            text,
            "  {name:<width$}  {verdict:<9}  {robustness:>11} {unit:<5}  {at_s:>9}  {decided_at_s:>11}"
        )?;
        if one.verdict != Verdict::Pass {
            writeln!(text, "    {}", one.formula)?;
        }
    }
    writeln!(text)
}
