//! Part of a formula in operation: one margin per row.
//!
//! Built by [`draft`](super::draft), called by [`Monitors`](super::Monitors) only at the rows at which the part is
//! [due](super::due::Due).

use shared_types::extremes::{larger, smaller};

use super::ComparedSide;
use super::margin::{self, Choice, Margin};
use super::window::{Chain, Extreme, Since, Until};
use crate::formula::Relation;

/// Part of a formula.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub work: PartWork,
    /// `true` if only one margin of the part is needed.
    pub is_single: bool,
    /// Row at which the last needed margin was computed.
    pub done_at: u64,
}

/// Operation of a part. Operands are indices of earlier parts.
#[derive(Clone, Debug)]
pub(super) enum PartWork {
    Comparison(Comparison),
    Join(Join),
    Growing(Growing),
    /// Operand that is known earlier than its counterpart in a join.
    Delay(Delay),
    /// Sliding window of `always` and similar operators.
    Extreme(usize, Extreme),
    Until(Chained, Chain<Until>),
    Since(Chained, Chain<Since>),
}

/// Comparison of two sides, `left < right` or `left == right`, or the negation of such a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Comparison {
    /// Sign bit of `left == right`, which fails by the distance, whichever side is the larger.
    sign: u64,
    /// All bits set for the negation.
    turned: i64,
    /// Indices of the sides.
    pub left: usize,
    pub right: usize,
}

/// `and` or `or`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Join {
    pub choice: Choice,
    pub a: usize,
    pub b: usize,
}

/// Growing window of `always` and similar operators. Its own margin is the result so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Growing {
    pub choice: Choice,
    pub operand: usize,
}

/// Operands of `until` and `since`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chained {
    pub hold: usize,
    pub reach: usize,
}

/// Ring buffer of delayed margins.
#[derive(Clone, Debug)]
pub(super) struct Delay {
    pub operand: usize,
    /// Last row at which the delay takes a margin of the operand.
    pub takes_until: u64,
    /// First row at which the delay returns a margin.
    pub gives_from: u64,
    pub margins: Vec<Margin>,
    pub next_in: usize,
    pub next_out: usize,
}

impl Part {
    /// Returns the margin before the first row.
    pub(super) fn first_margin(&self) -> Margin {
        match self.work {
            PartWork::Growing(window) => window.choice.none(),
            _ => Margin::BOTTOM,
        }
    }

    /// Returns `true` if every needed margin was computed.
    #[inline]
    pub(super) const fn is_done(&self, row: u64) -> bool {
        row >= self.done_at
    }

    /// Processes a row; `operands` has the latest margins of the earlier parts, `own` receives the margin of this part.
    /// Returns `true` if a margin became certain before it is computed.
    #[inline]
    pub(super) fn observe(&mut self, row: u64, operands: &[Margin], own: &mut Margin) -> bool {
        match &mut self.work {
            PartWork::Delay(delay) => delay.observe(row, operands, own),
            PartWork::Extreme(operand, window) => *own = window.observe(row, operands[*operand]),
            PartWork::Until(Chained { hold, reach }, window) => {
                let before = window.certain();
                *own = window.observe(row, operands[*hold], operands[*reach]);
                return before != window.certain();
            }
            PartWork::Since(Chained { hold, reach }, window) => {
                *own = window.observe(row, operands[*hold], operands[*reach]);
            }
            PartWork::Comparison(_) | PartWork::Join(_) | PartWork::Growing(_) => {
                unreachable!("they have lists of their own")
            }
        }
        false
    }

    /// Returns the operands that the part joins or delays and whose margins it shares.
    pub(super) const fn joined(&self) -> [Option<usize>; 2] {
        match self.work {
            PartWork::Join(Join { a, b, .. }) => [Some(a), Some(b)],
            PartWork::Delay(Delay { operand, .. }) => [Some(operand), None],
            _ => [None; 2],
        }
    }

    /// Returns the early certainty of the part's only margin; `of` has the certainty of each earlier part and `own` the
    /// margin so far.
    pub(super) fn certain(&self, of: &[Option<bool>], own: Margin) -> Option<bool> {
        match &self.work {
            // A minimum fails as soon as one operand fails, a maximum holds as soon as one holds.
            PartWork::Join(Join { choice, a, b }) => {
                let one = Some(*choice == Choice::GREATEST);
                if of[*a] == one || of[*b] == one {
                    one
                } else {
                    of[*a].and(of[*b])
                }
            }
            PartWork::Growing(window) => {
                let one = window.choice == Choice::GREATEST;
                (own.holds() == one).then_some(one)
            }
            PartWork::Delay(delay) => of[delay.operand],
            PartWork::Until(_, window) => window.certain(),
            PartWork::Comparison(_) | PartWork::Extreme(..) | PartWork::Since(..) => None,
        }
    }

