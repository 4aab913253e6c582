//! Effect of a fault: its life cycle, its action, and the size of that action.
//!
//! Created by the fault builder with all the memory it needs, and owned by the layer. An effect waits, acts and ends in
//! this order, and afterwards keeps only its report.

use std::fmt::Write;

use hil_config::plan::{FaultEffect, FaultEnd, Profile};
use serde::{Deserialize, Serialize};
use shared_types::describe::{Invalid, Operation};
use shared_types::random::RandomStream;
use shared_types::record::{FaultBegun, FaultEffectSize};
use shared_types::side::Side;
use shared_types::state::State;
use shared_types::time::{Rate, Step};

use super::arrivals::Arrivals;
use super::kind::{Fault, Moment};
use super::profile::gain;

/// Direction of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// Plant to controller.
    Sample,
    /// Controller to plant.
    Command,
    /// Scenario to plant, not over the link.
    Input,
}

/// Networks on which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Networks {
    /// Every network, each frame alike on all of them.
    All,
    /// The one with this index.
    One(usize),
}

impl Networks {
    /// Splits the name of a direction, as `sample.a`, into direction and network; only with two networks.
    pub(super) fn split(name: &str, networks: u8) -> (&str, Self) {
        match name.split_once('.') {
            Some((direction, "a")) if networks == 2 => (direction, Self::One(0)),
            Some((direction, "b")) if networks == 2 => (direction, Self::One(1)),
            _ => (name, Self::All),
        }
    }
}

/// Action of an effect.
pub(super) enum Action {
    /// Moves parameters by their index.
    Move(Vec<(usize, Operation, f64)>),
    /// Changes a parameter.
    Parameter(usize, Box<dyn Fault>),
    /// Changes a signal: of the sample, measured signals and then reference signals; or a command or driven input of the
    /// plant.
    Signal(Direction, usize, Box<dyn Fault>),
    /// Changes the arrivals; includes the arrivals as if no other fault followed this one.
    Link(Direction, Networks, Box<dyn Fault>, Box<Arrivals>),
    /// Changes when the command takes effect; includes the delay in steps at this step.
    Skip(Box<dyn Fault>, u32),
    /// Costs time and changes nothing else; includes the cost at this step, in ns.
    Busy(Side, Box<dyn Fault>, u32),
    /// Does nothing: the effect has ended and released its resources.
    Over,
}

/// Phase of an effect's life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Life {
    /// Before the effect begins.
    Waits,
    /// Acting since this step.
    Acts(u64),
    /// Ended, or never to begin.
    Ended,
}

/// Effect of a fault.
pub(super) struct Effect {
    pub(super) action: Action,
    pub(super) life: Life,
    /// Delay after the beginning of the effect's event, in steps.
    pub(super) skew_steps: u64,
    /// Number of steps for which the effect acts, if limited.
    after_steps: Option<u64>,
    /// Maximum number of occurrences, if limited.
    most_occurrences: Option<u64>,
    profile: Profile,
    /// Report made when the effect begins.
    beginning: Option<FaultBegun>,
    size: FaultEffectSize,
    /// `true` if the effect acted at the last step; `runs` counts the sequences of such steps.
    acting: bool,
    runs: u64,
}

/// Saved state of an effect.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedEffect {
    life: Life,
    size: FaultEffectSize,
    acting: bool,
    runs: u64,
    /// State of the effect's action while it acts.
    fault: Option<State>,
    arrivals: Option<Arrivals>,
}

impl Action {
    /// Returns the fault of a kind, if the action is one.
    fn fault(&mut self) -> Option<&mut dyn Fault> {
        match self {
            Self::Move(_) | Self::Over => None,
            Self::Parameter(_, fault)
            | Self::Signal(_, _, fault)
            | Self::Link(_, _, fault, _)
            | Self::Skip(fault, _)
            | Self::Busy(_, fault, _) => Some(fault.as_mut()),
        }
    }
}

impl Effect {
    /// Creates a waiting effect whose size is reported in this unit.
    pub(super) fn new(
        beginning: FaultBegun,
        unit: String,
        action: Action,
        plan: &FaultEffect,
        end: &FaultEnd,
    ) -> Self {
        Self {
            action,
            life: Life::Waits,
            skew_steps: plan.skew_steps,
            after_steps: end.after_steps,
            most_occurrences: end.occurrences,
            profile: plan.profile.clone(),
            size: FaultEffectSize {
                id: beginning.id,
                effect: beginning.effect,
                kind: beginning.kind.clone(),
                target: beginning.target.clone(),
                parameter: beginning.parameter.clone(),
                step: None,
                ended_step: None,
                acted_steps: 0,
                max_effect: 0.0,
                unit,
            },
            beginning: Some(beginning),
            acting: false,
            runs: 0,
        }
    }

    /// Returns the state.
    pub(super) fn save(&mut self) -> Result<SavedEffect, Invalid> {
        let acts = matches!(self.life, Life::Acts(_));
        let fault = self.action.fault().filter(|_| acts);
        Ok(SavedEffect {
            life: self.life,
            size: self.size.clone(),
            acting: self.acting,
            runs: self.runs,
            fault: fault.map(|fault| fault.save()).transpose()?,
            arrivals: match &self.action {
                Action::Link(_, _, _, arrivals) if acts => Some(Arrivals::clone(arrivals)),
                _ => None,
            },
        })
    }

