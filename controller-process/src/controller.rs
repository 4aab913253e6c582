//! `trait Controller`: the interface of a control law, and the runner's view of it as rows of numbers.
//!
//! A law depends only on its configuration and the sample: no clock, no file, no random number. Therefore the same
//! binary can answer a simulated plant today and a real one tomorrow.

use shared_types::describe::{Invalid, LawDescription, Settings};
use shared_types::failure::Failure;
use shared_types::local_map::LocalMap;
use shared_types::quality::{Quality, SignalSet};
use shared_types::state::{State, StateOf, unnamed};
use shared_types::table::{self, Field, Table};

/// A control law, called in this order:
///
/// 1. [`start`](Controller::start), once.
/// 2. [`step`](Controller::step) with every sample, one period apart; preceded by the function of
///    [`tuning`](Controller::tuning) if a parameter was changed.
///
/// At a checkpoint the state defined by [`state`](Controller::state) is saved between two samples. A resumed run starts
/// the law, restores the state and continues with 2.
///
/// A law must be deterministic; use `libm` for sines and exponentials.
pub trait Controller: Sized + 'static {
    /// Name in scenarios.
    const NAME: &'static str;
    /// One-sentence summary.
    const SUMMARY: &'static str;
    /// Names of the plants that the law is made for; empty means any plant.
    const PLANTS: &'static [&'static str] = &[];
    /// Parameters of the law, each with a default; mark as `tunable` those that may change during a run.
    type Parameters: table::Parameters;
    /// The law's model of the plant; [`Empty`](shared_types::table::Empty) for a law without a model.
    type Model: table::Parameters;
    /// Measured signals that the law needs, bound by name and unit.
    type Measured: Table;
    /// Reference signals that the law needs, bound by name and unit.
    type Reference: Table;
    /// Commands that the law sends.
    type Command: Table;
    /// Internal signals that the law exposes, recorded along with the commands.
    type Internals: Table;

    /// Returns the part of the law that a checkpoint keeps; `None` if a run of the law cannot be saved.
    #[must_use]
    fn state() -> Option<StateOf<Self>> {
        None
    }

    /// Returns the way in which the law applies new values of its `tunable` parameters during a run; `None` if none of
    /// them can be changed.
    #[must_use]
    fn tuning() -> Option<Tuning<Self>> {
        None
    }

    /// Creates the law before its first sample.
    ///
    /// # Errors
    /// If the parameters are inconsistent, although each is in its range.
    fn start(setup: &Setup<Self>) -> Result<Self, Invalid>;

    /// Returns the command that answers a sample.
    fn step(&mut self, sample: &Sample<Self>) -> (Self::Command, Self::Internals);

    /// Answers a sample as [`step`](Controller::step) does, which it calls by default, and is called instead. The law
    /// also gets the validity and age of each signal, and may mark commands in `held`: the plant keeps what it last
    /// applied of them, and their value does not matter.
    fn answer(
        &mut self,
        sample: &Sample<Self>,
        quality: &Quality<'_>,
        held: &mut SignalSet,
    ) -> (Self::Command, Self::Internals) {
        let _ = (quality, held);
        self.step(sample)
    }
}

/// Changes of a law's parameters during a run.
pub struct Tuning<C: Controller> {
    /// Sentence for users on the behaviour of the command when parameters change.
    pub does: &'static str,
    /// Applies the values, before the [`step`](Controller::step) from which they are valid, without allocating.
    /// [`start`](Controller::start) has already validated the combination.
    pub take: fn(&mut C, &Setup<C>, Transition),
}

/// Transition from old to new parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transition {
    /// At least one value jumps.
    Step,
    /// All changing values are on a ramp, and still unchanged at the first sample of the ramp.
    Ramp,
}

/// Configuration of a law.
#[derive(Clone, Copy, Debug)]
pub struct Setup<C: Controller> {
    /// Parameters of the law.
    pub parameters: C::Parameters,
    /// The law's model of the plant.
    pub model: C::Model,
    /// Time between two samples of the law, in s.
    pub period_s: f64,
}

