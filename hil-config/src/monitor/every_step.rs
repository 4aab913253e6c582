//! Formula evaluated at every step: the times at which a condition held, as a view lists them.
//!
//! Computed by the parts that judge requirements, so that both agree. Judges no run.

use shared_types::time::Step;

use super::build::Built;
use super::{FormulaContext, Monitors};
use crate::expression::ExpressionError;
use crate::formula::{Formula, Node};

/// Formula evaluated at every step at which it can be judged.
#[derive(Clone, Debug)]
pub struct EveryStep {
    monitors: Monitors,
    /// Rows between a step and the row that decides it.
    delay: u64,
    /// Last step at which the formula can be judged.
    until: u64,
    /// Rows before a step on which the formula depends there at most; `None` for all of them.
    past: Option<u64>,
}

impl EveryStep {
    /// Prepares a formula for the first row.
    ///
    /// # Errors
    /// If a name is unknown, an operator of the future has no bounds, a window looks beyond the end of the run or has
    /// no step, or the formula would keep too many steps.
    pub fn new(formula: &Formula, context: &FormulaContext<'_>) -> Result<Self, ExpressionError> {
        let mut built = Built::default();
        built.add(formula, None, context, false)?;
        let whole = &built.drafts[built.wholes[0]];
        Ok(Self {
            delay: whole.delay,
            until: whole.until,
            past: past(formula, context),
            monitors: Monitors::of(built),
        })
    }

    /// Returns the number of rows between a step and the row that decides the formula there.
    #[must_use]
    pub const fn delay(&self) -> u64 {
        self.delay
    }

    /// Returns the largest number of rows before a step on which the formula depends there; `None` for all of them.
    #[must_use]
    pub const fn past(&self) -> Option<u64> {
        self.past
    }

    /// Processes the row of a step; returns the step that this row decides, and `true` if the formula holds there.
    /// Steps must be consecutive from 0; a lost row is all NaN.
    ///
    /// # Panics
    /// If the row is shorter than the columns.
    pub fn observe(&mut self, step: Step, row: &[f64]) -> Option<(Step, bool)> {
        if step.0 > self.until.saturating_add(self.delay) {
            return None;
        }
        self.monitors.observe(step, row);
        let decided = step.0.checked_sub(self.delay)?;
        let whole = self.monitors.judgements[0].whole;
        Some((Step(decided), self.monitors.margins[whole].holds()))
    }
}

/// Returns the largest number of rows before a step on which a formula depends there; `None` for all of them.
fn past(formula: &Formula, context: &FormulaContext<'_>) -> Option<u64> {
    let nodes = formula.nodes();
    let mut all: Vec<Option<u64>> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let either = |a: usize, b: usize| Some(all[a]?.max(all[b]?));
        let back = match node {
            Node::Comparison(_) => Some(0),
            Node::Not(operand) => all[*operand],
            Node::And(a, b) | Node::Or(a, b) | Node::Implies(a, b) => either(*a, *b),
            Node::Edge { operand, .. } => all[*operand].map(|back| back + 1),
            Node::Over {
                is_past,
                window,
                operand,
                ..
            } => context.with_window(all[*operand], window, *is_past),
            Node::Chain {
                is_past,
                window,
                hold,
                reach,
            } => context.with_window(either(*hold, *reach), window, *is_past),
        };
        all.push(back);
    }
    all.pop().flatten()
}