    /// Restores a saved state, if it belongs to an effect of this fault on this target.
    pub(super) fn restore(&mut self, saved: &SavedEffect) -> Result<(), Invalid> {
        let what = |size: &FaultEffectSize| {
            format!("fault {} `{}` on {}", size.id, size.kind, size.target)
        };
        let (theirs, ours) = (what(&saved.size), what(&self.size));
        if theirs != ours {
            return Err(Invalid(format!(
                "the state was saved for {theirs}, not for {ours}"
            )));
        }
        self.life = saved.life;
        self.size = FaultEffectSize {
            parameter: std::mem::take(&mut self.size.parameter),
            unit: std::mem::take(&mut self.size.unit),
            ..saved.size.clone()
        };
        (self.acting, self.runs) = (saved.acting, saved.runs);
        if let (Some(fault), Some(state)) = (self.action.fault(), &saved.fault) {
            let named = |Invalid(why)| Invalid(format!("{ours}: {why}"));
            fault.restore(state).map_err(named)?;
        }
        if let (Action::Link(_, _, _, arrivals), Some(saved)) = (&mut self.action, &saved.arrivals)
        {
            arrivals.restore(saved)?;
        }
        Ok(())
    }

    /// Returns the report on the effect so far.
    pub(super) const fn size(&self) -> &FaultEffectSize {
        &self.size
    }

    /// Begins the effect at a step.
    pub(super) const fn hold(&mut self, step: Step) {
        self.life = Life::Acts(step.0);
        self.size.step = Some(step.0);
    }

    /// Assigns random numbers to a fault that has begun. `twins` is the number of effects that would otherwise use the
    /// same numbers; `path` is a reusable buffer.
    pub(super) fn start(&mut self, seed: u64, twins: usize, path: &mut String) {
        let FaultEffectSize {
            kind, target, step, ..
        } = &self.size;
        let Some(fault) = self.action.fault() else {
            return;
        };
        let step = step.unwrap_or_default();
        path.clear();
        // Writing to a string cannot fail.
        let _ = write!(path, "{kind}/{target}/{step}/{twins}");
        fault.hold(RandomStream::new(seed, path));
    }

    /// Returns the maximum length of the path of the effect's random numbers.
    pub(super) fn path_length(&self) -> usize {
        const NUMBERS: usize = "/18446744073709551615/18446744073709551615/".len();
        self.size.kind.len() + self.size.target.len() + NUMBERS
    }

    /// Returns `true` if both effects are of one kind and act on one target since the same step.
    pub(super) fn is_twin_of(&self, other: &Self) -> bool {
        self.life == other.life
            && self.size.kind == other.size.kind
            && self.size.target == other.size.target
    }

    /// Takes the report of the beginning, once the effect has begun.
    pub(super) fn take_taken(&mut self) -> Option<FaultBegun> {
        let mut beginning = self.beginning.take()?;
        beginning.step = self.size.step?;
        Some(beginning)
    }

    /// Ends the effect; this step is already healthy.
    pub(super) const fn end(&mut self, step: Step) {
        if matches!(self.life, Life::Acts(_)) {
            self.size.ended_step = Some(step.0);
        }
        self.life = Life::Ended;
    }

    /// Releases the resources of an ended effect.
    pub(super) fn retire(&mut self) {
        self.action = Action::Over;
        self.profile = Profile::Step;
        self.beginning = None;
    }

    /// Returns the step at which the effect ends by itself, if known.
    pub(super) const fn own_end(&self) -> Option<u64> {
        match (self.life, self.after_steps) {
            (Life::Acts(since), Some(steps)) => Some(since.saturating_add(steps)),
            _ => None,
        }
    }

    /// Returns the time and profile value at which the effect acts.
    pub(super) fn moment(&self, step: Step, rate: Rate) -> Moment {
        let since = match self.life {
            Life::Acts(since) => since,
            Life::Waits | Life::Ended => step.0,
        };
        // From the difference of steps, so that the course does not depend on the beginning.
        let since_steps = step.0 - since;
        let since_s = rate.seconds(Step(since_steps));
        Moment {
            step: step.0,
            since_steps,
            since_s,
            gain: gain(&self.profile, since_s),
        }
    }

    /// Records the effect's action at a step. `change` is also 0 if only the validity changed.
    pub(super) fn note(&mut self, acted: bool, change: f64) {
        self.size.acted_steps += u64::from(acted);
        self.runs += u64::from(acted && !self.acting);
        self.acting = acted;
        self.grow(change);
    }

    /// Records the size of the effect's action.
    pub(super) fn grow(&mut self, change: f64) {
        if change > self.size.max_effect {
            // The difference of two finite numbers can overflow.
            self.size.max_effect = if change.is_finite() { change } else { f64::MAX };
        }
    }

    /// Returns `true` if the effect has completed its maximum number of occurrences. For effects on numbers an
    /// occurrence is a sequence of steps; for effects on messages or time it is a single step.
    pub(super) fn is_spent(&self) -> bool {
        let occurrences = match self.action {
            Action::Link(..) | Action::Skip(..) | Action::Busy(..) => self.size.acted_steps,
            Action::Move(_) | Action::Parameter(..) | Action::Signal(..) | Action::Over => {
                self.runs - u64::from(self.acting)
            }
        };
        (self.most_occurrences).is_some_and(|most| occurrences >= most)
    }

    /// Returns `true` if the effect has a maximum number of occurrences.
    pub(super) const fn is_counted(&self) -> bool {
        self.most_occurrences.is_some()
    }
}
