//! Session in this process, as an object of Python.

use std::cell::RefMut;
use std::path::PathBuf;
use std::time::Duration;

use hil_console::terminal::exit::Failure;
use hil_run::stepped::{Place, SteppedRun};
use hil_session::clock::monotonic_ns;
use hil_verification::repetition::Interventions;
use pyo3::exceptions::{PyKeyboardInterrupt, PyOverflowError};
use pyo3::prelude::*;
use shared_types::live::Request;
use shared_types::record::ValueChange;
use shared_types::table::Field;
use shared_types::time::Step;

use crate::bound::{Along, Bound as ThreadBound};
use crate::class::Classes;
use crate::failure::{raised, session_error};
use crate::observer::Observer;
use crate::saved::Saved;
use crate::{scenario, side};

/// Interval between two looks for signals, such as Ctrl-C, while steps are executed.
const BETWEEN_SIGNALS: Duration = Duration::from_millis(20);

/// Run in this process, held before its next step.
#[pyclass(frozen, module = "hil._native")]
pub(crate) struct Session {
    run: ThreadBound<SteppedRun>,
    /// `true` if plant or law is a class, whose exceptions are Python's.
    has_classes: bool,
}

/// Opens a session of a scenario with `KEY=VALUE` flags, and with classes for its plant and its law; returns `None` if
/// it needs a program.
#[pyfunction]
#[pyo3(signature = (path, flags, plant = None, law = None))]
pub(crate) fn open_session(
    py: Python<'_>,
    path: PathBuf,
    flags: Vec<String>,
    plant: Option<&Bound<'_, PyAny>>,
    law: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<Session>> {
    let classes = Classes::of(plant, law)?;
    let Some(checked) = scenario::read(path, &flags, &classes)? else {
        return Ok(None);
    };
    let has_classes = checked.kinds.is_some();
    let run = caused(py, has_classes, || {
        SteppedRun::new(checked.plan, checked.described, checked.kinds)
    });
    Ok(Some(Session {
        run: ThreadBound::new(run?),
        has_classes,
    }))
}

fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| raised(&Failure::infrastructure(error)))
}

impl Session {
    /// Returns the run for exclusive use.
    ///
    /// # Errors
    /// As for [`Bound::get`](ThreadBound::get).
    pub(crate) fn run(&self) -> PyResult<RefMut<'_, SteppedRun>> {
        self.run.get()
    }

    /// Executes steps up to `target` without the interpreter, and looks for signals now and then.
    pub(crate) fn advance(
        &self,
        py: Python<'_>,
        run: &mut SteppedRun,
        target: Step,
    ) -> PyResult<()> {
        loop {
            let until_ns = monotonic_ns().saturating_add(BETWEEN_SIGNALS.as_nanos() as u64);
            let mut along = Along(&mut *run);
            let has_arrived = caused(py, self.has_classes, || {
                py.detach(move || along.get().advance_to(target, until_ns))
            })?;
            if has_arrived {
                return Ok(());
            }
            if let Err(interrupt) = py.check_signals() {
                run.hold().map_err(|failure| raised(&failure))?;
                return Err(interrupt);
            }
        }
    }
}

/// Does work that may call a class; the cause of its exception is that of the class, and Ctrl-C stays Ctrl-C.
fn caused<T>(
    py: Python<'_>,
    has_classes: bool,
    work: impl FnOnce() -> Result<T, Failure>,
) -> PyResult<T> {
    if has_classes {
        drop(side::take_exception()); // of earlier work
    }
    let result = work();
    let cause = has_classes.then(side::take_exception).flatten();
    match (result, cause) {
        (_, Some(interrupt)) if interrupt.is_instance_of::<PyKeyboardInterrupt>(py) => {
            Err(interrupt)
        }
        (Ok(result), None) => Ok(result),
        // The run goes on without its law, as `run.on_controller_loss` has it.
        (Ok(result), Some(cause)) => {
            cause.write_unraisable(py, None);
            Ok(result)
        }
        (Err(failure), cause) => {
            let error = raised(&failure);
            error.set_cause(py, cause);
            Err(error)
        }
    }
}

#[pymethods]
impl Session {
    /// Executes steps; fewer if the run ends earlier.
    #[pyo3(signature = (steps = 1))]
    fn step(&self, py: Python<'_>, steps: u64) -> PyResult<()> {
        let mut run = self.run()?;
        if run.is_over() {
            let step = run.step();
            return Err(session_error(&format!(
                "the run is over since step {step}; begin again with reset() or restore()"
            )));
        }
        let target = Step(run.step().0.saturating_add(steps));
        self.advance(py, &mut run, target)
    }

    /// Executes all steps before the first one at or after a simulated time.
    fn step_to(&self, py: Python<'_>, time_s: f64) -> PyResult<()> {
        let mut run = self.run()?;
        let (step, rate) = (run.step(), run.plan().run.rate);
        let target = match time_s {
            time_s if time_s.is_nan() || time_s < 0.0 => {
                return Err(session_error(&format!("{time_s} is no simulated time")));
            }
            time_s if time_s.is_infinite() => Step(u64::MAX),
            time_s => rate.step_at_or_after(time_s),
        };
        if target < step && !(run.is_over() && target.0 >= run.plan().run.steps) {
            let now_s = rate.seconds(step);
            return Err(session_error(&format!(
                "{time_s} s is past, because the next step is {step} ({now_s} s); restore() goes back"
            )));
        }
        self.advance(py, &mut run, target)
    }

