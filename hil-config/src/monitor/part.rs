//! A part of a formula at work: one margin for each row.
//!
//! Made by [`build`](super::build), called by the [`Monitor`](super::Monitor) at every row. At row `r`
//! a part computes the margin of step `r - delay`.

use super::margin::{self, Margin, larger, smaller};
use super::window::{Greatest, Least, Since, Steps, Stretch, Until};
use crate::expression::Program;
use crate::formula::Relation;

/// A part of a formula.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub work: Work,
    /// The steps whose margin is wanted, both ends included; nothing if the first is above the last.
    pub first: u64,
    pub last: u64,
    /// Number of rows after the row of its own step at which a margin is known.
    pub delay: u64,
    /// The first row that it looks at.
    pub from_row: u64,
}

/// Work of a part. Operands are places among the parts before it.
#[derive(Clone, Debug)]
pub(super) enum Work {
    Comparison {
        relation: Relation,
        left: Program,
        right: Program,
    },
    And(usize, usize),
    Or(usize, usize),
    /// An operand that is known earlier than what it is joined with.
    Delay(Delay),
    /// `always`, `historically`.
    Every(usize, Window<Least>),
    /// `eventually`, `once`.
    Any(usize, Window<Greatest>),
    Until(Chained, Window<Until<false>>),
    NotUntil(Chained, Window<Until<true>>),
    Since(Chained, Window<Since<false>>),
    NotSince(Chained, Window<Since<true>>),
}

/// The operands of `until` and `since`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chained {
    pub hold: usize,
    pub reach: usize,
}

#[derive(Clone, Debug)]
pub(super) struct Delay {
    pub operand: usize,
    /// By how many rows.
    pub by: u64,
    /// The last margins of the operand, each at the place of its step modulo their number.
    pub kept: Vec<Margin>,
}

/// The window of a temporal operator.
#[derive(Clone, Debug)]
pub(super) struct Window<S> {
    /// Number of rows by which the operand of a step is taken later than the step's own row.
    pub delay: u64,
    /// The steps of the operand that are taken, both ends included; none if the first is above.
    pub first: u64,
    pub last: u64,
    /// Begin of the window from the step that is judged.
    pub begin: i64,
    pub steps: Steps<S>,
}

impl Part {
    /// Returns true if every margin that is wanted was computed.
    #[inline]
    pub(super) const fn is_done(&self, row: u64) -> bool {
        row >= self.last + self.delay
    }

    /// Looks at the row; `operands` are the newest margins of the parts before, `own` becomes its own.
    #[inline]
    pub(super) fn observe(
        &mut self,
        row: u64,
        values: &[f64],
        operands: &[Margin],
        own: &mut Margin,
    ) {
        if row < self.from_row || row > self.last + self.delay {
            return;
        }
        // While it only gathers there is no such step.
        let step = row.checked_sub(self.delay);
        let wanted = step.filter(|step| *step >= self.first);
        match &mut self.work {
            Work::Comparison {
                relation,
                left,
                right,
            } => {
                let (a, b) = (left.evaluate(values), right.evaluate(values));
                *own = compared(*relation, a, b, row);
            }
            Work::And(a, b) => *own = operands[*a].least(operands[*b]),
            Work::Or(a, b) => *own = operands[*a].greatest(operands[*b]),
            Work::Delay(delay) => {
                let known = row + delay.by - self.delay;
                let newest = (known <= self.last).then_some(known);
                delay.observe(newest, wanted, operands, own);
            }
            Work::Every(operand, window) => {
                window.observe(row, wanted, own, || Least(operands[*operand]));
            }
            Work::Any(operand, window) => {
                window.observe(row, wanted, own, || Greatest(operands[*operand]));
            }
            Work::Until(of, window) => window.observe(row, wanted, own, || {
                let (hold, reach) = of.margins(operands);
                Until { hold, reach }
            }),
            Work::NotUntil(of, window) => window.observe(row, wanted, own, || {
                let (hold, reach) = of.margins(operands);
                Until { hold, reach }
            }),
            Work::Since(of, window) => window.observe(row, wanted, own, || {
                let (hold, reach) = of.margins(operands);
                Since { hold, reach }
            }),
            Work::NotSince(of, window) => window.observe(row, wanted, own, || {
                let (hold, reach) = of.margins(operands);
                Since { hold, reach }
            }),
        }
    }

    /// The operands that it joins or delays, whose margins it has.
    pub(super) const fn joined(&self) -> [Option<usize>; 2] {
        match self.work {
            Work::And(a, b) | Work::Or(a, b) => [Some(a), Some(b)],
            Work::Delay(Delay { operand, .. }) => [Some(operand), None],
            _ => [None; 2],
        }
    }

