//! Signals, rate and end of the run to which formulas are bound.
//!
//! Created once for all formulas of a run, by the check and by the run's [`Requirements`](crate::requirements);
//! independent of any formula.

use std::collections::HashSet;

use shared_types::number::exact as number;
use shared_types::time::{Rate, Step};

use crate::expression::{Columns, Expression};
use crate::formula::Window;
use crate::plan::Derived;

/// Signals, rate and end of the run to which formulas are bound.
#[derive(Clone, Debug)]
pub struct FormulaContext<'a> {
    pub(super) columns: &'a Columns,
    /// Derived signals that are missing in the last row, because they use a command.
    without_end: HashSet<&'a str>,
    rate: Rate,
    /// Last step of the run, whose row has no command.
    pub(super) steps: u64,
}

impl<'a> FormulaContext<'a> {
    /// Creates the context of a run up to step `steps`. The columns are those of a row with the derived signals.
    #[must_use]
    pub fn new(columns: &'a Columns, derived: &'a [Derived], rate: Rate, steps: u64) -> Self {
        let mut context = Self {
            columns,
            without_end: HashSet::new(),
            rate,
            steps,
        };
        for Derived { name, source, .. } in derived {
            let expression = source.expression();
            if expression.is_some_and(|expression| context.is_without_end(expression)) {
                context.without_end.insert(name);
            }
        }
        context
    }

    /// Returns `true` if an expression has no value in the last row.
    pub(super) fn is_without_end(&self, expression: &Expression) -> bool {
        expression
            .signals()
            .any(|signal| match signal.split_once('.') {
                Some((group, _)) => matches!(group, "command" | "applied" | "internal"),
                None => self.without_end.contains(signal),
            })
    }

    /// Returns the beginning and end of a window relative to the evaluated step, in steps, or the reason for their
    /// refusal. `until` is the last step at which the operands can be evaluated.
    pub(super) fn offsets(
        &self,
        window: &Window,
        is_past: bool,
        at_start: bool,
        until: u64,
    ) -> Result<(i64, i64), String> {
        let Some((begin_s, end_s)) = window.bounds_s else {
            if is_past {
                return Ok((-(self.steps as i64), 0));
            }
            if at_start {
                return Ok((0, until as i64));
            }
            let message = "without bounds the operator extends to the end of the run, which only an outermost operator can; give it bounds, such as [0s,1s]";
            return Err(message.into());
        };
        let rate = self.rate;
        let first = rate.step_at_or_after(begin_s);
        let Some(last) = (rate.step_at_or_before(end_s)).filter(|last| *last >= first) else {
            let period_s = number(rate.period_s());
            let message = format!("no step lies in this window; steps are {period_s} s apart");
            return Err(message);
        };
        // Longer than any run: clamped against overflow, and refused where it matters.
        let steps = |step: Step| step.0.min(1 << 41) as i64;
        let (first, last) = (steps(first), steps(last));
        if is_past {
            Ok((-last, -first))
        } else {
            Ok((first, last))
        }
    }

    /// Returns the number of steps before a step on which a windowed operator depends there, given that of its operand;
    /// `None` for all of them. A window of the future moves no operand back.
    pub(super) fn with_window(
        &self,
        operand: Option<u64>,
        window: &Window,
        is_past: bool,
    ) -> Option<u64> {
        if !is_past {
            return operand;
        }
        let (_, end_s) = window.bounds_s?;
        let last = self.rate.step_at_or_before(end_s)?;
        Some(operand?.saturating_add(last.0))
    }

    /// Explains that a window extends beyond the steps at which its operands can be evaluated.
    pub(super) fn beyond_the_run(&self, until: u64) -> String {
        let Self { rate, steps, .. } = self;
        let last_s = number(rate.seconds(Step(until)));
        let why = if until == *steps {
            format!("the run ends at {last_s} s")
        } else if until + 1 == *steps {
            format!("the last command is at {last_s} s, one step before the end")
        } else {
            format!("the operand itself looks ahead and can be evaluated only until {last_s} s")
        };
        format!(
            "the window reaches too far: {why}; shorten it, or omit the bounds of an outermost operator to extend it to the end of the run"
        )
    }
}
