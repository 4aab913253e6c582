//! Requirements while records arrive: whether each formula holds at step 0, by how much, and which
//! step says so.
//!
//! Made from all [`Formula`]s of a run and the columns of a record by an
//! [`Evaluation`](crate::evaluation::Evaluation), live or from a recording, then fed one row per
//! step. Feeding allocates nothing; memory is fixed when monitors are made. Never looks back at a row.
//!
//! 1. [`build`](Monitors::new) takes every `not` to the comparisons, turns bounds into steps, and finds
//!    for each part of the formula at which steps its margin is wanted and how many steps later it
//!    is known. Parts that are known at different times are joined through delays. Equal comparisons
//!    of all formulas become one part, equal expressions one side.
//! 2. At each row the sides and parts with something to do there, and no others, compute one value or
//!    margin each, operands first; the lists of them change at few rows. A window of which only one
//!    result is wanted keeps one number, others keep their steps.
//! 3. As soon as no row to come can change it the [`Verdict`] is certain; when the last step that the
//!    formula looks at has come, the robustness is known and nothing is computed any more.

mod build;
mod context;
mod draft;
mod due;
mod margin;
mod part;
mod window;

use serde::Serialize;
use shared_types::time::Step;

use crate::expression::{ExpressionError, Program};
use crate::formula::Formula;
use build::Built;
pub use context::FormulaContext;
use due::{Due, Span};
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

/// Formulas that are being judged.
#[derive(Clone, Debug)]
pub struct Monitors {
    /// Operands of the comparisons.
    sides: Vec<ComparedSide>,
    /// The parts of all formulas, operands before what is made of them.
    parts: Vec<Part>,
    /// The newest margin of each part.
    margins: Vec<Margin>,
    /// Certainty of the only margin of each part; used of the deciding parts alone.
    certain: Vec<Option<bool>>,
    /// The parts that verdicts hang on before they are computed, operands first.
    deciding: Vec<usize>,
    judgements: Vec<Judgement>,
    /// The rows at which each part looks.
    spans: Vec<Span>,
    /// The work that is due at the present row.
    due: Due,
    /// Rows so far.
    rows: u64,
}

/// An expression that comparisons compare.
#[derive(Clone, Debug)]
struct ComparedSide {
    /// Value in the present row.
    value: f64,
    /// None if it is a number.
    program: Option<Program>,
}

/// Judgement of a formula by the rows so far.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// The part that is the whole formula.
    whole: usize,
    decided: Option<(bool, Step)>,
    judged: Option<Margin>,
}

