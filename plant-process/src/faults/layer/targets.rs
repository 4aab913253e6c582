//! Targets of effects, each with the stack of effects that act on it.

use shared_types::time::Step;

use crate::faults::effect::{Action, Direction, Effect};
use crate::faults::parameters::Parameters;
use crate::faults::signal_path::SignalPath;
use crate::faults::timing::Timing;

/// Targets of effects, each with the effects that act on the target.
pub(super) struct Targets {
    pub(super) parameters: Parameters,
    pub(super) sample: SignalPath,
    pub(super) command: SignalPath,
    /// Driven inputs of the plant, which cross no link.
    pub(super) input: SignalPath,
    pub(super) timing: Timing,
}

impl Targets {
    /// Returns the stack of effects at the place of this effect.
    pub(super) const fn stack_of(&mut self, action: &Action) -> &mut Vec<usize> {
        match action {
            // An ended effect is in no stack.
            Action::Move(_) | Action::Parameter(..) | Action::Over => self.parameters.stack(),
            Action::Signal(Direction::Sample, ..) => self.sample.signals(),
            Action::Signal(Direction::Command, ..) => self.command.signals(),
            Action::Signal(Direction::Input, ..) => self.input.signals(),
            Action::Link(Direction::Command, ..) => self.command.link(),
            Action::Link(..) => self.sample.link(),
            Action::Skip(..) | Action::Busy(..) => self.timing.stack(),
        }
    }

    /// Begins an effect; returns the number of earlier identical ones.
    pub(super) fn begin(&mut self, effects: &mut [Effect], place: usize) -> usize {
        match effects[place].action {
            Action::Link(Direction::Sample, ..) => self.sample.begin(&mut effects[place]),
            Action::Link(Direction::Command, ..) => self.command.begin(&mut effects[place]),
            _ => {}
        }
        let stack = self.stack_of(&effects[place].action);
        let is_twin = |other: &&usize| effects[**other].is_twin_of(&effects[place]);
        let twins = stack.iter().filter(is_twin).count();
        stack.push(place);
        twins
    }

    /// Ends an effect; changes nothing if it never began.
    pub(super) fn end(&mut self, effects: &mut [Effect], place: usize, step: Step) {
        let stack = self.stack_of(&effects[place].action);
        let Some(index) = stack.iter().position(|&other| other == place) else {
            return;
        };
        stack.remove(index);
        match effects[place].action {
            Action::Move(_) | Action::Parameter(..) => self.parameters.heal(),
            Action::Link(Direction::Sample, ..) => self.sample.end(effects, step),
            Action::Link(Direction::Command, ..) => self.command.end(effects, step),
            _ => {}
        }
    }
}