/// Sample of a step, as seen by a law.
#[derive(Clone, Copy, Debug)]
pub struct Sample<C: Controller> {
    /// Simulated time of the sample in s.
    pub time_s: f64,
    /// Measured signals.
    pub measured: C::Measured,
    /// Reference signals.
    pub reference: C::Reference,
    /// `true` if every one of these signals is marked valid.
    pub valid: bool,
    /// Number of steps for which the plant has held its last applied command, because a newer one was late; 0 except in
    /// real time.
    pub held_steps: u32,
}

/// Law of any type, as rows of numbers in the order of its tables.
///
/// Every [`Controller`] implements this trait. A law whose tables are known only at run time implements the trait
/// directly and becomes a [`LawKind`] by [`from_tables`](LawKind::from_tables).
pub trait Law {
    /// Answers a sample: writes the command row and the row of internals.
    ///
    /// # Errors
    /// The reason why the law cannot continue: the controller aborts at this step with that reason.
    fn step(
        &mut self,
        sample: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure>;

    /// Answers a sample as [`step`](Law::step) does, with the validity and age of each signal; called instead of it.
    ///
    /// # Errors
    /// As of [`step`](Law::step).
    fn answer(
        &mut self,
        sample: &Row<'_>,
        quality: &Quality<'_>,
        answer: Answer<'_>,
    ) -> Result<(), Failure> {
        let _ = quality;
        self.step(sample, answer.command, answer.internals)
    }

    /// Checks that the law began with the parameters with which it was started. Called on the law that runs, not on a
    /// law that is only started to check whether later values of its parameters are consistent.
    ///
    /// # Errors
    /// If the law began with other parameters.
    fn check_start(&self) -> Result<(), Invalid> {
        Ok(())
    }

    /// Returns the names of parameters that cannot be read back, so that changes to them remain unconfirmed.
    fn unreadable(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns the current state of the law.
    ///
    /// # Errors
    /// If the state cannot be saved.
    fn save(&self) -> Result<State, Invalid> {
        Err(cannot_save())
    }

    /// Restores a state.
    ///
    /// # Errors
    /// If the bytes are not a state of this law.
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

    /// Sets the named numbers of the state.
    ///
    /// # Errors
    /// If the state does not name its numbers.
    fn set_numbers(&mut self, _numbers: &[f64]) -> Result<(), Invalid> {
        Err(unnamed())
    }

    /// Returns the derivatives of the law's continuous equations at its state, for a law that states them itself; a
    /// step of such a law advances them by its period `length_s` and then reads the command. `sample` has the measured
    /// and then the reference signals.
    ///
    /// # Errors
    /// If the law cannot.
    fn differentiated(&mut self, sample: &[f64], length_s: f64) -> Result<LocalMap, Invalid> {
        let _ = (sample, length_s);
        Err(unnamed())
    }

    /// Applies new values of the parameters, before the step from which they are valid. Called only for a law with
    /// tunable parameters.
    fn retune(&mut self, _setup: &TunedRows<'_>, _transition: Transition) {}
}

/// Answer that a law writes, as rows.
#[derive(Debug)]
pub struct Answer<'a> {
    /// Commands in the law's order.
    pub command: &'a mut [f64],
    /// Internals in the law's order.
    pub internals: &'a mut [f64],
    /// Commands that the law does not refresh at this step; their values are ignored. Empty on entry.
    pub held: &'a mut SignalSet,
}

/// Configuration of a tuned law, as rows in the order of its tables.
#[derive(Clone, Copy, Debug)]
pub struct TunedRows<'a> {
    /// Every parameter of the law.
    pub parameters: &'a [f64],
    /// The law's model of the plant.
    pub model: &'a [f64],
    /// Time between two samples of the law, in s.
    pub period_s: f64,
}

fn cannot_save() -> Invalid {
    Invalid("the law cannot save its state; it needs `Controller::state`".into())
}

/// Sample as rows.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// Simulated time at the start of the interval, in s.
    pub time_s: f64,
    /// Measured signals in the law's order.
    pub measured: &'a [f64],
    /// Reference signals in the law's order.
    pub reference: &'a [f64],
    /// `true` if all of these signals are valid.
    pub valid: bool,
    /// Number of steps for which the plant has held its last applied command, because a newer one was late; 0 except in
    /// real time.
    pub held_steps: u32,
}

