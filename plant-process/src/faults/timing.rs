//! Timing: requests of faults to plant and controller, and their outcome.
//!
//! The layer calls this module before a sample is sent and again after its answer has arrived. The module itself never
//! waits. The effect of a fault is its request, limited to the observed delay: a controller that does not obey shows no
//! effect.

use shared_types::directive::Directive;
use shared_types::side::Side;
use shared_types::time::{Rate, Step};

use super::effect::{Action, Effect};

/// Active faults of timing, in the order in which they began.
#[derive(Default)]
pub(super) struct Timing {
    stack: Vec<usize>,
}

impl Timing {
    /// Restores the stack of active effects.
    pub(super) fn restore(&mut self, stack: &[usize]) {
        self.stack.clear();
        self.stack.extend(stack);
    }

    /// Returns the active effects.
    pub(super) const fn stack(&mut self) -> &mut Vec<usize> {
        &mut self.stack
    }

    /// Returns the directive to the controller, and the plant's busy time in ns.
    pub(super) fn ask(&self, effects: &mut [Effect], step: Step, rate: Rate) -> (Directive, u64) {
        let (mut controller, mut plant) = (Directive::default(), Directive::default());
        for &effect in &self.stack {
            let effect = &mut effects[effect];
            let at = effect.moment(step, rate);
            let amount = match &mut effect.action {
                Action::Skip(fault, amount) => {
                    let before = controller.late_steps;
                    fault.timing(&at, &mut controller);
                    *amount = controller.late_steps.abs_diff(before);
                    *amount
                }
                Action::Busy(side, fault, amount) => {
                    let directive = match side {
                        Side::Controller => &mut controller,
                        Side::Plant => &mut plant,
                    };
                    let before = directive.busy_ns;
                    fault.timing(&at, directive);
                    *amount = directive.busy_ns.abs_diff(before);
                    *amount
                }
                _ => 0,
            };
            effect.note(amount > 0, 0.0);
        }
        (controller, u64::from(plant.busy_ns))
    }

    /// Records the plant's actual busy time.
    pub(super) fn plant_was_busy(&self, effects: &mut [Effect], busy_ns: u64) {
        for &effect in &self.stack {
            if let Action::Busy(Side::Plant, _, asked_ns) = effects[effect].action {
                effects[effect].grow(observed_part(asked_ns, busy_ns));
            }
        }
    }

    /// Records the controller's answer.
    pub(super) fn answered(&self, effects: &mut [Effect], age_steps: u32, work_ns: u64) {
        for &effect in &self.stack {
            match effects[effect].action {
                Action::Busy(Side::Controller, _, asked_ns) => {
                    effects[effect].grow(observed_part(asked_ns, work_ns));
                }
                // An older command arrives, until the skipped one is due.
                Action::Skip(_, asked_steps) if age_steps > 0 => {
                    effects[effect].grow(f64::from(asked_steps));
                }
                _ => {}
            }
        }
    }
}

/// Returns the observed part of a request.
fn observed_part(request: u32, observed: u64) -> f64 {
    let request = u64::from(request);
    (if request < observed {
        request
    } else {
        observed
    }) as f64
}