impl Monitors {
    /// Makes formulas ready for the first row.
    ///
    /// # Errors
    /// If a name is unknown, a formula looks beyond the end of the run, has a window without a
    /// step, or would keep too many steps.
    pub fn new<'a>(
        formulas: impl IntoIterator<Item = &'a Formula>,
        context: &FormulaContext<'_>,
    ) -> Result<Self, ExpressionError> {
        let mut built = Built::default();
        for formula in formulas {
            built.add(formula, context)?;
        }
        let (parts, spans, places) = draft::parts(&built.drafts);
        let judgements = built.wholes.iter().map(|whole| Judgement {
            whole: places[*whole],
            decided: None,
            judged: None,
        });
        let judgements: Vec<Judgement> = judgements.collect();
        Ok(Self {
            margins: parts.iter().map(Part::first_margin).collect(),
            certain: vec![None; parts.len()],
            deciding: deciding(&parts, &judgements),
            judgements,
            due: Due::new(parts.len(), &spans),
            spans,
            rows: 0,
            sides: built.sides,
            parts,
        })
    }

    /// Takes the row of a step. Steps must follow each other from 0; a row that was lost is all NaN.
    ///
    /// # Panics
    /// If the row is shorter than the columns.
    pub fn observe(&mut self, step: Step, row: &[f64]) {
        self.rows = step.0.saturating_add(1);
        let Self {
            sides,
            parts,
            margins,
            due,
            ..
        } = self;
        let mut is_news = step.0 >= due.turns_at;
        if is_news {
            due.turn(step.0, &self.spans, parts, sides);
        }
        for &at in &due.sides {
            let side = &mut sides[at];
            if let Some(program) = &side.program {
                side.value = program.evaluate(row);
            }
        }
        for &(at, comparison) in &due.comparisons {
            margins[at] = comparison.margin(sides, step.0);
        }
        let mut begin = [0; 3];
        for &end in &due.stages {
            for &(at, join) in &due.joins[begin[0]..end[0]] {
                margins[at] = join.margin(margins);
            }
            for &(at, window) in &due.growing[begin[1]..end[1]] {
                let operand = margins[window.operand];
                is_news |= window.observe(operand, &mut margins[at]);
            }
            for &at in &due.others[begin[2]..end[2]] {
                let (before, own) = margins.split_at_mut(at);
                is_news |= parts[at].observe(step.0, before, &mut own[0]);
            }
            begin = end;
        }
        if is_news {
            self.settle(step);
        }
    }

    /// Finds what is certain and what is known after the row of a step.
    fn settle(&mut self, step: Step) {
        let row = step.0;
        for &at in &self.deciding {
            // What is certain stays so.
            if self.certain[at].is_none() {
                let part = &self.parts[at];
                self.certain[at] = if part.is_done(row) {
                    Some(self.margins[at].holds())
                } else {
                    part.certain(&self.certain, self.margins[at])
                };
            }
        }
        for judgement in &mut self.judgements {
            let whole = judgement.whole;
            if judgement.decided.is_none() {
                judgement.decided = self.certain[whole].map(|holds| (holds, step));
            }
            if judgement.judged.is_none() && self.parts[whole].is_done(row) {
                judgement.judged = Some(self.margins[whole]);
            }
        }
    }

    /// The judgement of each formula, in their order.
    #[must_use]
    pub fn judgements(&self) -> &[Judgement] {
        &self.judgements
    }

    /// Between which two sizes the robustness of each formula will be, whatever comes; infinite where
    /// the rows so far say nothing. Of an `always` the second is the least margin so far.
    #[must_use]
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        let last_row = self.rows.checked_sub(1);
        let mut bounds = vec![margin::ANY; self.parts.len()];
        for &at in &self.deciding {
            let part = &self.parts[at];
            bounds[at] = match last_row {
                Some(row) if part.is_done(row) => [self.margins[at].size(); 2],
                _ => part.bounds(&bounds, self.margins[at]),
            };
        }
        let judgements = self.judgements.iter();
        judgements.map(|one| bounds[one.whole]).collect()
    }

    /// Bytes that they keep beside themselves, whatever comes.
    #[must_use]
    pub fn kept_bytes(&self) -> usize {
        self.parts.iter().map(Part::kept_bytes).sum()
    }
}

impl Judgement {
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
            Some(margin) => Some(margin.size()),
            None => None,
        }
    }

    /// The step whose comparison the robustness comes from: the worst for `always`, the best for
    /// `eventually`.
    #[must_use]
    pub fn judged_by(&self) -> Option<Step> {
        self.judged?.step().map(Step)
    }
}

/// Finds the parts with a single margin that make up a whole formula without a window, operands first.
fn deciding(parts: &[Part], judgements: &[Judgement]) -> Vec<usize> {
    let mut is_deciding = vec![false; parts.len()];
    for judgement in judgements {
        is_deciding[judgement.whole] = true;
    }
    for (at, part) in parts.iter().enumerate().rev() {
        is_deciding[at] &= part.is_single;
        if is_deciding[at] {
            for operand in part.joined().into_iter().flatten() {
                is_deciding[operand] = true;
            }
        }
    }
    (0..parts.len()).filter(|at| is_deciding[*at]).collect()
}
