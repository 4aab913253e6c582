//! A part of a formula at work: one margin for each row.
//!
//! Made by [`draft`](super::draft), called by [`Monitors`](super::Monitors) at the rows at which the part
//! is [due](super::due::Due) and no others.

use super::ComparedSide;
use super::margin::{self, Choice, Margin, larger, smaller};
use super::window::{Chain, Extreme, Since, Until};
use crate::formula::Relation;

/// A part of a formula.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub work: PartWork,
    /// True if only one margin of the part is wanted.
    pub is_single: bool,
    /// The row at which every margin that is wanted was computed.
    pub done_at: u64,
}

/// Work of a part. Operands are places among the parts before it.
#[derive(Clone, Debug)]
pub(super) enum PartWork {
    Comparison(Comparison),
    Join(Join),
    Growing(Growing),
    /// An operand that is known earlier than what it is joined with.
    Delay(Delay),
    /// A window of `always` and its like that slides.
    Extreme(usize, Extreme),
    Until(Chained, Chain<Until>),
    Since(Chained, Chain<Since>),
}

/// A comparison of two sides, as one of `left < right` and `left == right` or the opposite of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Comparison {
    /// The sign bit of `left == right`, which fails by the distance, whichever side is the larger.
    sign: u64,
    /// All bits set of the opposite.
    turned: i64,
    /// Places among the sides.
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

/// A window of `always` and its like that only grows. Its own margin is what it came to so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Growing {
    pub choice: Choice,
    pub operand: usize,
}

/// The operands of `until` and `since`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chained {
    pub hold: usize,
    pub reach: usize,
}

/// A ring of the margins that are not given yet.
#[derive(Clone, Debug)]
pub(super) struct Delay {
    pub operand: usize,
    /// The last row at which it takes a margin of the operand.
    pub takes_until: u64,
    /// The first row at which it gives one.
    pub gives_from: u64,
    pub kept: Vec<Margin>,
    pub next_in: usize,
    pub next_out: usize,
}

impl Part {
    /// The margin before the first row.
    pub(super) fn first_margin(&self) -> Margin {
        match self.work {
            PartWork::Growing(window) => window.choice.none(),
            _ => Margin::BOTTOM,
        }
    }

    /// Returns true if every margin that is wanted was computed.
    #[inline]
    pub(super) const fn is_done(&self, row: u64) -> bool {
        row >= self.done_at
    }

    /// Looks at a row; `operands` are the newest margins of the parts before, `own` becomes its own.
    /// Returns true if a margin became certain before it is computed.
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

    /// The operands that it joins or delays, whose margins it has.
    pub(super) const fn joined(&self) -> [Option<usize>; 2] {
        match self.work {
            PartWork::Join(Join { a, b, .. }) => [Some(a), Some(b)],
            PartWork::Delay(Delay { operand, .. }) => [Some(operand), None],
            _ => [None; 2],
        }
    }

    /// Certainty of its only margin before the margin is computed; `of` has that of each part before and
    /// `own` is its margin so far.
    pub(super) fn certain(&self, of: &[Option<bool>], own: Margin) -> Option<bool> {
        match &self.work {
            // What is least fails as soon as one fails, what is greatest holds as soon as one holds.
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

    /// Between which two sizes its only margin will be, before that is computed; `of` are those of
    /// each part before and `own` is its margin so far.
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

    /// Bytes that it keeps beside itself.
    pub(super) fn kept_bytes(&self) -> usize {
        match &self.work {
            PartWork::Comparison(_) | PartWork::Join(_) | PartWork::Growing(_) => 0,
            PartWork::Delay(delay) => size_of_val(delay.kept.as_slice()),
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
        // The size is that of `left >= right` or `left == right`, turned or not.
        let (is_equality, is_turned) = match relation {
            Relation::Less | Relation::Greater => (false, true),
            Relation::LessOrEqual | Relation::GreaterOrEqual => (false, false),
            Relation::Equal => (true, false),
            Relation::NotEqual => (true, true),
        };
        // `a > b` is `b < a`, and `a <= b` the opposite of that.
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

    /// Gives the distance of both sides, with the sign that says whether they have the relation.
    #[inline]
    pub(super) fn margin(self, sides: &[ComparedSide], step: u64) -> Margin {
        let (a, b) = (sides[self.left].value, sides[self.right].value);
        let difference = a - b;
        if difference.is_nan() {
            return self.margin_without_difference(a, b, step);
        }
        self.margin_of(difference, step)
    }

    /// Gives the margin without a branch: which comparison comes next is nothing that a processor could foresee.
    #[inline]
    fn margin_of(self, difference: f64, step: u64) -> Margin {
        // The sum is no negative zero: of equal sides `==` and `>=` hold, `!=` and `<` fail.
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
    /// Takes the operand's step of a row; `own` is the margin so far. Returns true if what the window
    /// comes to became certain.
    #[inline]
    pub(super) fn observe(self, operand: Margin, own: &mut Margin) -> bool {
        // Of most steps the size alone tells that they change nothing.
        if self.choice.is_worse(operand, *own) || !self.choice.prefers(operand, *own) {
            return false;
        }
        let before = std::mem::replace(own, operand);
        before.holds() != operand.holds()
    }
}

impl Delay {
    /// Gives the margin that is wanted and keeps the operand's newest.
    #[inline]
    fn observe(&mut self, row: u64, operands: &[Margin], own: &mut Margin) {
        let last = self.kept.len() - 1;
        let after = |place: usize| if place == last { 0 } else { place + 1 };
        if row >= self.gives_from {
            *own = self.kept[self.next_out];
            self.next_out = after(self.next_out);
        }
        if row <= self.takes_until {
            self.kept[self.next_in] = operands[self.operand];
            self.next_in = after(self.next_in);
        }
    }
}
