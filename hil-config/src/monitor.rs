//! Monitoring of requirements as records arrive: the truth of each formula at step 0, its robustness, and the decisive
//! step.
//!
//! Created from all [`Formula`]s of a run and the columns of a record by an
//! [`Evaluation`](crate::evaluation::Evaluation), live or from a recording, then fed one row per step. Feeding
//! allocates nothing; memory is fixed on creation. Past rows are never revisited.
//!
//! 1. [`build`](Monitors::new) pushes every `not` down to the comparisons, converts bounds into steps, and computes,
//!    for each part of a formula, the steps whose margin is needed and the number of steps after which the margin is
//!    known. Parts that are known at different times are joined through delays. Equal comparisons of all formulas
//!    become one part, and equal expressions one side.
//! 2. At each row only the sides and parts that are due compute one value or margin each, operands first; the lists of
//!    due parts change at few rows. A window with a single needed result keeps one number, and other windows keep their
//!    steps.
//!    For each `implies` that a formula asks for, there is a second formula in which the conclusion is false: if it
//!    holds too, the formula holds [vacuously](Monitors::vacuous).
//! 3. The [`Verdict`] is certain as soon as no later row can change it. After the last step on which the formula
//!    depends, the robustness is known and nothing more is computed.

mod build;
mod context;
mod draft;
mod due;
mod every_step;
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
pub use every_step::EveryStep;
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
    /// Verdict left open because the run ended too early.
    Undecided,
}

impl Verdict {
    /// Returns the verdict's name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Undecided => "undecided",
        }
    }
}

/// Formulas under evaluation.
#[derive(Clone, Debug)]
pub struct Monitors {
    /// Operands of the comparisons.
    sides: Vec<ComparedSide>,
    /// Parts of all formulas, operands first.
    parts: Vec<Part>,
    /// Latest margin of each part.
    margins: Vec<Margin>,
    /// Certainty of the only margin of each part; used for the deciding parts only.
    certain: Vec<Option<bool>>,
    /// Parts whose certainty decides verdicts early, operands first.
    deciding: Vec<usize>,
    /// Judgements of the formulas, then those of [`implications`](Self::implications).
    judgements: Vec<Judgement>,
    /// Formula and premise of each `implies` that a formula asks for.
    implications: Vec<(usize, String)>,
    /// Rows at which each part is active.
    spans: Vec<Span>,
    /// Work that is due at the current row.
    due: Due,
    /// Number of rows so far.
    rows: u64,
}

/// Side of comparisons: an expression.
#[derive(Clone, Debug)]
struct ComparedSide {
    /// Value in the current row.
    value: f64,
    /// Program of the expression; `None` for a constant.
    program: Option<Program>,
}

/// Judgement of a formula for the rows so far.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// Part that represents the whole formula.
    whole: usize,
    decided: Option<(bool, Step)>,
    judged: Option<Margin>,
}

impl Monitors {
    /// Prepares formulas for the first row.
    ///
    /// # Errors
    /// If a name is unknown, or a formula looks beyond the end of the run, has a window without a step, or would keep
    /// too many steps.
    pub fn new<'a>(
        formulas: impl IntoIterator<Item = &'a Formula>,
        context: &FormulaContext<'_>,
    ) -> Result<Self, ExpressionError> {
        let mut built = Built::default();
        let formulas: Vec<&Formula> = formulas.into_iter().collect();
        for formula in &formulas {
            built.add(formula, None, context, true)?;
        }
        let mut implications = Vec::new();
        for (number, formula) in formulas.iter().enumerate() {
            for (implication, premise) in formula.implications() {
                built.add(formula, Some(implication), context, true)?;
                implications.push((number, premise.to_owned()));
            }
        }
        Ok(Self {
            implications,
            ..Self::of(built)
        })
    }

    /// Prepares built formulas for the first row.
    fn of(built: Built) -> Self {
        let (parts, spans, places) = draft::parts(&built.drafts);
        let judgements = built.wholes.iter().map(|whole| Judgement {
            whole: places[*whole],
            decided: None,
            judged: None,
        });
        let judgements: Vec<Judgement> = judgements.collect();
        Self {
            margins: parts.iter().map(Part::first_margin).collect(),
            certain: vec![None; parts.len()],
            deciding: deciding(&parts, &judgements),
            judgements,
            implications: Vec::new(),
            due: Due::new(parts.len(), &spans),
            spans,
            rows: 0,
            sides: built.sides,
            parts,
        }
    }

    /// Processes the row of a step. Steps must be consecutive from 0; a lost row is all NaN.
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

    /// Updates certainty and results after the row of a step.
    fn settle(&mut self, step: Step) {
        let row = step.0;
        for &at in &self.deciding {
            // Certainty is permanent.
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

    /// Returns the judgement of each formula, in the order of the formulas.
    #[must_use]
    pub fn judgements(&self) -> &[Judgement] {
        &self.judgements[..self.formulas()]
    }

    /// Returns the premise for which a formula holds vacuously: the formula holds even if the conclusion of that
    /// premise counts as false. Of nested ones the outermost: the inner ones follow from it. `None` if there is no such
    /// premise, or it is not certain yet.
    #[must_use]
    pub fn vacuous(&self, formula: usize) -> Option<&str> {
        let with_premises = (self.implications.iter()).zip(&self.judgements[self.formulas()..]);
        let holds = |one: &Judgement| one.verdict() == Verdict::Pass;
        // Operands come first, so the outermost premise is the last one.
        with_premises
            .rev()
            .filter(|((of, _), without)| *of == formula && holds(without))
            .map(|((_, premise), _)| premise.as_str())
            .find(|_| holds(&self.judgements[formula]))
    }

    const fn formulas(&self) -> usize {
        self.judgements.len() - self.implications.len()
    }

    /// Returns bounds on the final robustness of each formula, whatever rows follow; infinite if unknown. For an
    /// `always` the second bound is the minimum margin so far.
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
        let judgements = self.judgements().iter();
        judgements.map(|one| bounds[one.whole]).collect()
    }

    /// Returns the heap memory in bytes, which stays constant.
    #[must_use]
    pub fn kept_bytes(&self) -> usize {
        self.parts.iter().map(Part::kept_bytes).sum()
    }
}

impl Judgement {
    /// Returns the verdict so far.
    #[must_use]
    pub const fn verdict(&self) -> Verdict {
        match self.decided {
            Some((true, _)) => Verdict::Pass,
            Some((false, _)) => Verdict::Fail,
            None => Verdict::Undecided,
        }
    }

    /// Returns the step whose row made the verdict certain.
    #[must_use]
    pub const fn decided_at(&self) -> Option<Step> {
        match self.decided {
            Some((_, step)) => Some(step),
            None => None,
        }
    }

    /// Returns the robustness, once all rows on which the formula depends have arrived; infinite if the formula depends
    /// on a missing value. The sign bit is the verdict.
    #[must_use]
    pub const fn robustness(&self) -> Option<f64> {
        match self.judged {
            Some(margin) => Some(margin.size()),
            None => None,
        }
    }

    /// Returns the step whose comparison determines the robustness: the worst for `always`, the best for `eventually`.
    #[must_use]
    pub fn judged_by(&self) -> Option<Step> {
        self.judged?.step().map(Step)
    }
}

/// Returns the parts with a single margin that make up a whole formula without a window, operands first.
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
