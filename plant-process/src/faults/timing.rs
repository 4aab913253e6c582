//! Timing: requests of faults to plant and controller, and their outcome.
//!
//! Asked by the layer before a sample is sent, told after its answer has come. It never waits itself.
//!
//! The effect of a fault is what it asked for, and no more than what was seen: a controller that
//! does not obey shows that nothing happened.

use shared_types::directive::Directive;
use shared_types::side::Side;
use shared_types::time::{Rate, Step};

use super::effect::{Action, Effect};

/// The faults of timing that act, in the order in which they took hold.
#[derive(Default)]
pub(super) struct Timing {
    stack: Vec<usize>,
}

impl Timing {
    /// Puts back which effects acted.
    pub(super) fn restore(&mut self, stack: &[usize]) {
        self.stack.clear();
        self.stack.extend(stack);
    }

    /// The effects that act.
    pub(super) const fn stack(&mut self) -> &mut Vec<usize> {
        &mut self.stack
    }

    /// Returns what the controller is to do, and for how long the plant is to be busy, in ns.
    pub(super) fn ask(&self, effects: &mut [Effect], step: Step, rate: Rate) -> (Directive, u64) {
        let (mut controller, mut plant) = (Directive::default(), Directive::default());
        for &effect in &self.stack {
            let effect = &mut effects[effect];
            let at = effect.moment(step, rate);
            let asked = match &mut effect.action {
                Action::Skip(fault, asked) => {
                    let before = controller.late_steps;
                    fault.timing(&at, &mut controller);
                    *asked = controller.late_steps.abs_diff(before);
                    *asked
                }
                Action::Busy(side, fault, asked) => {
                    let directive = match side {
                        Side::Controller => &mut controller,
                        Side::Plant => &mut plant,
                    };
                    let before = directive.busy_ns;
                    fault.timing(&at, directive);
                    *asked = directive.busy_ns.abs_diff(before);
                    *asked
                }
                _ => 0,
            };
            effect.note(asked > 0, 0.0);
        }
        (controller, u64::from(plant.busy_ns))
    }

    /// The plant was busy for so long.
    pub(super) fn plant_was_busy(&self, effects: &mut [Effect], busy_ns: u64) {
        for &effect in &self.stack {
            if let Action::Busy(Side::Plant, _, asked_ns) = effects[effect].action {
                effects[effect].grow(seen(asked_ns, busy_ns));
            }
        }
    }

    /// The controller answered.
    pub(super) fn answered(&self, effects: &mut [Effect], age_steps: u32, work_ns: u64) {
        for &effect in &self.stack {
            match effects[effect].action {
                Action::Busy(Side::Controller, _, asked_ns) => {
                    effects[effect].grow(seen(asked_ns, work_ns));
                }
                // The command that comes is an older one, and will be until the skipped one is due.
                Action::Skip(_, asked_steps) if age_steps > 0 => {
                    effects[effect].grow(f64::from(asked_steps));
                }
                _ => {}
            }
        }
    }
}

/// Returns the part of what was asked for that was seen.
fn seen(asked: u32, seen: u64) -> f64 {
    let asked = u64::from(asked);
    (if asked < seen { asked } else { seen }) as f64
}