    /// Returns early bounds on the part's only margin; `of` has the bounds of each earlier part and `own` the margin so
    /// far.
    pub(super) fn bounds(&self, of: &[[f64; 2]], own: Margin) -> [f64; 2] {
        match &self.work {
            PartWork::Growing(Growing { choice, .. }) => {
                choice.turn_bounds([f64::NEG_INFINITY, choice.turn(own).size()])
            }
            PartWork::Join(Join { choice, a, b }) => {
                let choose = if *choice == Choice::LEAST {
                    smaller
                } else {
                    larger
                };
                let ([a_low, a_high], [b_low, b_high]) = (of[*a], of[*b]);
                [choose(a_low, b_low), choose(a_high, b_high)]
            }
            PartWork::Delay(delay) => of[delay.operand],
            PartWork::Until(_, window) => window.bounds(),
            PartWork::Comparison(_) | PartWork::Extreme(..) | PartWork::Since(..) => margin::ANY,
        }
    }

    /// Returns the part's heap memory in bytes.
    pub(super) fn kept_bytes(&self) -> usize {
        match &self.work {
            PartWork::Comparison(_) | PartWork::Join(_) | PartWork::Growing(_) => 0,
            PartWork::Delay(delay) => size_of_val(delay.margins.as_slice()),
            PartWork::Extreme(_, window) => {
                window.candidates.capacity() * size_of::<(u64, Margin)>()
            }
            PartWork::Until(_, window) => window.kept_bytes(),
            PartWork::Since(_, window) => window.kept_bytes(),
        }
    }
}

impl Comparison {
    pub(super) fn new(relation: Relation, left: usize, right: usize) -> Self {
        // The size is that of `left >= right` or `left == right`, negated or not.
        let (is_equality, is_turned) = match relation {
            Relation::Less | Relation::Greater => (false, true),
            Relation::LessOrEqual | Relation::GreaterOrEqual => (false, false),
            Relation::Equal => (true, false),
            Relation::NotEqual => (true, true),
        };
        // `a > b` is `b < a`, and `a <= b` is the negation of that.
        let (left, right) = match relation {
            Relation::Greater | Relation::LessOrEqual => (right, left),
            _ => (left, right),
        };
        Self {
            sign: u64::from(is_equality) << 63,
            turned: -i64::from(is_turned),
            left,
            right,
        }
    }

    /// Returns the distance of both sides, positive if the relation holds.
    #[inline]
    pub(super) fn margin(self, sides: &[ComparedSide], step: u64) -> Margin {
        let (a, b) = (sides[self.left].value, sides[self.right].value);
        let difference = a - b;
        if difference.is_nan() {
            return self.margin_without_difference(a, b, step);
        }
        self.margin_of(difference, step)
    }

    /// Computes the margin without branches, because the processor could not predict the order of comparisons.
    #[inline]
    fn margin_of(self, difference: f64, step: u64) -> Margin {
        // The sum is never negative zero: of equal sides `==` and `>=` hold, `!=` and `<` fail.
        let size = f64::from_bits(difference.to_bits() | self.sign) + 0.0;
        Margin::new(size, self.turned, step)
    }

    #[cold]
    fn margin_without_difference(self, a: f64, b: f64, step: u64) -> Margin {
        if a.is_nan() || b.is_nan() {
            Margin::new(f64::NEG_INFINITY, 0, step)
        } else {
            // Two equal infinities.
            self.margin_of(0.0, step)
        }
    }
}

impl Join {
    #[inline]
    pub(super) fn margin(self, margins: &[Margin]) -> Margin {
        let (a, b) = (margins[self.a], margins[self.b]);
        if self.choice.prefers(b, a) { b } else { a }
    }
}

impl Growing {
    /// Processes the operand's step of a row; `own` is the margin so far. Returns `true` if the window's result became
    /// certain.
    #[inline]
    pub(super) fn observe(self, operand: Margin, own: &mut Margin) -> bool {
        // For most steps the size alone shows that they change nothing.
        if self.choice.is_worse(operand, *own) || !self.choice.prefers(operand, *own) {
            return false;
        }
        let before = std::mem::replace(own, operand);
        before.holds() != operand.holds()
    }
}

impl Delay {
    /// Returns the delayed margin and stores the operand's latest.
    #[inline]
    fn observe(&mut self, row: u64, operands: &[Margin], own: &mut Margin) {
        let last = self.margins.len() - 1;
        let after = |place: usize| if place == last { 0 } else { place + 1 };
        if row >= self.gives_from {
            *own = self.margins[self.next_out];
            self.next_out = after(self.next_out);
        }
        if row <= self.takes_until {
            self.margins[self.next_in] = operands[self.operand];
            self.next_in = after(self.next_in);
        }
    }
}
