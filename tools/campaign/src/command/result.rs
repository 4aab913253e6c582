//! The result of a case as cells of the table.

use std::sync::Arc;
use std::time::Instant;

use crate::table::{CLASS, Cell, Column, ColumnKind, Row};
use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::run::LinkKind;
use hil_facts::programs::binaries::Binaries;
use hil_facts::results::curve::{Curve, Grid};
use hil_facts::results::ended::EndedRun;
use hil_facts::results::requirements::{Requirement, RunVerdict, VACUOUS};
use hil_facts::results::summary::Metric;
use hil_run::settings::Settings;
use hil_run::{Environment, Origin};
use serde_json::{Value, json};
use shared_types::record::Outcome;

/// Result of a case.
pub(super) struct CaseResult {
    class: &'static str,
    steps: u64,
    digest: String,
    reason: String,
    requirements: Vec<Requirement>,
    metrics: Vec<Metric>,
    /// Set if the case ran in reused processes and should be verified in new ones.
    pub(super) is_to_check: bool,
    /// Curves of the case's signals, if recorded.
    pub(super) curve: Option<Curve>,
    /// Duration of the case, in s.
    pub(super) wall_s: f64,
}

impl CaseResult {
    /// Creates the result of a run that ended by itself.
    ///
    /// # Errors
    /// If the run ended in any other way.
    pub(super) fn of_ended(ended: EndedRun, began: Instant) -> Result<Self, Failure> {
        let recorded = ended.recorded;
        let requirements = recorded.requirements.iter().map(Requirement::from);
        let requirements: Vec<Requirement> = requirements.collect();
        Ok(Self {
            class: class(ended.outcome, &requirements, ended.reason.as_deref())?,
            steps: recorded.end.as_ref().map_or(0, |end| end.steps),
            digest: recorded.digest.unwrap_or_default(),
            reason: ended.reason.unwrap_or_default(),
            requirements,
            metrics: recorded.metrics.iter().map(Metric::from).collect(),
            is_to_check: false,
            curve: recorded.curve,
            wall_s: began.elapsed().as_secs_f64(),
        })
    }

    /// Runs a plan with external programs, in a temporary session and folder.
    ///
    /// # Errors
    /// If the run did not end by itself, so that it has no result.
    pub(super) fn in_processes(
        plan: &Plan,
        binaries: &Arc<Binaries>,
        (wait_limit_s, curve): (f64, Option<Arc<Grid>>),
        interruption: &Interruption,
        began: Instant,
    ) -> Result<Self, Failure> {
        let folder = tempfile::tempdir().map_err(Failure::infrastructure)?;
        let settings = Settings {
            is_one_of_many: true,
            wait_limit_s,
            curve,
            ..Settings::without_recording(LinkKind::Iceoryx2, Some(folder.path().join("run")))
        };
        let environment = Environment::new(&settings, Arc::clone(binaries), interruption)?;
        let ran = hil_run::execute(plan.clone(), environment, Origin::Scenario)?;
        ran.written?;
        let summary = ran.summary;
        let outcome = match (ran.exit, summary.verdict) {
            (Exit::Interrupted, _) => return Err(Failure::Interrupted),
            (Exit::Failed, RunVerdict::Aborted) => Outcome::Diverged,
            (Exit::Pass | Exit::Failed, _) => Outcome::Completed,
            _ => Outcome::Failed,
        };
        Ok(Self {
            class: class(outcome, &summary.requirements, summary.reason.as_deref())?,
            steps: summary.steps,
            digest: summary.digest.unwrap_or_default(),
            reason: summary.reason.unwrap_or_default(),
            requirements: summary.requirements,
            metrics: summary.metrics,
            is_to_check: false,
            curve: ran.curve,
            wall_s: began.elapsed().as_secs_f64(),
        })
    }

    /// Returns the result of a run that is no case of a table, with the verdict of its summary.
    pub(super) fn json(&self) -> Value {
        let outcome = match self.class {
            "diverged" => Outcome::Diverged,
            _ => Outcome::Completed,
        };
        json!({
            "verdict": RunVerdict::of(outcome, &self.requirements).name(),
            "reason": Some(&self.reason).filter(|reason| !reason.is_empty()),
            "digest": self.digest,
            "requirements": self.requirements,
            "metrics": self.metrics,
        })
    }

    /// Lists the columns of the result.
    pub(super) fn columns(&self) -> Vec<Column> {
        let mut columns = vec![
            Column::new(CLASS, ColumnKind::Text),
            Column::new("steps", ColumnKind::Count),
        ];
        for requirement in &self.requirements {
            let name = &requirement.name;
            columns.push(Column::new(&format!("verdict.{name}"), ColumnKind::Text));
            columns.push(Column {
                unit: requirement.unit.clone(),
                ..Column::new(&format!("robustness.{name}"), ColumnKind::Number)
            });
        }
        for metric in &self.metrics {
            let same = self
                .metrics
                .iter()
                .filter(|other| other.name == metric.name);
            let [from, to] = metric.window_s;
            let name = match same.count() {
                1 => metric.name.clone(),
                _ => format!("{}[{from},{to}]", metric.name),
            };
            columns.push(Column {
                unit: metric.unit.clone(),
                ..Column::new(&name, ColumnKind::Number)
            });
        }
        columns.push(Column::new("digest", ColumnKind::Text));
        columns.push(Column::new("reason", ColumnKind::Text));
        columns
    }

    /// Returns the cells of the result.
    pub(super) fn cells(&self) -> Row {
        let number = |value: Option<f64>| Cell::number(value.unwrap_or(f64::NAN));
        let mut row = vec![Cell::Text(self.class.into()), Cell::Count(self.steps)];
        for requirement in &self.requirements {
            row.push(Cell::Text(requirement.outcome().into()));
            row.push(number(requirement.robustness));
        }
        row.extend(self.metrics.iter().map(|metric| number(metric.value)));
        row.push(Cell::Text(self.digest.clone()));
        row.push(Cell::Text(self.reason.clone()));
        row
    }
}

/// Classifies a run that ended by itself.
fn class(
    outcome: Outcome,
    requirements: &[Requirement],
    reason: Option<&str>,
) -> Result<&'static str, Failure> {
    let any = |outcome| requirements.iter().any(|one| one.outcome() == outcome);
    match outcome {
        Outcome::Diverged => Ok("diverged"),
        Outcome::Completed if any("fail") => Ok("fail"),
        Outcome::Completed if any("undecided") => Ok("undecided"),
        Outcome::Completed if any(VACUOUS) => Ok(VACUOUS),
        Outcome::Completed => Ok("pass"),
        Outcome::Failed | Outcome::Stopped => Err(Failure::infrastructure(
            reason.unwrap_or("the run gave no reason"),
        )),
    }
}
