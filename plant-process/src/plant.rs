//! `trait Plant`: the interface of a model, and the engine's view of it as rows of numbers.
//!
//! A model contains its equations, its parameters and the current command. It has no access to the scenario, the link,
//! the clock or a fault: a fault changes a parameter from outside.

use shared_types::describe::{FaultDescription, Invalid, PlantDescription, Settings};
use shared_types::failure::Failure;
use shared_types::local_map::LocalMap;
use shared_types::quality::SignalSet;
use shared_types::state::{State, StateOf, unnamed};
use shared_types::table::{self, Table};
use shared_types::time::Interval;

/// A plant, called in this order:
///
/// 1. [`start`](Plant::start), once: the state at step 0.
/// 2. At every step `k`: [`retune`](Plant::retune) if a fault or a request changed a parameter, then
///    [`measure`](Plant::measure) and, when the command of step `k` has arrived, [`truth`](Plant::truth), both for the
///    state at step `k`.
/// 3. [`advance`](Plant::advance) with that command to step `k + 1`.
/// 4. After the last step `measure` and `truth` once more.
///
/// At a checkpoint the state defined by [`state`](Plant::state) is saved before step `k`. A resumed run starts the
/// plant, retunes it to the parameters of that step, restores the state and continues with 2.
///
/// A plant must be deterministic: no clock, no file, no random number, no hash-map order. Use `libm` for sines and
/// exponentials, whose last bit otherwise depends on the machine.
pub trait Plant: Sized + 'static {
    /// Name in scenarios.
    const NAME: &'static str;
    /// One-sentence summary.
    const SUMMARY: &'static str;
    /// Parameters, each with a default; mark those open to faults as `faultable`, and those that may be changed during
    /// a run `tunable`.
    type Parameters: table::Parameters;
    /// True state and outputs. The range of a signal is its limit of validity: a run that leaves it ends as diverged
    /// and names the signal.
    type Truth: Table;
    /// Sensor readings.
    type Measured: Table;
    /// Commands that the plant accepts.
    type Command: Table;

    /// Lists named faults, in addition to faults on single parameters.
    #[must_use]
    fn faults() -> Vec<FaultDescription> {
        Vec::new()
    }

    /// Returns the part of the plant that a checkpoint keeps; `None` if a run of the plant cannot be saved.
    #[must_use]
    fn state() -> Option<StateOf<Self>> {
        None
    }

    /// Creates the plant at step 0.
    ///
    /// # Errors
    /// If the parameters are inconsistent, although each is in its range.
    fn start(parameters: &Self::Parameters) -> Result<Self, Invalid>;

    /// Applies new values of the faultable and tunable parameters.
    fn retune(&mut self, parameters: &Self::Parameters);

    /// Returns the sensors' readings of the current state.
    fn measure(&self) -> Self::Measured;

    /// Returns the sensors' readings, and marks those that are invalid, as a sensor says that has failed or has nothing
    /// new. The controller gets the last valid reading in place of an invalid one. Called instead of
    /// [`measure`](Plant::measure), which it calls by default.
    fn read(&self, invalid: &mut SignalSet) -> Self::Measured {
        let _ = invalid;
        self.measure()
    }

    /// Returns the current truth; `time_s` is the simulated time and `command` the command being applied.
    fn truth(&self, time_s: f64, command: &Self::Command) -> Self::Truth;

    /// Integrates over one interval under a constant command.
    fn advance(&mut self, interval: &Interval, command: &Self::Command);
}

