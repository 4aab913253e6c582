//! `trait Plant`: what a model implements, and the row of numbers the engine sees of it.
//!
//! A model knows its equations, its parameters and the command it is given. It never knows the
//! scenario, the link, the clock or a fault: a fault changes a parameter from outside.

use shared_types::describe::{FaultDescription, Invalid, PlantDescription, Settings};
use shared_types::state::{State, StateOf};
use shared_types::table::{self, Table};
use shared_types::time::Interval;

/// A plant, called in this order:
///
/// 1. [`start`](Plant::start), once: the state at step 0.
/// 2. At every step `k`: [`retune`](Plant::retune) if a fault moved a parameter, then
///    [`measure`](Plant::measure) and, when the command of step `k` is there,
///    [`truth`](Plant::truth), both of the state at step `k`.
/// 3. [`advance`](Plant::advance) with that command to step `k + 1`.
/// 4. After the last step `measure` and `truth` once more.
///
/// At a checkpoint what [`state`](Plant::state) tells is saved before step `k`. A run that goes on
/// from there starts the plant, retunes it to the parameters of that step, puts the state back and
/// goes on with 2.
///
/// It must be deterministic: no clock, no file, no random number, no hash-map order. Use `libm`
/// for sines and exponentials, whose last bit otherwise depends on the machine.
pub trait Plant: Sized + 'static {
    /// Name in scenarios.
    const NAME: &'static str;
    /// One sentence.
    const SUMMARY: &'static str;
    /// Parameters, each with a default; mark those open to faults `faultable`.
    type Parameters: table::Parameters;
    /// True state and outputs. A range on a signal is its limit of validity: outside it the run
    /// ends as diverged, with the signal named.
    type Truth: Table;
    /// Readings of the sensors.
    type Measured: Table;
    /// The commands it takes.
    type Command: Table;

    /// Named faults besides those on single parameters.
    #[must_use]
    fn faults() -> Vec<FaultDescription> {
        Vec::new()
    }

    /// Returns the part of the plant that a checkpoint keeps; `None`: a run of the plant cannot be saved.
    #[must_use]
    fn state() -> Option<StateOf<Self>> {
        None
    }

    /// The plant at step 0.
    ///
    /// # Errors
    /// If the parameters, each in its range, do not go together.
    fn start(parameters: &Self::Parameters) -> Result<Self, Invalid>;

    /// Takes new values of the faultable parameters.
    fn retune(&mut self, parameters: &Self::Parameters);

    /// Returns the sensors' readings of the present state.
    fn measure(&self) -> Self::Measured;

    /// The present truth; `time_s` is the simulated time and `command` the command being applied.
    fn truth(&self, time_s: f64, command: &Self::Command) -> Self::Truth;

    /// Integrates over one interval under a constant command.
    fn advance(&mut self, interval: &Interval, command: &Self::Command);
}

/// A plant of any type, as rows of numbers in the order of its tables.
pub trait Model {
    /// Takes a full row of parameters.
    fn retune(&mut self, parameters: &[f64]);
    /// Writes the measured row.
    fn measure(&self, measured: &mut [f64]);
    /// Writes the truth row.
    fn truth(&self, time_s: f64, command: &[f64], truth: &mut [f64]);
    /// Integrates over one interval.
    fn advance(&mut self, interval: &Interval, command: &[f64]);

    /// Its state as it is now.
    ///
    /// # Errors
    /// If it cannot be saved.
    fn save(&self) -> Result<State, Invalid> {
        Err(cannot_save())
    }

    /// Puts a state back.
    ///
    /// # Errors
    /// If it is not one of this plant.
    fn restore(&mut self, _state: &State) -> Result<(), Invalid> {
        Err(cannot_save())
    }
}

fn cannot_save() -> Invalid {
    Invalid("the plant cannot save its state; it needs `Plant::state`".into())
}

impl<P: Plant> Model for P {
    fn retune(&mut self, parameters: &[f64]) {
        Plant::retune(self, &P::Parameters::from_row(parameters));
    }

    fn measure(&self, measured: &mut [f64]) {
        measured.copy_from_slice(Plant::measure(self).row());
    }

    fn truth(&self, time_s: f64, command: &[f64], truth: &mut [f64]) {
        let command = P::Command::from_row(command);
        truth.copy_from_slice(Plant::truth(self, time_s, &command).row());
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) {
        Plant::advance(self, interval, &P::Command::from_row(command));
    }

    fn save(&self) -> Result<State, Invalid> {
        P::state().ok_or_else(cannot_save)?.save(self)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        P::state().ok_or_else(cannot_save)?.restore(self, state)
    }
}

/// A plant that can be chosen by name: its description and how to start it.
pub struct PlantKind {
    /// Description that `--describe` shows.
    pub description: PlantDescription,
    /// Starts it from every parameter by name.
    pub start: fn(&Settings) -> Result<Box<dyn Model>, Invalid>,
}

impl PlantKind {
    /// The entry of a plant type.
    #[must_use]
    pub fn of<P: Plant>() -> Self {
        Self {
            description: PlantDescription {
                name: P::NAME.into(),
                summary: P::SUMMARY.into(),
                parameters: P::Parameters::fields(),
                truth: P::Truth::fields(),
                measured: P::Measured::fields(),
                commands: P::Command::fields(),
                faults: P::faults(),
                saves: P::state().is_some(),
            },
            start: |settings| {
                let parameters = settings.to_table("plant.parameters")?;
                Ok(Box::new(P::start(&parameters)?))
            },
        }
    }
}
