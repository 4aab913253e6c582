//! Requirements of a run: their verdicts and their table.
//!
//! Used by the summary of a run and by `hil judge`, so that both agree. Evaluates no formula, because
//! [`Evaluation`](hil_config::evaluation::Evaluation) does that while records are read.

use std::fmt::Write as _;

use hil_config::plan::Trace;
use hil_config::requirements::RequirementValue;
use hil_console::terminal::exit::Exit;
use hil_console::terminal::table::{Table, left, right};
use serde::Serialize;
use shared_types::number::{short, unit_shown};
use shared_types::record::Outcome;

/// Result of a requirement.
#[derive(Clone, Debug, Serialize)]
pub struct Requirement {
    /// Name of the requirement.
    pub name: String,
    /// Formula as written in the scenario.
    pub formula: String,
    /// `pass`, `fail` or `undecided`.
    pub verdict: &'static str,
    /// Margin in the unit, negative for a failed requirement; null if there is none.
    pub robustness: Option<f64>,
    /// Unit of the robustness.
    pub unit: String,
    /// Time of the step that determines the margin.
    pub at_s: Option<f64>,
    /// Time at which the verdict became certain.
    pub decided_at_s: Option<f64>,
    /// Premise that never called for its conclusion, so that the pass shows nothing; `None` for any other result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vacuous: Option<String>,
    /// Identifiers by which other documents know the requirement.
    #[serde(flatten)]
    pub trace: Trace,
}

impl From<&RequirementValue> for Requirement {
    fn from(value: &RequirementValue) -> Self {
        Self {
            name: value.name.clone(),
            formula: value.formula.clone(),
            verdict: value.verdict.name(),
            robustness: value.robustness.filter(|size| size.is_finite()),
            unit: value.unit.clone(),
            at_s: value.at_s,
            decided_at_s: value.decided_at_s,
            vacuous: value.vacuous.clone(),
            trace: value.trace.clone(),
        }
    }
}

/// Word for a requirement that passed although its conclusion was never called for.
pub const VACUOUS: &str = "vacuous";

impl Requirement {
    /// Returns the word for tables and evidence: the verdict, or `vacuous` for a pass that shows nothing.
    pub const fn outcome(&self) -> &'static str {
        match self.vacuous {
            Some(_) => VACUOUS,
            None => self.verdict,
        }
    }
}

/// Explains a vacuous pass by its premise.
pub fn why_vacuous(premise: &str) -> String {
    format!("vacuous: `{premise}` never called for its conclusion")
}

/// Verdict of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RunVerdict {
    /// All requirements passed.
    Pass,
    /// A requirement failed, or is undecided.
    Fail,
    /// The run was not completed.
    Aborted,
}

impl RunVerdict {
    /// Returns the verdict of a run: `Aborted` unless it was completed, else `Fail` if any requirement did not
    /// pass.
    pub fn of(outcome: Outcome, requirements: &[Requirement]) -> Self {
        if outcome != Outcome::Completed {
            Self::Aborted
        } else if requirements.iter().all(|one| one.verdict == "pass") {
            Self::Pass
        } else {
            Self::Fail
        }
    }

    /// Returns the name as used in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Aborted => "aborted",
        }
    }

    /// Returns the exit code of a run that ended by itself.
    pub const fn exit(self) -> Exit {
        match self {
            Self::Pass => Exit::Pass,
            Self::Fail | Self::Aborted => Exit::Failed,
        }
    }
}

/// Description of a completed run without requirements.
pub const WITHOUT_REQUIREMENTS: &str = "completed, no requirements";

/// Returns the verdict of a run in words: a `pass` without any requirement is not called a pass.
pub fn in_words(verdict: &str, requirements: usize) -> &str {
    match (verdict, requirements) {
        ("pass", 0) => WITHOUT_REQUIREMENTS,
        _ => verdict,
    }
}

/// Returns the verdict of a run in words, with the number of its vacuous requirements.
pub fn with_vacuous(words: &str, vacuous: usize) -> String {
    match vacuous {
        0 => words.into(),
        count => format!("{words}, {count} {VACUOUS}"),
    }
}

/// Writes the table of requirements, and the formulas of those that did not pass.
pub fn write(text: &mut String, requirements: &[Requirement]) -> std::fmt::Result {
    if requirements.is_empty() {
        return Ok(());
    }
    if !text.ends_with("\n\n") {
        writeln!(text)?;
    }
    let unit = left(5).close();
    let columns = [left(0), left(9), right(11), unit, right(9), right(0)];
    let mut table = Table::new(2, columns);
    table.cells([
        "requirement",
        "verdict",
        "robustness",
        "",
        "at [s]",
        "decided [s]",
    ]);
    for one in requirements {
        let verdict = match one.outcome() {
            "fail" => "FAIL",
            other => other,
        };
        let robustness = one.robustness.map_or_else(|| "-".into(), short);
        let time = |time_s: Option<f64>| time_s.map_or_else(|| "-".into(), |s| s.to_string());
        let (at_s, decided_at_s) = (time(one.at_s), time(one.decided_at_s));
        let unit = unit_shown(&one.unit);
        table.row(&[
            &one.name,
            &verdict,
            &robustness,
            &unit,
            &at_s,
            &decided_at_s,
        ]);
        if one.verdict != "pass" {
            table.line(format!("    {}", one.formula));
        }
        if let Some(premise) = &one.vacuous {
            table.line(format!("    {}", why_vacuous(premise)));
        }
    }
    writeln!(text, "{table}")
}