/// Plant of any type, as rows of numbers in the order of its tables, called in the order of [`Plant`].
///
/// Every [`Plant`] implements this trait. A plant whose tables are known only at run time, because its equations are in
/// another language or in a file, implements the trait directly and becomes a [`PlantKind`] by
/// [`from_tables`](PlantKind::from_tables). A failure ends the run at that step with its reason.
#[expect(
    clippy::missing_errors_doc,
    reason = "the trait says what a failure is"
)]
pub trait Model {
    /// Applies a full row of parameters.
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure>;
    /// Writes the measured signals.
    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure>;
    /// Writes the measured signals and marks the invalid ones, whose values do not matter. Called instead of
    /// [`measure`](Model::measure), without any mark at first.
    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        let _ = invalid;
        self.measure(measured)
    }
    /// Writes the truth row.
    fn truth(&mut self, time_s: f64, command: &[f64], truth: &mut [f64]) -> Result<(), Failure>;
    /// Integrates over one interval.
    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure>;

    /// Checks that the model can be integrated over intervals of this length, in s. Called once, before all other
    /// methods.
    ///
    /// # Errors
    /// If the model cannot; the error lists the possible lengths.
    fn check_period(&self, _period_s: f64) -> Result<(), Invalid> {
        Ok(())
    }

    /// Checks that the model began with the parameters with which it was started. Called on the model that runs, not on
    /// a model that is only started to check whether later values of its parameters are consistent.
    ///
    /// # Errors
    /// If the model began with other parameters.
    fn check_start(&self) -> Result<(), Invalid> {
        Ok(())
    }

    /// Returns the names of parameters that cannot be read back, so that changes to them remain unconfirmed.
    fn unreadable(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns the present state.
    ///
    /// # Errors
    /// If the state cannot be saved.
    fn save(&self) -> Result<State, Invalid> {
        Err(cannot_save())
    }

    /// Restores a state.
    ///
    /// # Errors
    /// If the bytes are not a state of this plant.
    fn restore(&mut self, _state: &State) -> Result<(), Invalid> {
        Err(cannot_save())
    }

    /// Returns the named numbers of the present state, in the order of the description.
    ///
    /// # Errors
    /// If the state does not name its numbers.
    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        Err(unnamed())
    }

    /// Returns the derivatives of the model's continuous equations at its state, for a model that states them itself;
    /// `length_s` is the period of the run.
    ///
    /// # Errors
    /// If the model cannot.
    fn differentiated(&mut self, inputs: &[f64], length_s: f64) -> Result<LocalMap, Invalid> {
        let _ = (inputs, length_s);
        Err(unnamed())
    }

    /// Sets the named numbers of the state.
    ///
    /// # Errors
    /// If the state does not name its numbers.
    fn set_numbers(&mut self, _numbers: &[f64]) -> Result<(), Invalid> {
        Err(unnamed())
    }
}

/// Section of a scenario with a plant's parameters.
const SECTION: &str = "plant.parameters";

fn cannot_save() -> Invalid {
    Invalid("the plant cannot save its state; it needs `Plant::state`".into())
}

impl<P: Plant> Model for P {
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        Plant::retune(self, &P::Parameters::from_row(parameters));
        Ok(())
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        measured.copy_from_slice(Plant::measure(self).row());
        Ok(())
    }

    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        measured.copy_from_slice(Plant::read(self, invalid).row());
        Ok(())
    }

    fn truth(&mut self, time_s: f64, command: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
        let command = P::Command::from_row(command);
        truth.copy_from_slice(Plant::truth(self, time_s, &command).row());
        Ok(())
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure> {
        Plant::advance(self, interval, &P::Command::from_row(command));
        Ok(())
    }

    fn save(&self) -> Result<State, Invalid> {
        P::state().ok_or_else(cannot_save)?.save(self)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        P::state().ok_or_else(cannot_save)?.restore(self, state)
    }

    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        P::state().ok_or_else(unnamed)?.numbers(self)
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        P::state().ok_or_else(unnamed)?.set_numbers(self, numbers)
    }
}

/// Constructs a plant from all its parameters, given by name.
pub type StartPlant = Box<dyn Fn(&Settings) -> Result<Box<dyn Model>, Invalid> + Send + Sync>;

/// Plant that can be selected by name: its description and constructor.
pub struct PlantKind {
    /// Description that `--describe` shows.
    pub description: PlantDescription,
    /// Starts the plant from all parameters by name.
    pub start: StartPlant,
}

