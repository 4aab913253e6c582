//! One effect of a fault: where it is in its life, what it does, and how much it did.
//!
//! Owned by the layer. An effect waits, acts and has ended; it never goes back.

use hil_config::plan::Profile;
use shared_types::describe::Operation;
use shared_types::random::RandomStream;
use shared_types::record::{FaultEffectSize, FaultTaken};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use super::kind::{Fault, Moment};
use super::profile::gain;

/// A direction of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// Plant to controller.
    Sample,
    /// Controller to plant.
    Command,
}

/// A side of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// The controller.
    Controller,
    /// The plant.
    Plant,
}

/// What an effect does.
pub(super) enum Action {
    /// Moves parameters by their index.
    Move(Vec<(usize, Operation, f64)>),
    /// Changes a parameter.
    Parameter(usize, Box<dyn Fault>),
    /// Changes a signal of the sample: measured signals, then reference signals.
    Sample(usize, Box<dyn Fault>),
    /// Changes a command of the plant.
    Command(usize, Box<dyn Fault>),
    /// Changes what arrives.
    Link(Direction, Box<dyn Fault>),
    /// Changes when the command takes effect.
    Timing(Box<dyn Fault>),
    /// Costs time and changes nothing else.
    Busy(Side, Box<dyn Fault>),
}

/// Where an effect is in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Life {
    /// It has not taken hold.
    Waits,
    /// It has taken hold.
    Acts,
    /// It has ended, or never took hold and never will.
    Ended,
}

/// An effect.
pub(super) struct Effect {
    pub(super) taken: FaultTaken,
    pub(super) skew_steps: u64,
    pub(super) profile: Profile,
    pub(super) action: Action,
    pub(super) life: Life,
    unit: String,
    ended_step: Option<u64>,
    acting: bool,
    acted_steps: u64,
    /// How often it began to act.
    runs: u64,
    max_effect: f64,
}

impl Effect {
    pub(super) fn new(
        taken: FaultTaken,
        skew_steps: u64,
        profile: Profile,
        action: Action,
        unit: String,
    ) -> Self {
        Self {
            taken,
            skew_steps,
            profile,
            action,
            unit,
            life: Life::Waits,
            ended_step: None,
            acting: false,
            acted_steps: 0,
            runs: 0,
            max_effect: 0.0,
        }
    }

    /// Takes hold. `ordinal` tells apart what would otherwise draw the same random numbers.
    pub(super) fn hold(&mut self, step: Step, seed: u64, ordinal: usize) {
        self.life = Life::Acts;
        self.taken.step = step.0;
        let FaultTaken { kind, target, .. } = &self.taken;
        match &mut self.action {
            Action::Move(_) => {}
            Action::Parameter(_, fault)
            | Action::Sample(_, fault)
            | Action::Command(_, fault)
            | Action::Link(_, fault)
            | Action::Timing(fault)
            | Action::Busy(_, fault) => {
                let path = format!("{kind}/{target}/{step}/{ordinal}");
                fault.hold(RandomStream::new(seed, &path));
            }
        }
    }

    /// Ends; it is healthy again from this step on.
    pub(super) fn end(&mut self, step: Step) {
        if self.life == Life::Acts {
            self.ended_step = Some(step.0);
        }
        self.life = Life::Ended;
    }

    /// The step it acts on.
    pub(super) fn moment(&self, step: Step, rate: Rate) -> Moment {
        // From the steps' difference, so that the course is the same whenever it begins.
        let since_steps = step.0 - self.taken.step;
        let since_s = rate.seconds(Step(since_steps));
        Moment {
            step: step.0,
            since_steps,
            since_s,
            gain: gain(&self.profile, since_s),
        }
    }

    /// Notes what it did at a step. `change` is 0 also where only the validity changed.
    pub(super) fn note(&mut self, acted: bool, change: f64) {
        if acted {
            self.acted_steps += 1;
            self.runs += u64::from(!self.acting);
            self.grow(change);
        }
        self.acting = acted;
    }

    /// Notes the size of what it did, known only now.
    pub(super) fn grow(&mut self, change: f64) {
        if change > self.max_effect {
            self.max_effect = change;
        }
    }

    /// Whether it did something at the last step.
    pub(super) const fn is_acting(&self) -> bool {
        self.acting
    }

    /// How often it acted, all of it over: runs of steps for what changes a number, single steps
    /// for what strikes messages or time.
    pub(super) const fn occurrences(&self) -> u64 {
        match self.action {
            Action::Link(..) | Action::Timing(..) | Action::Busy(..) => self.acted_steps,
            _ if self.acting => self.runs - 1,
            _ => self.runs,
        }
    }

    pub(super) fn size(&self) -> FaultEffectSize {
        let held = self.life == Life::Acts || self.ended_step.is_some();
        FaultEffectSize {
            id: self.taken.id,
            effect: self.taken.effect,
            kind: self.taken.kind.clone(),
            target: self.taken.target.clone(),
            parameter: self.taken.parameter.clone(),
            step: held.then_some(self.taken.step),
            ended_step: self.ended_step,
            acted_steps: self.acted_steps,
            max_effect: self.max_effect,
            unit: self.unit.clone(),
        }
    }
}

/// A parameter after an operation, kept in its range; an impossible value changes nothing.
pub(super) fn moved(field: &Field, operation: Operation, value: f64, by: f64, gain: f64) -> f64 {
    let wanted = match operation {
        Operation::Add => value + by * gain,
        Operation::Scale => value * (1.0 + (by - 1.0) * gain),
        Operation::Set => value + (by - value) * gain,
    };
    kept(field, value, wanted)
}

/// A wanted value of a parameter, kept in its range; one that is no number changes nothing.
pub(super) fn kept(field: &Field, value: f64, wanted: f64) -> f64 {
    if wanted.is_nan() {
        value
    } else if wanted < field.min {
        field.min
    } else if wanted > field.max {
        field.max
    } else {
        wanted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_their_equations() {
        let field = Field {
            min: -10.0,
            max: 10.0,
            ..Field::signal("x_n", "N", "x")
        };
        for (operation, by, gain, wanted) in [
            (Operation::Add, 3.0, 0.5, 5.5),
            (Operation::Scale, 0.5, 1.0, 2.0),
            (Operation::Scale, 0.5, 0.5, 3.0),
            (Operation::Set, -1.0, 1.0, -1.0),
            (Operation::Set, 0.0, 0.25, 3.0),
            (Operation::Add, 100.0, 1.0, 10.0),
            (Operation::Add, -100.0, 1.0, -10.0),
            (Operation::Set, f64::INFINITY, 0.0, 4.0),
        ] {
            let found = moved(&field, operation, 4.0, by, gain);
            assert_eq!(found, wanted, "{operation:?} {by} {gain}");
        }
    }
}
