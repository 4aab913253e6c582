//! Evaluation of a scenario at many points, on all cores.

use std::path::PathBuf;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::results::requirements::{Requirement, RunVerdict};
use hil_facts::results::summary::Metric;
use hil_run::alone;
use pyo3::prelude::*;
use shared_types::record::Outcome;

use crate::class::Classes;
use crate::failure::raised;
use crate::parallel::in_parallel;
use crate::scenario::{self, Checked};

/// Runs a scenario with `KEY=VALUE` flags once for each point, which are more such flags. Returns the results as JSON,
/// or `None` if a point needs a program. All points are checked before the first is run.
#[pyfunction]
pub(crate) fn evaluate_points(
    py: Python<'_>,
    path: PathBuf,
    flags: Vec<String>,
    points: Vec<Vec<String>>,
    workers: usize,
) -> PyResult<Option<String>> {
    let check = |place: usize| {
        let all = [&flags[..], &points[place]].concat();
        let checked = scenario::read(path.clone(), &all, &Classes::default())?;
        checked.map(refuse_clock).transpose()
    };
    let interruption = Interruption::default();
    let checked = in_parallel(py, points.len(), workers, &interruption, check)?;
    let Some(checked) = checked.into_iter().collect::<Option<Vec<Checked>>>() else {
        return Ok(None);
    };
    let run = |place: usize| evaluated(&checked[place], &interruption).map_err(|e| raised(&e));
    let results = in_parallel(py, points.len(), workers, &interruption, run)?;
    Ok(Some(format!("[{}]", results.join(","))))
}

fn refuse_clock(checked: Checked) -> PyResult<Checked> {
    alone::refuse_clock(&checked.plan).map_err(|failure| raised(&failure))?;
    Ok(checked)
}

/// Runs a point and returns its result as JSON.
fn evaluated(checked: &Checked, interruption: &Interruption) -> Result<String, Failure> {
    let ended = alone::run(&checked.plan, &checked.described, None, interruption)?;
    if matches!(ended.outcome, Outcome::Failed | Outcome::Stopped) {
        let reason = ended.reason.as_deref();
        return Err(Failure::infrastructure(
            reason.unwrap_or("the run gave no reason"),
        ));
    }
    let recorded = ended.recorded;
    let requirements: Vec<Requirement> = recorded
        .requirements
        .iter()
        .map(Requirement::from)
        .collect();
    let metrics: Vec<Metric> = recorded.metrics.iter().map(Metric::from).collect();
    let json = serde_json::json!({
        "verdict": RunVerdict::of(ended.outcome, &requirements).name(),
        "reason": ended.reason,
        "digest": recorded.digest,
        "requirements": requirements,
        "metrics": metrics,
    });
    Ok(json.to_string())
}
