//! FMU instance, called in the order that the standard defines.
//!
//! 1. [`Instance::start`]: the FMU is instantiated, configured and initialised with parameters and initial values;
//!    then all signals and parameters are read.
//! 2. [`Instance::step`]: inputs and changed parameters are set, the step is executed, and all signals and the
//!    changed parameters are read.
//!
//! Thus the signals of a step are always read before its inputs are set, as FMI 2 requires, and nothing is read
//! between setting and stepping. After a fatal or error status only permitted functions are called: none after
//! `Fatal`, and only freeing after `Error`.

use std::cell::Cell;
use std::ffi::{CString, c_char, c_int};
use std::path::Path;
use std::sync::Arc;

use shared_types::describe::Invalid;
use shared_types::failure::Failure;
use shared_types::time::Interval;

use crate::crash::{self, calling};

use super::Model;
use super::journal::Journal;
use super::library::{CallbacksTwo, Functions, Handle, Own};
use super::status::Status;
use super::values::{Refused, Values};
use crate::float_modes;
use confirmation::Unconfirmed;
use instantiation::instantiate;

mod confirmation;
mod derivatives;
mod instantiation;
mod preset;
mod saved;
mod tuning;

/// Status kind of FMI 2 that asks whether the model has ended.
const TERMINATED: c_int = 3;
/// Relative deviation of a period from a multiple of the internal step that counts as rounding.
const ROUNDING: f64 = 1e-6;

/// Life cycle stage of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Life {
    /// Instantiated but not yet stepped.
    Made,
    /// Ready for steps.
    Stepping,
    /// Failed with an error; the instance can still be freed.
    Broken,
    /// Failed fatally; no function may be called.
    Fatal,
}

/// Running instance of an FMU.
pub(super) struct Instance {
    model: Arc<Model>,
    functions: Arc<Functions>,
    handle: Handle,
    life: Cell<Life>,
    parameters: Values,
    /// Indices of the tunable parameters in the row of all parameters.
    tunable_places: Vec<usize>,
    /// Tunable parameters as currently set, and as requested.
    tuned: Vec<f64>,
    requested: Vec<f64>,
    unconfirmed: Unconfirmed,
    /// First parameter whose value at the FMU's start differs from the value that was set.
    other_start: Option<String>,
    inputs: Values,
    outputs: Values,
    /// Latest values of outputs, followed by those of local signals.
    signals: Vec<f64>,
    // The library holds pointers to both until the instance is freed.
    journal: Arc<Journal>,
    _callbacks: Option<Box<CallbacksTwo>>,
}

impl Instance {
    /// Starts an instance with these parameters.
    ///
    /// # Errors
    /// If the library fails; the error contains its message.
    pub(super) fn start(
        model: &Arc<Model>,
        functions: &Arc<Functions>,
        resources: &Path,
        parameters: &[f64],
    ) -> Result<Self, Invalid> {
        let tables = &model.tables;
        let described = &model.description;
        let values = |columns| Values::new(described, columns);
        let tunable = tables.parameters.iter().enumerate();
        let tunable = tunable.filter(|(_, column)| column.field.faultable);
        let tunable_places: Vec<usize> = tunable.map(|(place, _)| place).collect();
        let tuned: Vec<f64> = tunable_places
            .iter()
            .map(|&place| parameters[place])
            .collect();
        let signals = [&tables.outputs[..], &tables.locals].concat();
        let journal = Journal::open();
        let (handle, callbacks) = instantiate(model, functions, resources, &journal)?;
        let mut instance = Self {
            model: Arc::clone(model),
            functions: Arc::clone(functions),
            handle,
            life: Cell::new(Life::Made),
            parameters: values(&tables.parameters),
            requested: tuned.clone(),
            tuned,
            tunable_places,
            unconfirmed: Unconfirmed::default(),
            other_start: None,
            inputs: values(&tables.inputs),
            outputs: values(&signals),
            signals: vec![0.0; signals.len()],
            journal,
            _callbacks: callbacks,
        };
        let started = instance.initialise(parameters);
        started.map_err(|failure| Invalid(failure.to_string()))?;
        Ok(instance)
    }