impl PlantKind {
    /// Creates the entry of a plant type.
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
                port: None,
                state: P::state().and_then(StateOf::fields),
            },
            start: Box::new(|settings| {
                let parameters = settings.to_table(SECTION)?;
                Ok(Box::new(P::start(&parameters)?))
            }),
        }
    }

    /// Creates the entry of a plant whose tables are known at run time; `start` receives the row of its parameters.
    ///
    /// ```
    /// use plant_process::plant::{Model, PlantKind};
    /// use shared_types::describe::PlantDescription;
    /// use shared_types::failure::Failure;
    /// use shared_types::table::Field;
    /// use shared_types::time::Interval;
    ///
    /// /// Draining tanks, as many as a file lists: `x' = -x / tau`.
    /// struct Tanks { tau_s: Vec<f64>, level_m: Vec<f64> }
    ///
    /// impl Model for Tanks {
    ///     fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
    ///         self.tau_s.copy_from_slice(parameters);
    ///         Ok(())
    ///     }
    ///     fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
    ///         measured.copy_from_slice(&self.level_m);
    ///         Ok(())
    ///     }
    ///     fn truth(&mut self, _: f64, _: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
    ///         self.measure(truth)
    ///     }
    ///     fn advance(&mut self, interval: &Interval, _: &[f64]) -> Result<(), Failure> {
    ///         for (level_m, tau_s) in self.level_m.iter_mut().zip(&self.tau_s) {
    ///             *level_m *= libm::exp(-interval.length_s / tau_s);
    ///             if *level_m < 1e-6 {
    ///                 return Err(Failure::diverged("a tank ran dry"));
    ///             }
    ///         }
    ///         Ok(())
    ///     }
    /// }
    ///
    /// let file = "left 10\nright 20"; // read when the program starts
    /// let rows: Vec<(&str, f64)> = (file.lines())
    ///     .filter_map(|line| line.split_once(' '))
    ///     .map(|(tank, tau_s)| (tank, tau_s.parse().expect("a number")))
    ///     .collect();
    /// let level = |(tank, _): &(&str, f64)| Field::signal(&format!("{tank}_m"), "m", "Level.");
    /// let tau = |(tank, tau_s): &(&str, f64)| Field {
    ///     default: Some(*tau_s),
    ///     min: 1e-3,
    ///     max: 1e6,
    ///     faultable: true,
    ///     ..Field::signal(&format!("{tank}.tau_s"), "s", "Time constant.")
    /// };
    /// let description = PlantDescription {
    ///     name: "tanks".into(),
    ///     summary: "Tanks that drain.".into(),
    ///     parameters: rows.iter().map(tau).collect(),
    ///     truth: rows.iter().map(level).collect(),
    ///     measured: rows.iter().map(level).collect(),
    ///     commands: Vec::new(),
    ///     faults: Vec::new(),
    ///     saves: false,
    ///     port: None,
    ///     state: None,
    /// };
    /// let kind = PlantKind::from_tables(description, |tau_s| {
    ///     let (tau_s, level_m) = (tau_s.to_vec(), vec![1.0; tau_s.len()]);
    ///     Ok(Box::new(Tanks { tau_s, level_m }))
    /// })?;
    /// // `main` of the plant: plant_process::program::run("tanks", "0.1.0", vec![kind])
    /// # let mut settings = shared_types::describe::Settings::default();
    /// # settings.set("left.tau_s", 10.0);
    /// # settings.set("right.tau_s", 20.0);
    /// # let mut tanks = (kind.start)(&settings)?;
    /// # let interval = Interval { start_s: 0.0, length_s: 20.0, substeps: 1 };
    /// # tanks.advance(&interval, &[]).expect("no tank is dry");
    /// # let mut level_m = [0.0; 2];
    /// # tanks.measure(&mut level_m).expect("measured");
    /// # assert_eq!(level_m, [libm::exp(-2.0), libm::exp(-1.0)]);
    /// # let long = Interval { length_s: 200.0, ..interval };
    /// # let failure = tanks.advance(&long, &[]).expect_err("dry");
    /// # assert!(failure.is_divergence());
    /// # Ok::<(), shared_types::describe::Invalid>(())
    /// ```
    ///
    /// # Errors
    /// The first unusable row, with its faulty name, unit, text, default or range.
    pub fn from_tables(
        description: PlantDescription,
        start: impl Fn(&[f64]) -> Result<Box<dyn Model>, Invalid> + Send + Sync + 'static,
    ) -> Result<Self, Invalid> {
        description.check_rows()?;
        let fields = description.parameters.clone();
        Ok(Self {
            description,
            start: Box::new(move |settings| start(&settings.row(&fields, SECTION)?)),
        })
    }
}
