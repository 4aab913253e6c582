//! A requirement while records arrive: whether its formula holds at step 0, by how much, and which
//! step says so.
//!
//! Made from a [`Formula`] and the columns of a record by an
//! [`Evaluation`](crate::evaluation::Evaluation), live or from a recording, then fed one row per
//! step. Feeding allocates nothing; memory is fixed when a monitor is made. Never looks back at a row.
//!
//! 1. [`build`](Monitor::new) takes every `not` to the comparisons, turns bounds into steps, and finds
//!    for each part of the formula at which steps its margin is wanted and how many steps later it
//!    is known. Parts that are known at different times are joined through delays.
//! 2. At each row every part that has something to do computes the margin of one step, operands
//!    first. A window of which only one result is wanted keeps one number, others keep their steps.
//! 3. As soon as no row to come can change it the [`Verdict`] is certain; when the last step that the
//!    formula looks at has come, the robustness is known and nothing is computed any more.

mod build;
mod margin;
mod part;
mod window;

use std::collections::HashSet;

use serde::Serialize;
use shared_types::time::{Rate, Step};

use crate::expression::{Columns, ExpressionError};
use crate::formula::Formula;
use margin::Margin;
use part::Part;

/// Verdict on a requirement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Verdict that the requirement holds.
    Pass,
    /// Verdict that the requirement does not hold.
    Fail,
    /// The run ended before that could be said.
    Undecided,
}

impl Verdict {
    /// Gives its word in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Undecided => "undecided",
        }
    }
}

/// Signals, rate and end of the run that formulas are bound to.
#[derive(Clone, Debug)]
pub struct FormulaContext<'a> {
    columns: &'a Columns,
    /// The derived signals that do not exist in the last row, because they use a command.
    without_end: HashSet<&'a str>,
    rate: Rate,
    /// The last step of the run, whose row has no command.
    steps: u64,
}

/// A formula that is being judged.
#[derive(Clone, Debug)]
pub struct Monitor {
    /// Operands before what is made of them; the last is the whole formula.
    parts: Vec<Part>,
    /// The newest margin of each part.
    margins: Vec<Margin>,
    /// The parts that the verdict hangs on before they are computed, operands first.
    deciding: Vec<usize>,
    /// Certainty of the only margin of each part; used of the deciding parts alone.
    certain: Vec<Option<bool>>,
    /// The first row that any part looks at.
    from_row: u64,
    /// Rows so far.
    rows: u64,
    decided: Option<(bool, Step)>,
    judged: Option<Margin>,
}

impl Monitor {
    /// A formula before the first row.
    ///
    /// # Errors
    /// If a name is unknown, the formula looks beyond the end of the run, has a window without a
    /// step, or would keep too many steps.
    pub fn new(formula: &Formula, context: &FormulaContext<'_>) -> Result<Self, ExpressionError> {
        let parts = build::parts(formula, context)?;
        Ok(Self {
            margins: vec![Margin::BOTTOM; parts.len()],
            deciding: deciding(&parts),
            certain: vec![None; parts.len()],
            from_row: (parts.iter().map(|part| part.from_row).min()).unwrap_or(0),
            parts,
            rows: 0,
            decided: None,
            judged: None,
        })
    }

    /// Takes the row of a step. Steps must follow each other from 0; a row that was lost is all NaN.
    ///
    /// # Panics
    /// If the row is shorter than the columns.
    pub fn observe(&mut self, step: Step, row: &[f64]) {
        self.rows = step.0.saturating_add(1);
        if self.judged.is_some() || step.0 < self.from_row {
            return;
        }
        for at in 0..self.parts.len() {
            let (before, own) = self.margins.split_at_mut(at);
            self.parts[at].observe(step.0, row, before, &mut own[0]);
        }
        let whole = self.parts.len() - 1;
        if self.decided.is_none() {
            self.ascertain(step.0);
            self.decided = self.certain[whole].map(|holds| (holds, step));
        }
        if self.parts[whole].is_done(step.0) {
            self.judged = Some(self.margins[whole]);
        }
    }

    /// Finds what is certain after the row of a step.
    fn ascertain(&mut self, row: u64) {
        for &at in &self.deciding {
            // What is certain stays so.
            if self.certain[at].is_none() {
                let part = &self.parts[at];
                self.certain[at] = if part.is_done(row) {
                    Some(self.margins[at].holds())
                } else {
                    part.certain(&self.certain)
                };
            }
        }
    }

    /// The verdict so far.
    #[must_use]
    pub const fn verdict(&self) -> Verdict {
        match self.decided {
            Some((true, _)) => Verdict::Pass,
            Some((false, _)) => Verdict::Fail,
            None => Verdict::Undecided,
        }
    }

    /// The step whose row made the verdict certain.
    #[must_use]
    pub const fn decided_at(&self) -> Option<Step> {
        match self.decided {
            Some((_, step)) => Some(step),
            None => None,
        }
    }

    /// The robustness, when everything that the formula looks at has come; infinite if it hangs on a
    /// value that does not exist. Its sign bit is the verdict.
    #[must_use]
    pub const fn robustness(&self) -> Option<f64> {
        match self.judged {
            Some(margin) => Some(margin.size),
            None => None,
        }
    }

    /// Between which two sizes the robustness will be, whatever comes; infinite where the rows so far
    /// say nothing. Of an `always` the second is the least margin so far.
    #[must_use]
    pub fn bounds(&self) -> [f64; 2] {
        match self.judged {
            Some(margin) => [margin.size; 2],
            None => self.bounds_so_far(),
        }
    }

    fn bounds_so_far(&self) -> [f64; 2] {
        let last_row = self.rows.checked_sub(1);
        let mut bounds = vec![margin::ANY; self.parts.len()];
        for &at in &self.deciding {
            let part = &self.parts[at];
            bounds[at] = match last_row {
                Some(row) if part.is_done(row) => [self.margins[at].size; 2],
                _ => part.bounds(&bounds),
            };
        }
        bounds[self.parts.len() - 1]
    }

    /// The step whose comparison the robustness comes from: the worst for `always`, the best for
    /// `eventually`.
    #[must_use]
    pub fn judged_by(&self) -> Option<Step> {
        let margin = self.judged.filter(|margin| margin.step != u64::MAX)?;
        Some(Step(margin.step))
    }

    /// Bytes that it keeps beside itself, whatever comes.
    #[must_use]
    pub fn kept_bytes(&self) -> usize {
        self.parts.iter().map(Part::kept_bytes).sum()
    }
}

/// The parts with a single margin that the whole is made of without a window, operands first.
fn deciding(parts: &[Part]) -> Vec<usize> {
    let mut is_deciding = vec![false; parts.len()];
    if let Some(whole) = is_deciding.last_mut() {
        *whole = true;
    }
    for (at, part) in parts.iter().enumerate().rev() {
        is_deciding[at] &= part.is_single();
        if is_deciding[at] {
            for operand in part.joined().into_iter().flatten() {
                is_deciding[operand] = true;
            }
        }
    }
    (0..parts.len()).filter(|at| is_deciding[*at]).collect()
}