impl<C: Controller> Sample<C> {
    fn of(row: &Row<'_>) -> Self {
        Self {
            time_s: row.time_s,
            measured: C::Measured::from_row(row.measured),
            reference: C::Reference::from_row(row.reference),
            valid: row.valid,
            held_steps: row.held_steps,
        }
    }
}

impl<C: Controller> Law for C {
    fn step(
        &mut self,
        row: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        let (commanded, internal_table) = Controller::step(self, &Sample::of(row));
        command.copy_from_slice(commanded.row());
        internals.copy_from_slice(internal_table.row());
        Ok(())
    }

    fn answer(
        &mut self,
        row: &Row<'_>,
        quality: &Quality<'_>,
        answer: Answer<'_>,
    ) -> Result<(), Failure> {
        let sample = Sample::of(row);
        let (commanded, internal_table) = Controller::answer(self, &sample, quality, answer.held);
        answer.command.copy_from_slice(commanded.row());
        answer.internals.copy_from_slice(internal_table.row());
        Ok(())
    }

    fn save(&self) -> Result<State, Invalid> {
        C::state().ok_or_else(cannot_save)?.save(self)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        C::state().ok_or_else(cannot_save)?.restore(self, state)
    }

    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        C::state().ok_or_else(unnamed)?.numbers(self)
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        C::state().ok_or_else(unnamed)?.set_numbers(self, numbers)
    }

    fn retune(&mut self, setup: &TunedRows<'_>, transition: Transition) {
        if let Some(tuning) = C::tuning() {
            let setup = Setup {
                parameters: C::Parameters::from_row(setup.parameters),
                model: C::Model::from_row(setup.model),
                period_s: setup.period_s,
            };
            (tuning.take)(self, &setup, transition);
        }
    }
}

/// Configuration for starting a law of any type.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// Every parameter by name.
    pub parameters: &'a Settings,
    /// The law's model of the plant, by name.
    pub model: &'a Settings,
    /// Time between two samples of the law, in s.
    pub period_s: f64,
    /// Commands to send, in the law's order.
    pub commands: &'a [Field],
}

/// Configuration of a law whose tables are known only at run time, as rows in the order of its tables.
#[derive(Clone, Copy, Debug)]
pub struct SetupRows<'a> {
    /// Parameters of the law.
    pub parameters: &'a [f64],
    /// The law's model of the plant.
    pub model: &'a [f64],
    /// Time between two samples of the law, in s.
    pub period_s: f64,
    /// Commands to send, in the law's order.
    pub commands: &'a [Field],
}

