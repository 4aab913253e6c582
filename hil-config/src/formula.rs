//! Formulas of requirements: comparisons of expressions, joined by logic and by time.
//!
//! Read by the check; a [`Monitor`](crate::monitor::Monitor) judges one while records arrive. Never
//! computes anything itself. `docs/requirements.md` tells a user the same with examples.
//!
//! ```text
//! formula     = disjunction [ "implies" formula ]
//! disjunction = conjunction { "or" conjunction }
//! conjunction = pair { "and" pair }
//! pair        = operand [ ("until" | "since") [ bounds ] operand ]
//! operand     = "not" operand
//!             | ("always" | "eventually" | "historically" | "once") [ bounds ] operand
//!             | ("rise" | "fall") operand
//!             | comparison | "(" formula ")"
//! comparison  = sum ("<" | "<=" | ">" | ">=" | "==" | "!=") sum
//! bounds      = "[" time "," time "]"
//! time        = number [ "s" | "ms" | "us" | "ns" ]
//! ```
//!
//! A `sum` is one of the [expressions](crate::expression), without reductions.
//!
//! **Meaning** (Maler and Nickovic 2004, in discrete time). A formula holds or not at each step `k`;
//! that of a requirement is judged at step 0.
//!
//! | formula | holds at step `k` if |
//! |---|---|
//! | `always[a,b] f` | `f` holds at each step of `k + a ..= k + b` |
//! | `eventually[a,b] f` | it does at one of them |
//! | `f until[a,b] g` | `g` holds at one step `j` of them and `f` at each of `k .. j` |
//! | `historically[a,b] f` | `f` holds at each step of `k - b ..= k - a` that the run has |
//! | `once[a,b] f` | it does at one of them |
//! | `f since[a,b] g` | `g` holds at one step `j` of them and `f` at each after `j`, up to `k` |
//! | `rise f` | `f` holds at `k` and did not at `k - 1`; not at step 0 |
//! | `fall f` | the other way round |
//!
//! **Robustness** (Donze and Maler 2010): a comparison has the distance of its two sides, with the
//! sign that says whether it holds; `and` and `always` take the least, `or` and `eventually` the
//! greatest, `not` turns the sign. Zero has a sign too: -0 where `x < 1` just fails at 1, +0 where
//! `x <= 1` just holds. So the sign bit of the robustness *is* the verdict.
//!
//! **Time** is steps: the begin of bounds rounds up, the end down. Without bounds `always`,
//! `eventually` and `until` go as far as the run lets their operands be judged, and stand only where
//! they are judged at step 0; the operators of the past begin at step 0. A formula that would look
//! beyond the end of the run is refused, so no window is ever cut off there.
//!
//! **What does not exist** (NaN) counts against the requirement: `not` is taken to the comparisons
//! first (`not x < 1` is `x >= 1`), and a comparison without a value then fails by minus infinity.
//! There is no formula that such a value could make hold.

mod parser;

use std::ops::Range;

use crate::expression::{Columns, Expression, ExpressionError};

pub(crate) use parser::is_operator;

/// A formula, read but not yet bound to columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    text: String,
    /// Operands before what is made of them; the last is the whole.
    nodes: Vec<Node>,
}

/// A part of a formula; operands are places in its list.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Node {
    Comparison(Comparison),
    Not(usize),
    And(usize, usize),
    Or(usize, usize),
    Implies(usize, usize),
    /// `always`, `eventually`, `historically`, `once`.
    Over {
        is_past: bool,
        /// Whether it must hold at every step of the window.
        every: bool,
        window: Window,
        operand: usize,
    },
    /// `until`, `since`.
    Chain {
        is_past: bool,
        window: Window,
        hold: usize,
        reach: usize,
    },
    /// `rise`, `fall`.
    Edge {
        rises: bool,
        operand: usize,
    },
}

/// A comparison of a formula as it is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compared<'a> {
    /// What stands before the sign.
    pub left: &'a Expression,
    /// `<`, `<=`, `>`, `>=`, `==` or `!=`.
    pub relation: &'static str,
    /// What stands after it.
    pub right: &'a Expression,
    /// First and last time in s at which it may count.
    pub window_s: [f64; 2],
}

/// Two expressions, compared.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Comparison {
    pub relation: Relation,
    pub left: Side,
    pub right: Side,
}

/// An expression and where it begins in the formula.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Side {
    pub expression: Expression,
    pub start: usize,
}

/// How two numbers are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Relation {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
}

/// The window of a temporal operator.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Window {
    /// Begin and end in s; none: as far as the run goes.
    pub bounds_s: Option<(f64, f64)>,
    /// The operator with its bounds.
    pub span: Range<usize>,
}

impl Relation {
    const ALL: [Self; 6] = [
        Self::Less,
        Self::LessOrEqual,
        Self::Greater,
        Self::GreaterOrEqual,
        Self::Equal,
        Self::NotEqual,
    ];

