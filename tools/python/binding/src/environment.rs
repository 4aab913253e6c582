//! Steps of an environment, in which an agent acts on a session: nothing but memory is exchanged between two calls.

use pyo3::prelude::*;
use shared_types::time::Step;

use crate::observer::Observer;
use crate::session::Session;

/// Outcome of the steps that an environment executed: `true` if the run is over; `True` or `False` once all
/// requirements are certain to pass or one is certain to fail, else `None`; and the robustness so far of one
/// requirement, NaN without one.
type Played = (bool, Option<bool>, f64);

/// Executes steps, fewer if the run ends earlier, and copies the values of an observer.
#[pyfunction]
#[pyo3(signature = (session, observer, steps, requirement = None))]
pub(crate) fn play(
    py: Python<'_>,
    session: &Bound<'_, Session>,
    observer: &Bound<'_, Observer>,
    steps: u64,
    requirement: Option<usize>,
) -> PyResult<Played> {
    let session = session.get();
    let mut run = session.run()?;
    let target = Step(run.step().0.saturating_add(steps));
    session.advance(py, &mut run, target)?;
    observer.get().copy(py, &run);
    let bounds = run.bounds();
    let fails = bounds.iter().any(|[_, most]| most.is_sign_negative());
    let pass = !bounds.is_empty() && bounds.iter().all(|[least, _]| least.is_sign_positive());
    let certain = match (fails, pass) {
        (true, _) => Some(false),
        (false, true) => Some(true),
        (false, false) => None,
    };
    let robustness = requirement.and_then(|index| bounds.get(index));
    Ok((run.is_over(), certain, robustness.map_or(f64::NAN, so_far)))
}

/// Returns the robustness so far within bounds on the final one: the bound that the steps so far have set, above for
/// `always` and below for `eventually`; 0 before there is one. Infinite where a missing value decides.
fn so_far(bounds: &[f64; 2]) -> f64 {
    match *bounds {
        [f64::NEG_INFINITY, f64::INFINITY] => 0.0,
        [least, f64::INFINITY] => least,
        [_, most] => most,
    }
}
