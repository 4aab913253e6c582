//! Evaluation of a scenario at many points, on all cores.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::ScopedJoinHandle;
use std::time::Duration;

use crate::class::Classes;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::results::requirements::{Requirement, RunVerdict};
use hil_facts::results::summary::Metric;
use hil_run::alone;
use pyo3::prelude::*;
use shared_types::record::Outcome;

use crate::failure::raised;
use crate::scenario::{self, Checked};

/// Interval between two looks for signals, such as Ctrl-C.
const BETWEEN_SIGNALS: Duration = Duration::from_millis(20);

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

/// Calls a function for each place below `count` without the interpreter, on several threads. Returns the results in
/// order, or the first error.
///
/// # Errors
/// Those of the function; or the exception of a signal, after which no further call begins.
fn in_parallel<T: Send>(
    py: Python<'_>,
    count: usize,
    workers: usize,
    interruption: &Interruption,
    work: impl Fn(usize) -> PyResult<T> + Sync,
) -> PyResult<Vec<T>> {
    let (next, has_failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results: Mutex<Vec<(usize, PyResult<T>)>> = Mutex::default();
    let worker = || {
        while !has_failed.load(Ordering::Relaxed) && !interruption.came() {
            let place = next.fetch_add(1, Ordering::Relaxed);
            if place >= count {
                return;
            }
            let result = work(place);
            has_failed.fetch_or(result.is_err(), Ordering::Relaxed);
            let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
            results.push((place, result));
        }
    };
    let signalled = std::thread::scope(|scope| {
        let threads: Vec<ScopedJoinHandle<'_, ()>> = (0..workers.clamp(1, count.max(1)))
            .map(|_| scope.spawn(worker))
            .collect();
        let mut signalled = Ok(());
        while !py.detach(|| wait(&threads)) {
            if let Err(interrupt) = py.check_signals() {
                interruption.request();
                signalled = Err(interrupt);
            }
        }
        signalled
    });
    signalled?;
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(place, _)| *place);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Waits a moment; returns `true` if all threads have ended.
fn wait(threads: &[ScopedJoinHandle<'_, ()>]) -> bool {
    let are_over = || threads.iter().all(ScopedJoinHandle::is_finished);
    // Short evaluations should not wait for long.
    for nap in [20, 50, 100, 200, 500, 1000, 2000].map(Duration::from_micros) {
        if are_over() {
            return true;
        }
        std::thread::sleep(nap);
    }
    std::thread::sleep(BETWEEN_SIGNALS);
    are_over()
}
