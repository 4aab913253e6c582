//! `trait FaultKind`: the interface of a fault kind.
//!
//! A kind receives only its parameters, the moment and its target: no clock, no file and no other fault. The same fault
//! therefore gives the same numbers whether it comes from a scenario, from a command line or from a repeated run.

use serde::{Deserialize, Serialize};
use shared_types::describe::{ActsOn, FaultKindDescription, Invalid, ListDescription, Settings};
use shared_types::directive::Directive;
use shared_types::random::RandomStream;
use shared_types::state::{State, StateOf};
use shared_types::table::Table;
use shared_types::time::Rate;

/// Kind of fault on signals, links or timing, called in this order:
///
/// 1. [`start`](FaultKind::start), once, away from the loop: here it may allocate.
/// 2. [`hold`](FaultKind::hold), at the step at which the fault takes effect.
/// 3. At every later step, even while its profile is 0, the method that matches [`ACTS_ON`]:
///    [`number`](FaultKind::number) (on signals by [`coupled`](FaultKind::coupled)), [`message`](FaultKind::message) or
///    [`timing`](FaultKind::timing). These methods run in the loop: no allocation, no system call.
///
/// [`ACTS_ON`]: FaultKind::ACTS_ON
pub trait FaultKind: Sized + Send + 'static {
    /// Name in scenarios and on the command line.
    const NAME: &'static str;
    /// One-sentence summary.
    const SUMMARY: &'static str;
    /// Equation of the effect in plain text; `x` is the healthy value, `g` the profile.
    const EQUATION: &'static str;
    /// Targets that the fault acts on.
    const ACTS_ON: ActsOn;
    /// Parameters. The unit `target` stands for the target's unit; a parameter with a default may be omitted.
    type Parameters: Table + Default;

    /// Names of the parameters that have a default and so may be omitted. The other parameters are required.
    const OPTIONAL: &'static [&'static str] = &[];

    /// Returns the description of an additional list of numbers, if the kind accepts one.
    #[must_use]
    fn list() -> Option<ListDescription> {
        None
    }

    /// Returns the part of the fault that a checkpoint keeps; `None` if a run with the fault cannot be saved.
    #[must_use]
    fn state() -> Option<StateOf<Self>> {
        None
    }

    /// Creates the fault before it begins.
    ///
    /// # Errors
    /// If the parameters are inconsistent, although each is in its range.
    fn start(setup: &Setup<'_, Self::Parameters>) -> Result<Self, Invalid>;

    /// Begins the fault. `random` is the fault's own stream, derived from seed, kind, target and step.
    fn hold(&mut self, random: RandomStream) {
        let _ = random;
    }

    /// Returns the faulty reading of a signal or parameter.
    fn number(&mut self, at: &Moment, reading: Reading) -> Reading {
        let _ = at;
        reading
    }

    /// Returns the faulty reading of a signal; `row` has all signals of the same direction.
    fn coupled(&mut self, at: &Moment, reading: Reading, row: &[f64]) -> Reading {
        let _ = row;
        self.number(at, reading)
    }

    /// Changes the passage of a message on the link.
    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        let _ = (at, passage);
    }

    /// Changes the timing of a side.
    fn timing(&mut self, at: &Moment, directive: &mut Directive) {
        let _ = (at, directive);
    }
}

/// Inputs for starting a fault.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a, P> {
    /// Parameters.
    pub parameters: P,
    /// Concatenated rows of the list; empty if there is none.
    pub list: &'a [f64],
    /// Steps per second.
    pub rate: Rate,
    /// Number of signals in the row that [`FaultKind::coupled`] receives; 0 for kinds without that method.
    pub signals: usize,
    /// `true` for a stage of an instrument, `false` for a fault.
    pub is_instrument: bool,
}

/// Step at which a fault acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The step.
    pub step: u64,
    /// Steps since the beginning of the fault.
    pub since_steps: u64,
    /// Seconds since the beginning of the fault.
    pub since_s: f64,
    /// The profile g at this step.
    pub gain: f64,
}

/// Value of a signal and its validity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Value in the signal's unit.
    pub value: f64,
    /// `true` if the value is marked as valid to the receiver.
    pub valid: bool,
}

/// Passage of one message: number of copies, delays and corruption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passage {
    /// Delay of each copy in steps; `None` if the copy does not exist.
    pub copies: [Option<u32>; Self::MOST_COPIES],
    /// `true` for each overtaken copy, which arrives after everything else at its step. Otherwise the message sent
    /// later wins.
    pub overtaken: [bool; Self::MOST_COPIES],
    /// Bits to invert, of which only the first `flipped` are used; numbered as in
    /// [`Frame::flip`](shared_types::frame::Frame::flip).
    pub flips: [u64; Self::MOST_FLIPS],
    /// Number of `flips` in use.
    pub flipped: usize,
    /// Bits of the message's frame.
    pub bits: u64,
}