    fn initialise(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        self.ask_for_messages()?;
        let model = Arc::clone(&self.model);
        let start = &model.start;
        self.configure(&start.structural)?;
        // SAFETY: the instance exists and is not initialised, so parameters may be set.
        let set = unsafe { (self.parameters).set(&self.functions, self.handle, parameters) };
        self.accept(set)?;
        self.preset(start)?;
        let (tolerance, stop_s) = (start.tolerance, start.stop_s);
        let functions = Arc::clone(&self.functions);
        match functions.own {
            Own::Two { setup, enter, .. } => {
                let call = calling(&"SetupExperiment");
                // SAFETY: the instance exists.
                self.judge("SetupExperiment", unsafe {
                    setup(
                        self.handle,
                        c_int::from(tolerance.is_some()),
                        tolerance.unwrap_or(0.0),
                        start.time_s,
                        c_int::from(stop_s.is_some()),
                        stop_s.unwrap_or(0.0),
                    )
                })?;
                drop(call);
                let _call = calling(&"EnterInitializationMode");
                // SAFETY: the experiment has been set up.
                self.judge("EnterInitializationMode", unsafe { enter(self.handle) })?;
            }
            Own::Three { enter, .. } => {
                let _call = calling(&"EnterInitializationMode");
                // SAFETY: the instance exists.
                self.judge("EnterInitializationMode", unsafe {
                    enter(
                        self.handle,
                        tolerance.is_some(),
                        tolerance.unwrap_or(0.0),
                        start.time_s,
                        stop_s.is_some(),
                        stop_s.unwrap_or(0.0),
                    )
                })?;
            }
        }
        let call = calling(&"ExitInitializationMode");
        // SAFETY: the instance is in initialisation mode.
        self.judge("ExitInitializationMode", unsafe {
            (functions.exit)(self.handle)
        })?;
        drop(call);
        self.life.set(Life::Stepping);
        self.read()?;
        self.confirm_initial()?;
        self.confirm_all(parameters)
    }

    /// Enables messages about all errors, if the library distinguishes them from other messages.
    fn ask_for_messages(&self) -> Result<(), Failure> {
        let all = self.model.description.categories.iter();
        let wrong = all.filter(|name| name.starts_with("logStatus"));
        let names: Vec<CString> = wrong
            .filter_map(|name| CString::new(name.as_str()).ok())
            .collect();
        if names.is_empty() {
            return Ok(());
        }
        let pointers: Vec<*const c_char> = names.iter().map(|name| name.as_ptr()).collect();
        let functions = Arc::clone(&self.functions);
        let _call = calling(&"SetDebugLogging");
        // SAFETY: the instance exists, and the list has this many texts, which live until the call returns.
        self.judge("SetDebugLogging", unsafe {
            match functions.own {
                Own::Two { logging, .. } => {
                    logging(self.handle, 1, pointers.len(), pointers.as_ptr())
                }
                Own::Three { logging, .. } => {
                    logging(self.handle, true, pointers.len(), pointers.as_ptr())
                }
            }
        })
    }

    /// Returns the description and tables.
    pub(super) fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the latest values of outputs, followed by those of local signals.
    pub(super) fn signals(&self) -> &[f64] {
        &self.signals
    }

    /// Checks that the instance began with the parameters with which it was started.
    ///
    /// # Errors
    /// The first parameter with another value.
    pub(super) fn check_start(&self) -> Result<(), Invalid> {
        self.other_start
            .clone()
            .map_or(Ok(()), |why| Err(Invalid(why)))
    }

    /// Returns the names of the parameters that cannot be read back from the library.
    pub(super) fn unreadable(&self) -> Vec<String> {
        self.unconfirmed.names()
    }

    /// Accepts a row of all parameters; tunable parameters take effect from the next step on.
    pub(super) fn retune(&mut self, parameters: &[f64]) {
        for (requested, &place) in self.requested.iter_mut().zip(&self.tunable_places) {
            *requested = parameters[place];
        }
    }