    const fn symbol(self) -> &'static str {
        match self {
            Self::Less => "<",
            Self::LessOrEqual => "<=",
            Self::Greater => ">",
            Self::GreaterOrEqual => ">=",
            Self::Equal => "==",
            Self::NotEqual => "!=",
        }
    }

    /// The relation of all pairs of numbers that do not have this one.
    pub(crate) const fn negated(self) -> Self {
        match self {
            Self::Less => Self::GreaterOrEqual,
            Self::LessOrEqual => Self::Greater,
            Self::Greater => Self::LessOrEqual,
            Self::GreaterOrEqual => Self::Less,
            Self::Equal => Self::NotEqual,
            Self::NotEqual => Self::Equal,
        }
    }

    #[inline]
    pub(crate) fn holds(self, a: f64, b: f64) -> bool {
        match self {
            Self::Less => a < b,
            Self::LessOrEqual => a <= b,
            Self::Greater => a > b,
            Self::GreaterOrEqual => a >= b,
            Self::Equal => a == b,
            Self::NotEqual => a != b,
        }
    }
}

impl std::fmt::Display for Formula {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.text.fmt(f)
    }
}

impl Formula {
    /// Reads a formula.
    ///
    /// # Errors
    /// If it does not follow the grammar, or bounds are out of order.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        parser::parse(text)
    }

    /// Every name that no column has.
    #[must_use]
    pub fn unknown_names(&self, columns: &Columns) -> Vec<ExpressionError> {
        let errors = self.sides().flat_map(|side| {
            let errors = side.expression.unknown_names(columns).into_iter();
            errors.map(|error| self.inside(error, side.start))
        });
        errors.collect()
    }

    /// The unit that all its comparisons have, if the names of their signals tell one.
    #[must_use]
    pub fn unit(&self) -> Option<&'static str> {
        let mut units = self.sides().flat_map(|side| side.expression.units());
        let first = units.next()??;
        units.all(|unit| unit == Some(first)).then_some(first)
    }

    /// Its comparisons, each with the time of a run of `end_s` at which it may count.
    #[must_use]
    pub fn comparisons(&self, end_s: f64) -> Vec<Compared<'_>> {
        let mut windows_s = vec![None; self.nodes.len()];
        if let Some(whole) = windows_s.last_mut() {
            *whole = Some([0.0, 0.0]); // judged at step 0
        }
        let mut compared = Vec::new();
        // From the whole down to its operands.
        for (place, node) in self.nodes.iter().enumerate().rev() {
            let Some([start_s, stop_s]) = windows_s[place] else {
                continue;
            };
            let mut look = |operand: usize, window_s: [f64; 2]| {
                let [start_s, stop_s]: [f64; 2] = windows_s[operand].unwrap_or(window_s);
                let first_s = if window_s[0] < start_s {
                    window_s[0]
                } else {
                    start_s
                };
                let last_s = if window_s[1] > stop_s {
                    window_s[1]
                } else {
                    stop_s
                };
                windows_s[operand] = Some([first_s, last_s]);
            };
            let moved = |is_past: bool, window: &Window| match (is_past, window.bounds_s) {
                (false, Some((a, b))) => [start_s + a, stop_s + b],
                (false, None) => [start_s, end_s],
                (true, Some((a, b))) => [start_s - b, stop_s - a],
                (true, None) => [0.0, stop_s],
            };
            match node {
                Node::Comparison(Comparison {
                    relation,
                    left,
                    right,
                }) => compared.push(Compared {
                    left: &left.expression,
                    relation: relation.symbol(),
                    right: &right.expression,
                    window_s: [
                        if start_s > 0.0 { start_s } else { 0.0 },
                        if stop_s < end_s { stop_s } else { end_s },
                    ],
                }),
                Node::Not(operand) | Node::Edge { operand, .. } => {
                    look(*operand, [start_s, stop_s])
                }
                Node::And(a, b) | Node::Or(a, b) | Node::Implies(a, b) => {
                    look(*a, [start_s, stop_s]);
                    look(*b, [start_s, stop_s]);
                }
                Node::Over {
                    is_past,
                    window,
                    operand,
                    ..
                } => look(*operand, moved(*is_past, window)),
                Node::Chain {
                    is_past,
                    window,
                    hold,
                    reach,
                } => {
                    let [reach_start_s, reach_stop_s] = moved(*is_past, window);
                    look(*reach, [reach_start_s, reach_stop_s]);
                    let first_s = if *is_past { reach_start_s } else { start_s };
                    let last_s = if *is_past { stop_s } else { reach_stop_s };
                    look(*hold, [first_s, last_s]);
                }
            }
        }
        compared.reverse();
        compared
    }

    /// Its parts, operands before what is made of them.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    pub(crate) fn error(&self, span: Range<usize>, message: impl Into<String>) -> ExpressionError {
        ExpressionError::new(&self.text, span, message)
    }

    /// An error of an expression that begins at byte `start`.
    pub(crate) fn inside(&self, error: ExpressionError, start: usize) -> ExpressionError {
        error.inside(&self.text, start)
    }

    fn sides(&self) -> impl Iterator<Item = &Side> {
        let comparisons = self.nodes.iter().filter_map(|node| match node {
            Node::Comparison(comparison) => Some(comparison),
            _ => None,
        });
        comparisons.flat_map(|Comparison { left, right, .. }| [left, right])
    }
}