    /// Answers a request of a session, both as JSON.
    fn request(&self, request: &str) -> PyResult<String> {
        let request: Request = serde_json::from_str(request)
            .map_err(|error| raised(&Failure::infrastructure(error)))?;
        json(&self.run()?.request(request))
    }

    /// Returns a value of the newest step; `None` before the first, and for an unknown name.
    fn value(&self, name: &str) -> PyResult<Option<f64>> {
        let run = self.run()?;
        Ok(run.place(name).and_then(|place| run.value(place)))
    }

    /// Creates an observer of values by name; returns the first name that does not exist instead.
    fn observe(&self, py: Python<'_>, names: Vec<String>) -> PyResult<Observed> {
        let run = self.run()?;
        let mut places: Vec<Place> = Vec::with_capacity(names.len());
        for name in names {
            match run.place(&name) {
                Some(place) => places.push(place),
                None => return Ok(Observed::Unknown(name)),
            }
        }
        let observer = Observer::new(py, places);
        observer.copy(py, &run);
        Ok(Observed::Observer(observer))
    }

    /// Copies the values of an observer.
    fn copy(&self, py: Python<'_>, observer: &Bound<'_, Observer>) -> PyResult<()> {
        observer.get().copy(py, &*self.run()?);
        Ok(())
    }

    /// Saves the session before its next step.
    fn save(&self, py: Python<'_>) -> PyResult<Saved> {
        let mut run = self.run()?;
        let saved = caused(py, self.has_classes, || run.save())?;
        Ok(Saved::new(saved))
    }

    /// Continues from a saved state.
    fn restore(&self, py: Python<'_>, saved: &Bound<'_, Saved>) -> PyResult<()> {
        let saved = saved.get().run.get()?;
        let mut run = self.run()?;
        caused(py, self.has_classes, || run.restore(&saved))
    }

    /// Begins again at step 0, with another seed if one is given.
    #[pyo3(signature = (seed = None))]
    fn reset(&self, py: Python<'_>, seed: Option<u64>) -> PyResult<()> {
        if seed.is_some_and(|seed| i64::try_from(seed).is_err()) {
            return Err(PyOverflowError::new_err("a seed is at most 2**63 - 1"));
        }
        let mut run = self.run()?;
        caused(py, self.has_classes, || run.reset(seed))
    }

    /// Ends the session.
    fn close(&self) -> PyResult<()> {
        self.run.close()
    }

    /// Returns name and unit of each signal of a record, then of each derived signal.
    fn signals(&self) -> PyResult<[Vec<(String, String)>; 2]> {
        let run = self.run()?;
        let recorded = run.signals().map(|(name, unit)| (name, unit.to_owned()));
        let derived = run.plan().derived.iter();
        let derived = derived.map(|one| (one.name.clone(), one.unit.clone()));
        Ok([recorded.collect(), derived.collect()])
    }

    /// Returns name, least and greatest value of each command of the plant.
    fn commands(&self) -> PyResult<Vec<(String, f64, f64)>> {
        let run = self.run()?;
        let model = &run.plan().plant.model;
        let mut plants = run.described()[0].plants.iter();
        let plant = plants.find(|plant| plant.name == *model);
        let commands = plant.into_iter().flat_map(|plant| &plant.commands);
        let row = |field: &Field| (field.name.clone(), field.min, field.max);
        Ok(commands.map(row).collect())
    }

    /// Next step; after the end, the number of executed steps.
    #[getter]
    fn step_index(&self) -> PyResult<u64> {
        Ok(self.run()?.step().0)
    }

    /// Simulated time of the next step.
    #[getter]
    fn time_s(&self) -> PyResult<f64> {
        let run = self.run()?;
        Ok(run.plan().run.rate.seconds(run.step()))
    }

    /// Number of steps of the whole run, and steps per second.
    #[getter]
    fn length(&self) -> PyResult<(u64, f64)> {
        let run = self.run()?;
        Ok((run.plan().run.steps, run.plan().run.rate.hz()))
    }

    /// `True` after the end of the run.
    #[getter]
    fn is_over(&self) -> PyResult<bool> {
        Ok(self.run()?.is_over())
    }

    /// Digest of the records so far; `None` before the first.
    #[getter]
    fn digest(&self) -> PyResult<Option<String>> {
        Ok(self.run()?.digest())
    }

    /// Returns the requirements, the metrics, and the end of the run if it is over, as JSON.
    fn results(&self) -> PyResult<String> {
        let run = self.run()?;
        let end = run.end().map(
            |(verdict, reason)| serde_json::json!({ "verdict": verdict.name(), "reason": reason }),
        );
        json(&serde_json::json!({
            "requirements": run.requirements(),
            "metrics": run.metrics(),
            "end": end,
        }))
    }

    /// Returns the scenario that repeats this session so far.
    fn scenario(&self) -> PyResult<String> {
        let run = self.run()?;
        let recorded = run.recorded();
        let live = recorded.values.iter().filter(|change| change.live);
        let changes: Vec<ValueChange> = live.cloned().collect();
        let interventions = Interventions {
            log: &recorded.faults,
            changes: &changes,
            keeps_waiting: false,
        };
        let [plant, controller] = run.described();
        let plan = run.plan().clone();
        let head = "# Repeats a session of Python, including its faults and changes.\n".to_owned();
        let text = plan.plant_among(&plant.plants).map_or_else(
            || Err(Failure::infrastructure("the plant is not described")),
            |described| interventions.scenario(head, plan, &described, [plant, controller]),
        );
        text.map_err(|failure| raised(&failure))
    }
}

/// Observer, or the first unknown name.
#[derive(IntoPyObject)]
enum Observed {
    Observer(Observer),
    Unknown(String),
}