    /// Certainty of its only margin before the margin is computed; `of` has that of each part before.
    #[inline]
    pub(super) fn certain(&self, of: &[Option<bool>]) -> Option<bool> {
        match &self.work {
            Work::Comparison { .. } => None,
            Work::And(a, b) => match (of[*a], of[*b]) {
                (Some(false), _) | (_, Some(false)) => Some(false),
                (Some(true), Some(true)) => Some(true),
                _ => None,
            },
            Work::Or(a, b) => match (of[*a], of[*b]) {
                (Some(true), _) | (_, Some(true)) => Some(true),
                (Some(false), Some(false)) => Some(false),
                _ => None,
            },
            Work::Delay(delay) => of[delay.operand],
            Work::Every(_, window) => window.certain(),
            Work::Any(_, window) => window.certain(),
            Work::Until(_, window) => window.certain(),
            Work::NotUntil(_, window) => window.certain(),
            Work::Since(_, window) => window.certain(),
            Work::NotSince(_, window) => window.certain(),
        }
    }
}

impl Part {
    /// Between which two sizes its only margin will be, before that is computed; `of` are those of
    /// each part before.
    pub(super) fn bounds(&self, of: &[[f64; 2]]) -> [f64; 2] {
        let both = |a: usize, b: usize, choose: fn(f64, f64) -> f64| {
            let ([a_low, a_high], [b_low, b_high]) = (of[a], of[b]);
            [choose(a_low, b_low), choose(a_high, b_high)]
        };
        match &self.work {
            Work::Comparison { .. } | Work::Since(..) | Work::NotSince(..) => margin::ANY,
            Work::And(a, b) => both(*a, *b, smaller),
            Work::Or(a, b) => both(*a, *b, larger),
            Work::Delay(delay) => of[delay.operand],
            Work::Every(_, window) => window.bounds(),
            Work::Any(_, window) => window.bounds(),
            Work::Until(_, window) => window.bounds(),
            Work::NotUntil(_, window) => window.bounds(),
        }
    }

    /// Returns true if only one margin of the part is wanted.
    #[inline]
    pub(super) const fn is_single(&self) -> bool {
        self.first == self.last
    }

    /// Bytes that it keeps beside itself.
    pub(super) fn kept_bytes(&self) -> usize {
        match &self.work {
            Work::Comparison { .. } | Work::And(..) | Work::Or(..) => 0,
            Work::Delay(delay) => delay.kept.capacity() * size_of::<Margin>(),
            Work::Every(_, window) => window.steps.kept_bytes(),
            Work::Any(_, window) => window.steps.kept_bytes(),
            Work::Until(_, window) => window.steps.kept_bytes(),
            Work::NotUntil(_, window) => window.steps.kept_bytes(),
            Work::Since(_, window) => window.steps.kept_bytes(),
            Work::NotSince(_, window) => window.steps.kept_bytes(),
        }
    }
}

impl Chained {
    #[inline]
    fn margins(self, operands: &[Margin]) -> (Margin, Margin) {
        (operands[self.hold], operands[self.reach])
    }
}

impl Delay {
    /// Keeps the margin of the operand's newest step and gives that of the wanted one.
    #[inline]
    fn observe(
        &mut self,
        newest: Option<u64>,
        wanted: Option<u64>,
        operands: &[Margin],
        own: &mut Margin,
    ) {
        let places = self.kept.len() as u64;
        if let Some(step) = newest {
            self.kept[(step % places) as usize] = operands[self.operand];
        }
        if let Some(step) = wanted {
            *own = self.kept[(step % places) as usize];
        }
    }
}

impl<S: Stretch> Window<S> {
    /// Takes the operand's step of this row, if it is one of the window's, and gives what the window
    /// of the wanted step comes to.
    #[inline]
    fn observe(
        &mut self,
        row: u64,
        wanted: Option<u64>,
        own: &mut Margin,
        operand: impl FnOnce() -> S,
    ) {
        if let Some(step) = wanted {
            self.steps.begin_at(step.saturating_add_signed(self.begin));
        }
        if let Some(step) = row.checked_sub(self.delay)
            && (self.first..=self.last).contains(&step)
        {
            self.steps.push(operand());
        }
        if wanted.is_some() {
            *own = self.steps.total().margin();
        }
    }

    #[inline]
    fn certain(&self) -> Option<bool> {
        match &self.steps {
            Steps::Growing(total) => total.certain(),
            Steps::Sliding(_) => None,
        }
    }

    fn bounds(&self) -> [f64; 2] {
        match &self.steps {
            Steps::Growing(total) => total.bounds(),
            Steps::Sliding(_) => margin::ANY,
        }
    }
}

/// The margin of a comparison: the distance of both sides, with the sign that says whether it holds.
#[inline]
fn compared(relation: Relation, a: f64, b: f64, step: u64) -> Margin {
    let size = if a.is_nan() || b.is_nan() {
        f64::NEG_INFINITY
    } else {
        let distance = (a - b).abs();
        // Two equal infinities have no difference, and so none that is a number.
        let distance = if distance.is_nan() { 0.0 } else { distance };
        if relation.holds(a, b) {
            distance
        } else {
            -distance
        }
    };
    Margin { size, step }
}