/// Constructor of a law.
pub type StartLaw = Box<dyn Fn(&Start<'_>) -> Result<Box<dyn Law>, Invalid> + Send + Sync>;

/// Section of a scenario with a law's model of the plant.
const MODEL: &str = "controller.model";

/// Law that can be selected by name: its description and constructor.
pub struct LawKind {
    /// Description that `--describe` shows.
    pub description: LawDescription,
    /// Starts it.
    pub start: StartLaw,
}

impl LawKind {
    /// Creates the entry of a law type.
    #[must_use]
    pub fn of<C: Controller>() -> Self {
        let tuning = C::tuning();
        let mut parameters = C::Parameters::fields();
        for field in &mut parameters {
            field.tunable &= tuning.is_some();
        }
        let is_tunable = parameters.iter().any(|field| field.tunable);
        Self {
            description: LawDescription {
                name: C::NAME.into(),
                summary: C::SUMMARY.into(),
                plants: C::PLANTS.iter().map(|&name| name.into()).collect(),
                parameters,
                model: C::Model::fields(),
                measured: C::Measured::fields(),
                reference: C::Reference::fields(),
                commands: Some(C::Command::fields()),
                internals: C::Internals::fields(),
                saves: C::state().is_some(),
                state: C::state().and_then(StateOf::fields),
                tuning: (tuning.filter(|_| is_tunable))
                    .map_or_else(String::new, |tuning| tuning.does.into()),
            },
            start: Box::new(|start| {
                let section = format!("controller.{}", C::NAME);
                let setup = Setup {
                    parameters: start.parameters.to_table(&section)?,
                    model: start.model.to_table(MODEL)?,
                    period_s: start.period_s,
                };
                Ok(Box::new(C::start(&setup)?))
            }),
        }
    }

    /// Creates the entry of a law whose tables are known at run time.
    ///
    /// ```
    /// use controller_process::controller::{Law, LawKind, Row, SetupRows};
    /// use shared_types::describe::LawDescription;
    /// use shared_types::failure::Failure;
    /// use shared_types::table::Field;
    ///
    /// /// Product of a row of gains and all measured signals, as many as a file lists.
    /// struct Gains(Vec<f64>);
    ///
    /// impl Law for Gains {
    ///     fn step(&mut self, row: &Row<'_>, command: &mut [f64], _: &mut [f64]) -> Result<(), Failure> {
    ///         if !row.valid {
    ///             return Err(Failure::lost("a sensor is gone"));
    ///         }
    ///         command[0] = row.measured.iter().zip(&self.0).map(|(x, k)| -k * x).sum();
    ///         Ok(())
    ///     }
    /// }
    ///
    /// let file = "angle_rad rad 9\nrate_radps rad/s 3"; // read when the program starts
    /// let (mut measured, mut parameters) = (Vec::new(), Vec::new());
    /// for line in file.lines() {
    ///     let words: Vec<&str> = line.split(' ').collect();
    ///     measured.push(Field::signal(words[0], words[1], "Measured."));
    ///     parameters.push(Field {
    ///         default: words[2].parse().ok(),
    ///         ..Field::signal(&format!("gain.{}", words[0]), "1", "Gain.")
    ///     });
    /// }
    /// let description = LawDescription {
    ///     name: "gains".into(),
    ///     summary: "A row of gains.".into(),
    ///     plants: Vec::new(),
    ///     parameters,
    ///     model: Vec::new(),
    ///     measured,
    ///     reference: Vec::new(),
    ///     commands: Some(vec![Field::signal("torque_nm", "N m", "Torque.")]),
    ///     internals: Vec::new(),
    ///     saves: false,
    ///     state: None,
    ///     tuning: String::new(),
    /// };
    /// let kind = LawKind::from_tables(description, |setup: &SetupRows<'_>| {
    ///     Ok(Box::new(Gains(setup.parameters.to_vec())))
    /// })?;
    /// // `main` of the controller: controller_process::program::run("gains", "0.1.0", vec![kind])
    /// # use controller_process::controller::Start;
    /// # use shared_types::describe::Settings;
    /// # let (mut parameters, model) = (Settings::default(), Settings::default());
    /// # for field in &kind.description.parameters {
    /// #     parameters.set(&field.name, field.default.expect("a default"));
    /// # }
    /// # let (parameters, model) = (&parameters, &model);
    /// # let start = Start { parameters, model, period_s: 0.1, commands: &[] };
    /// # let mut law = (kind.start)(&start)?;
    /// # let row = Row { time_s: 0.0, measured: &[0.5, 2.0], reference: &[], valid: true, held_steps: 0 };
    /// # let mut command = [0.0];
    /// # law.step(&row, &mut command, &mut []).expect("answers");
    /// # assert_eq!(command, [-10.5]);
    /// # let row = Row { valid: false, ..row };
    /// # assert_eq!(law.step(&row, &mut command, &mut []), Err(Failure::lost("a sensor is gone")));
    /// # Ok::<(), shared_types::describe::Invalid>(())
    /// ```
    ///
    /// # Errors
    /// The first unusable row, with its faulty name, unit, text, default or range.
    pub fn from_tables(
        description: LawDescription,
        start: impl Fn(&SetupRows<'_>) -> Result<Box<dyn Law>, Invalid> + Send + Sync + 'static,
    ) -> Result<Self, Invalid> {
        description.check_rows()?;
        let section = format!("controller.{}", description.name);
        let (parameters, model) = (description.parameters.clone(), description.model.clone());
        Ok(Self {
            description,
            start: Box::new(move |settings| {
                start(&SetupRows {
                    parameters: &settings.parameters.row(&parameters, &section)?,
                    model: &settings.model.row(&model, MODEL)?,
                    period_s: settings.period_s,
                    commands: settings.commands,
                })
            }),
        })
    }
}
