//! `trait FaultKind`: what a kind of fault implements.
//!
//! A kind is told its parameters, the moment and the thing it acts on, and nothing else: no clock,
//! no file, no other fault. So the same fault gives the same numbers whether it comes from a
//! scenario, from a command line or from a repeated run.

use serde::{Deserialize, Serialize};
use shared_types::describe::{ActsOn, FaultKindDescription, Invalid, ListDescription, Settings};
use shared_types::directive::Directive;
use shared_types::random::RandomStream;
use shared_types::state::{State, StateOf};
use shared_types::table::Table;
use shared_types::time::Rate;

/// A kind of fault on signals, links or timing, called in this order:
///
/// 1. [`start`](FaultKind::start), once, away from the loop: here it may allocate.
/// 2. [`hold`](FaultKind::hold), at the step at which it takes hold.
/// 3. At every step from then on the one of [`number`](FaultKind::number) (on signals by
///    [`coupled`](FaultKind::coupled)), [`message`](FaultKind::message) and
///    [`timing`](FaultKind::timing) that [`ACTS_ON`] tells, also while its profile is 0. These run in
///    the loop: no allocation, no system call.
///
/// [`ACTS_ON`]: FaultKind::ACTS_ON
pub trait FaultKind: Sized + Send + 'static {
    /// Name in scenarios and on the command line.
    const NAME: &'static str;
    /// Summary in one sentence.
    const SUMMARY: &'static str;
    /// Equation of the effect in plain text; `x` is the healthy value, `g` the profile.
    const EQUATION: &'static str;
    /// Targets that the fault acts on.
    const ACTS_ON: ActsOn;
    /// Parameters. The unit `target` stands for that of the target; one with a default may be
    /// left out.
    type Parameters: Table + Default;

    /// Names of the parameters that have a default and so may be left out. The others must be given.
    const OPTIONAL: &'static [&'static str] = &[];

    /// The list of numbers that it takes besides, if it does.
    #[must_use]
    fn list() -> Option<ListDescription> {
        None
    }

    /// Returns the part of the fault that a checkpoint keeps; `None`: a run with the fault cannot be saved.
    #[must_use]
    fn state() -> Option<StateOf<Self>> {
        None
    }

    /// The fault before it takes hold.
    ///
    /// # Errors
    /// If the parameters, each in its range, do not go together.
    fn start(setup: &Setup<'_, Self::Parameters>) -> Result<Self, Invalid>;

    /// Takes hold. `random` is a stream of the fault's own, keyed by seed, kind, target and step.
    fn hold(&mut self, random: RandomStream) {
        let _ = random;
    }

    /// Returns the reading that a signal or parameter becomes.
    fn number(&mut self, at: &Moment, reading: Reading) -> Reading {
        let _ = at;
        reading
    }

    /// Returns the reading that a signal becomes, of which `row` has all signals of the same direction.
    fn coupled(&mut self, at: &Moment, reading: Reading, row: &[f64]) -> Reading {
        let _ = row;
        self.number(at, reading)
    }

    /// Changes the passage of a message on the link.
    fn message(&mut self, at: &Moment, passage: &mut Passage) {
        let _ = (at, passage);
    }

    /// Changes what a side does with its time.
    fn timing(&mut self, at: &Moment, directive: &mut Directive) {
        let _ = (at, directive);
    }
}

/// Inputs that a fault is started with.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a, P> {
    /// Parameters.
    pub parameters: P,
    /// List, rows one after another; empty if it was given none.
    pub list: &'a [f64],
    /// Steps per second.
    pub rate: Rate,
    /// Number of signals in the row that [`FaultKind::coupled`] gets; 0 where it is not called.
    pub signals: usize,
}

/// The step that a fault acts on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The step.
    pub step: u64,
    /// Steps since the fault took hold.
    pub since_steps: u64,
    /// The same in s.
    pub since_s: f64,
    /// The profile g at this step.
    pub gain: f64,
}

/// A signal's value and whether it is marked valid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Value in the signal's unit.
    pub value: f64,
    /// True if the receiver is told that the value is valid.
    pub valid: bool,
}

/// Passage of one message: how many copies arrive, how late, how broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passage {
    /// For each copy, the steps by which it comes late; `None`: there is no such copy.
    pub copies: [Option<u32>; Self::MOST_COPIES],
    /// For each copy, whether it was overtaken: it comes after everything else that comes at its
    /// step. Otherwise what was sent later is what the receiver has.
    pub overtaken: [bool; Self::MOST_COPIES],
    /// Bits that are inverted, the first `flipped` of these; they count as in
    /// [`Frame::flip`](shared_types::frame::Frame::flip).
    pub flips: [u64; Self::MOST_FLIPS],
    /// Number of `flips` that count.
    pub flipped: usize,
    /// Bits of the message's frame.
    pub bits: u64,
}

impl Passage {
    /// Most copies of one message.
    pub const MOST_COPIES: usize = 4;
    /// Most bits that are inverted in one message.
    pub const MOST_FLIPS: usize = 16;
    /// Latest that a copy may come, in steps; later ones never come.
    pub const LATEST_STEPS: u32 = 1000;

    /// A message of N bits that arrives once, in time and whole.
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

/// A fault of any kind.
pub trait Fault: Send {
    /// Takes hold.
    fn hold(&mut self, random: RandomStream);
    /// Returns the reading that a signal or parameter becomes.
    fn number(&mut self, at: &Moment, reading: Reading) -> Reading;
    /// Returns the reading that a signal becomes, of which `row` has all signals of the same direction.
    fn coupled(&mut self, at: &Moment, reading: Reading, row: &[f64]) -> Reading;
    /// Changes the passage of a message on the link.
    fn message(&mut self, at: &Moment, passage: &mut Passage);
    /// Changes what a side does with its time.
    fn timing(&mut self, at: &Moment, directive: &mut Directive);
    /// Returns the state as it is now.
    ///
    /// # Errors
    /// If it cannot be saved.
    fn save(&self) -> Result<State, Invalid>;
    /// Puts a state back.
    ///
    /// # Errors
    /// If it is not one of a fault of this kind, with these parameters.
    fn restore(&mut self, state: &State) -> Result<(), Invalid>;
}

/// Returns the part of a fault of a kind that is the fault's state.
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

/// Inputs that a fault of any kind is started with.
pub type AnySetup<'a> = Setup<'a, &'a Settings>;

/// A kind of fault that can be chosen by name: its description and how to start one.
#[derive(Clone, Debug)]
pub struct FaultKindEntry {
    /// Description that `--describe` shows.
    pub description: FaultKindDescription,
    /// Starts one.
    pub start: fn(&AnySetup<'_>) -> Result<Box<dyn Fault>, Invalid>,
}

impl FaultKindEntry {
    /// The entry of a kind.
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
                })?;
                Ok(Box::new(fault))
            },
        }
    }
}