    /// Executes one step with constant inputs and reads all signals.
    ///
    /// # Errors
    /// If the FMU ends or fails; the failure contains its last message.
    pub(super) fn step(&mut self, interval: &Interval, inputs: &[f64]) -> Result<(), Failure> {
        if self.life.get() != Life::Stepping {
            return Err(self.failure("cannot continue after a failure"));
        }
        let changed = self.tune()?;
        // SAFETY: the instance is between two steps, so inputs may be set.
        let set = unsafe { (self.inputs).set(&self.functions, self.handle, inputs) };
        self.accept(set)?;
        let functions = Arc::clone(&self.functions);
        let at_s = self.model.start.time_s + interval.start_s;
        self.model.start.check_step(at_s, interval.length_s)?;
        let length_s = interval.length_s;
        match functions.own {
            Own::Two { step, .. } => {
                let _call = calling(&"DoStep");
                // 1 (true): the state before the step will not be needed again.
                // SAFETY: the instance is between two steps.
                let status = unsafe { step(self.handle, at_s, length_s, 1) };
                self.judge("DoStep", status)?
            }
            Own::Three { step, .. } => {
                // Bytes instead of `bool`, so that any value from the library is valid.
                let (mut event, mut is_over, mut is_early) = (0_u8, 0_u8, 0_u8);
                let mut reached_s = at_s;
                let _call = calling(&"DoStep");
                // SAFETY: the instance is between two steps, and all four variables live until the call returns.
                self.judge("DoStep", unsafe {
                    step(
                        self.handle,
                        at_s,
                        length_s,
                        true,
                        &raw mut event,
                        &raw mut is_over,
                        &raw mut is_early,
                        &raw mut reached_s,
                    )
                })?;
                if is_over != 0 {
                    return Err(Failure::diverged(
                        self.with_last_message("ended the simulation"),
                    ));
                }
                if is_early != 0 {
                    self.life.set(Life::Broken);
                    return Err(self
                        .failure("returned early from a step although early return is disabled"));
                }
            }
        }
        self.read()?;
        self.confirm_changed(&changed)
    }

    fn read(&mut self) -> Result<(), Failure> {
        // SAFETY: the instance is initialised, and nothing was set since its last step.
        let got = unsafe { (self.outputs).get(&self.functions, self.handle, &mut self.signals) };
        self.accept(got)
    }

    fn judge(&self, function: &'static str, answer: c_int) -> Result<(), Failure> {
        float_modes::settle(function);
        match Status::of(answer) {
            status if status.is_done() => Ok(()),
            status => Err(self.refused(function, status)),
        }
    }

    fn accept(&self, result: Result<(), Refused>) -> Result<(), Failure> {
        match result {
            Ok(()) => Ok(()),
            Err(Refused::Status(function, status)) => Err(self.refused(function, status)),
            Err(Refused::Value(why)) => Err(Failure::lost(why)),
        }
    }

    /// Creates the failure for an unsuccessful status, and records which calls are still permitted.
    fn refused(&self, function: &str, status: Status) -> Failure {
        let what = format!("answered {function} with {status}");
        let life = match status {
            Status::Fatal => Life::Fatal,
            Status::Discard if function == "DoStep" => {
                let what = match self.is_ended() {
                    true => "ended the simulation",
                    false => "could not do the step (Discard)",
                };
                return Failure::diverged(self.with_last_message(what));
            }
            _ => Life::Broken,
        };
        self.life.set(life);
        self.failure(&what)
    }

    /// Returns `true` if a discarded step of FMI 2 was the end of the model.
    fn is_ended(&self) -> bool {
        let Own::Two { status, .. } = self.functions.own else {
            return false;
        };
        let mut is_ended = 0;
        let _call = calling(&"GetBooleanStatus");
        // SAFETY: a step was discarded, after which the status may be queried.
        let answer = unsafe { status(self.handle, TERMINATED, &raw mut is_ended) };
        float_modes::settle("GetBooleanStatus");
        Status::of(answer).is_done() && is_ended != 0
    }

    fn failure(&self, what: &str) -> Failure {
        Failure::lost(self.with_last_message(what))
    }

    fn with_last_message(&self, what: &str) -> String {
        match self.journal.last() {
            Some(message) => format!("the FMU {what}: {message}"),
            None => format!("the FMU {what}"),
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: an instance in stepping mode may be terminated, and one without a fatal error freed; it is not used
        // again. The status of terminating is irrelevant.
        unsafe {
            if self.life.get() == Life::Stepping {
                crash::excuse_end();
                let _call = calling(&"Terminate");
                let _ = (self.functions.terminate)(self.handle);
            }
            if self.life.get() != Life::Fatal {
                let _call = calling(&"FreeInstance");
                (self.functions.free)(self.handle);
            }
        }
        float_modes::settle("FreeInstance");
    }
}

/// Checks that the period of a run fits the FMU's internal step; `key` is the scenario's key of the rate.
///
/// # Errors
/// If the period is not a multiple of the FMU's fixed step.
pub(super) fn check_period(model: &Model, period_s: f64, key: &str) -> Result<(), Invalid> {
    let Some(own_s) = model.description.internal_step_s else {
        return Ok(());
    };
    let steps = period_s / own_s;
    let whole = steps.round();
    if whole >= 1.0 && (steps - whole).abs() <= ROUNDING * whole {
        return Ok(());
    }
    let rate_hz = 1.0 / own_s;
    Err(Invalid(format!(
        "the FMU's fixed step of {own_s} s does not divide the {period_s} s between two samples; set {key} to {rate_hz} divided by an integer"
    )))
}