impl Passage {
    /// Maximum number of copies of one message.
    pub const MOST_COPIES: usize = 4;
    /// Maximum number of inverted bits in one message.
    pub const MOST_FLIPS: usize = 16;
    /// Maximum delay of a copy, in steps; a copy with a longer delay never arrives.
    pub const LATEST_STEPS: u32 = 1000;

    /// Creates the passage of a message of N bits that arrives once, on time and intact.
    #[must_use]
    pub const fn healthy(bits: u64) -> Self {
        Self {
            copies: [Some(0), None, None, None],
            overtaken: [false; Self::MOST_COPIES],
            flips: [0; Self::MOST_FLIPS],
            flipped: 0,
            bits,
        }
    }
}

/// Fault of any kind.
pub trait Fault: Send {
    /// Begins.
    fn hold(&mut self, random: RandomStream);
    /// Returns the faulty reading of a signal or parameter.
    fn number(&mut self, at: &Moment, reading: Reading) -> Reading;
    /// Returns the faulty reading of a signal; `row` has all signals of the same direction.
    fn coupled(&mut self, at: &Moment, reading: Reading, row: &[f64]) -> Reading;
    /// Changes the passage of a message on the link.
    fn message(&mut self, at: &Moment, passage: &mut Passage);
    /// Changes the timing of a side.
    fn timing(&mut self, at: &Moment, directive: &mut Directive);
    /// Returns the present state.
    ///
    /// # Errors
    /// If the state cannot be saved.
    fn save(&self) -> Result<State, Invalid>;
    /// Restores a saved state.
    ///
    /// # Errors
    /// If the bytes are not a state of this kind with these parameters.
    fn restore(&mut self, state: &State) -> Result<(), Invalid>;
}

/// Returns the state declaration of a fault kind.
fn state_of<K: FaultKind>() -> Result<StateOf<K>, Invalid> {
    let kind = K::NAME;
    K::state().ok_or_else(|| {
        Invalid(format!(
            "fault `{kind}` cannot save its state; it needs `FaultKind::state`"
        ))
    })
}

impl<K: FaultKind> Fault for K {
    fn hold(&mut self, random: RandomStream) {
        FaultKind::hold(self, random);
    }

    fn number(&mut self, at: &Moment, reading: Reading) -> Reading {
        FaultKind::number(self, at, reading)
    }

    fn coupled(&mut self, at: &Moment, reading: Reading, row: &[f64]) -> Reading {
        FaultKind::coupled(self, at, reading, row)
    }

    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        FaultKind::message(self, at, passage);
    }

    fn timing(&mut self, at: &Moment, directive: &mut Directive) {
        FaultKind::timing(self, at, directive);
    }

    fn save(&self) -> Result<State, Invalid> {
        state_of()?.save(self)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        state_of()?.restore(self, state)
    }
}

/// Inputs for starting a fault of any kind.
pub type AnySetup<'a> = Setup<'a, &'a Settings>;

/// Fault kind that can be selected by name: its description and constructor.
#[derive(Clone, Debug)]
pub struct FaultKindEntry {
    /// Description that `--describe` shows.
    pub description: FaultKindDescription,
    /// Starts a fault.
    pub start: fn(&AnySetup<'_>) -> Result<Box<dyn Fault>, Invalid>,
}

impl FaultKindEntry {
    /// Creates the entry of a kind.
    #[must_use]
    pub fn of<K: FaultKind>() -> Self {
        let mut parameters = K::Parameters::fields();
        for field in &mut parameters {
            if !K::OPTIONAL.contains(&field.name.as_str()) {
                field.default = None;
            }
        }
        Self {
            description: FaultKindDescription {
                kind: K::NAME.into(),
                summary: K::SUMMARY.into(),
                equation: K::EQUATION.into(),
                acts_on: K::ACTS_ON,
                parameters,
                list: K::list(),
                saves: K::state().is_some(),
            },
            start: |setup| {
                let fault = K::start(&Setup {
                    parameters: setup.parameters.to_table("faults.effects")?,
                    list: setup.list,
                    rate: setup.rate,
                    signals: setup.signals,
                    is_instrument: setup.is_instrument,
                })?;
                Ok(Box::new(fault))
            },
        }
    }
}
