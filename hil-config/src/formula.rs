//! Formulas of requirements: comparisons of expressions, joined by logical and temporal operators.
//!
//! Parsed by the check; [`Monitors`](crate::monitor::Monitors) evaluate them as records arrive. Nothing is computed
//! here. `docs/requirements.md` explains the same for users, with examples.
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
//! time        = number [ unit of time ]
//! ```
//!
//! A `sum` is the sum of [expressions](crate::expression), without reductions.
//!
//! **Semantics** (Maler and Nickovic 2004, in discrete time). A formula is true or false at each step `k`; a
//! requirement is evaluated at step 0.
//!
//! | formula | holds at step `k` if |
//! |---|---|
//! | `always[a,b] f` | `f` holds at each step of `k + a ..= k + b` |
//! | `eventually[a,b] f` | `f` holds at one of them |
//! | `f until[a,b] g` | `g` holds at one step `j` of them and `f` at each of `k .. j` |
//! | `historically[a,b] f` | `f` holds at each step of `k - b ..= k - a` that the run has |
//! | `once[a,b] f` | `f` holds at one of them |
//! | `f since[a,b] g` | `g` holds at one step `j` of them and `f` at each after `j`, up to `k` |
//! | `rise f` | `f` holds at `k` and did not at `k - 1`; not at step 0 |
//! | `fall f` | `f` held at `k - 1` and does not at `k`; not at step 0 |
//!
//! **Robustness** (Donze and Maler 2010): a comparison has the distance of its two sides, positive if it holds and
//! negative otherwise; `and` and `always` take the minimum, `or` and `eventually` the maximum, `not` changes the sign.
//! Zero has a sign too: -0 where `x < 1` just fails at 1, +0 where `x <= 1` just holds. So the sign bit of the
//! robustness *is* the verdict.
//!
//! **Time** is in steps: the beginning of bounds rounds up, the end down. Without bounds `always`, `eventually` and
//! `until` extend as far as their operands can be evaluated within the run, and are allowed only where they are
//! evaluated at step 0; past operators begin at step 0. A formula that would look beyond the end of the run is refused,
//! so no window is ever truncated there.
//!
//! **Missing values** (NaN) count against the requirement: `not` is first pushed down to the comparisons (`not x < 1`
//! becomes `x >= 1`), and a comparison with a missing value then fails by minus infinity. A missing value cannot make a
//! formula hold.

mod parser;

use std::ops::Range;

use crate::expression::{Columns, Expression, ExpressionError, replaced};
use crate::problem::MOST_PROBLEMS;

pub(crate) use parser::is_operator;

/// Formula, parsed but not yet bound to columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    text: String,
    /// Nodes, operands before the operators that use them; the last node is the whole formula.
    nodes: Vec<Node>,
    /// Each `implies`, with the place of its premise in the text.
    implications: Vec<(usize, Range<usize>)>,
}

/// Node of a formula; operands are indices into its list.
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
        /// `true` if the operand must hold at every step of the window.
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

/// Comparison of a formula, for display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compared<'a> {
    /// Expression before the relation.
    pub left: &'a Expression,
    /// `<`, `<=`, `>`, `>=`, `==` or `!=`.
    pub relation: &'static str,
    /// Expression after the relation.
    pub right: &'a Expression,
    /// First and last time in s at which the comparison may apply.
    pub window_s: [f64; 2],
    /// `true` if the robustness of the formula falls as that of the comparison rises, as under `not`; `None` if the
    /// robustness may do either, as under `rise`.
    pub is_turned: Option<bool>,
}

/// Times at which a part of a formula may count, and the direction in which it counts.
#[derive(Clone, Copy, Debug)]
struct Reach {
    from_s: f64,
    until_s: f64,
    is_turned: Option<bool>,
}

impl Reach {
    /// Returns the reach of the operand of a window, in a run of `end_s`.
    fn moved(self, is_past: bool, window: &Window, end_s: f64) -> Self {
        let (from_s, until_s) = match (is_past, window.bounds_s) {
            (false, Some((a, b))) => (self.from_s + a, self.until_s + b),
            (false, None) => (self.from_s, end_s),
            (true, Some((a, b))) => (self.from_s - b, self.until_s - a),
            (true, None) => (0.0, self.until_s),
        };
        Self {
            from_s,
            until_s,
            ..self
        }
    }
}

/// Comparison of two expressions.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Comparison {
    pub relation: Relation,
    pub left: FormulaSide,
    pub right: FormulaSide,
}

/// Expression with its offset in the formula.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FormulaSide {
    pub expression: Expression,
    pub start: usize,
}

/// Relation between two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Relation {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
}

/// Window of a temporal operator.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Window {
    /// Beginning and end in s; `None` extends as far as the run.
    pub bounds_s: Option<(f64, f64)>,
    /// Operator with its bounds.
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

    /// Returns the relation that holds for exactly those pairs of numbers for which this one does not.
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
}

impl std::fmt::Display for Formula {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.text.fmt(f)
    }
}

impl Formula {
    /// Parses a formula.
    ///
    /// # Errors
    /// If the text is malformed, or bounds are out of order.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        parser::parse(text)
    }

    /// Lists the expressions that the formula compares.
    pub(crate) fn expressions(&self) -> impl Iterator<Item = &Expression> {
        self.sides().map(|side| &side.expression)
    }

    /// Returns an error for each name that no column has, up to a limit.
    #[must_use]
    pub fn unknown_names(&self, columns: &Columns) -> Vec<ExpressionError> {
        let errors = self.sides().flat_map(|side| {
            let errors = side.expression.unknown_names(columns).into_iter();
            errors.map(|error| self.inside(error, side.start))
        });
        errors.take(MOST_PROBLEMS + 1).collect()
    }

    /// Replaces aliases by the names of their columns, which recordings use.
    ///
    /// # Errors
    /// If the text would exceed the maximum length.
    pub(crate) fn with_own_names(self, columns: &Columns) -> Result<Self, ExpressionError> {
        let mut sides: Vec<_> = self.sides().collect();
        sides.sort_by_key(|side| side.start);
        let aliases = sides.into_iter().flat_map(|side| {
            let aliases = side.expression.aliases(columns);
            aliases.map(|(span, own)| (span.start + side.start..span.end + side.start, own))
        });
        match replaced(&self.text, aliases) {
            Some(text) => Self::parse(&text),
            None => Ok(self),
        }
    }

    /// Returns the unit common to all comparisons among these columns, if there is one.
    ///
    /// # Errors
    /// The first sum or comparison of values of different known units.
    pub fn unit(&self, columns: &Columns) -> Result<Option<String>, ExpressionError> {
        let mut units = Vec::new();
        for node in &self.nodes {
            if let Node::Comparison(comparison) = node {
                units.push(self.unit_of(comparison, columns)?);
            }
        }
        units.dedup();
        let one = units.pop().flatten();
        Ok(one.filter(|_| units.is_empty()))
    }

    fn unit_of(
        &self,
        Comparison { left, right, .. }: &Comparison,
        columns: &Columns,
    ) -> Result<Option<String>, ExpressionError> {
        let inside = |side: &FormulaSide, error| self.inside(error, side.start);
        let a = (left.expression.unit(columns)).map_err(|error| inside(left, error))?;
        let b = (right.expression.unit(columns)).map_err(|error| inside(right, error))?;
        let unit = a.with(b, "compared").map_err(|mixed| {
            let span = left.start + mixed.first.start..right.start + mixed.second.end;
            self.error(span, &mixed.message)
        })?;
        Ok(unit.symbol().map(Into::into))
    }

    /// Lists the comparisons, each with the time span in which it can affect the result of a run of `end_s`.
    #[must_use]
    pub fn comparisons(&self, end_s: f64) -> Vec<Compared<'_>> {
        // Evaluated at step 0.
        let whole = Reach {
            from_s: 0.0,
            until_s: 0.0,
            is_turned: Some(false),
        };
        let mut reaches = vec![None; self.nodes.len()];
        reaches[self.nodes.len() - 1] = Some(whole);
        let mut compared = Vec::new();
        // From the whole formula down to its operands.
        for (place, node) in self.nodes.iter().enumerate().rev() {
            let Some(reach) = reaches[place] else {
                continue;
            };
            let turned = |is_turned| Some(Reach { is_turned, ..reach });
            match node {
                Node::Comparison(comparison) => compared.push(Compared {
                    left: &comparison.left.expression,
                    relation: comparison.relation.symbol(),
                    right: &comparison.right.expression,
                    window_s: [
                        if reach.from_s > 0.0 {
                            reach.from_s
                        } else {
                            0.0
                        },
                        if reach.until_s < end_s {
                            reach.until_s
                        } else {
                            end_s
                        },
                    ],
                    is_turned: reach.is_turned,
                }),
                Node::Not(operand) => {
                    reaches[*operand] = turned(reach.is_turned.map(|it| !it));
                }
                Node::Edge { operand, .. } => reaches[*operand] = turned(None),
                Node::And(a, b) | Node::Or(a, b) => {
                    reaches[*a] = Some(reach);
                    reaches[*b] = Some(reach);
                }
                Node::Implies(a, b) => {
                    reaches[*a] = turned(reach.is_turned.map(|it| !it));
                    reaches[*b] = Some(reach);
                }
                Node::Over {
                    is_past,
                    window,
                    operand,
                    ..
                } => reaches[*operand] = Some(reach.moved(*is_past, window, end_s)),
                Node::Chain {
                    is_past,
                    window,
                    hold,
                    reach: reached,
                } => {
                    let moved = reach.moved(*is_past, window, end_s);
                    reaches[*reached] = Some(moved);
                    reaches[*hold] = Some(match is_past {
                        true => Reach {
                            until_s: reach.until_s,
                            ..moved
                        },
                        false => Reach {
                            from_s: reach.from_s,
                            ..moved
                        },
                    });
                }
            }
        }
        compared.reverse();
        compared
    }

    /// Lists every `implies` that the formula asks for, with the text of its premise: one that only `and`, `or`,
    /// temporal operators, other conclusions, and an even number of `not` and premises contain.
    pub(crate) fn implications(&self) -> Vec<(usize, &str)> {
        if self.implications.is_empty() {
            return Vec::new();
        }
        let mut is_turned = vec![None; self.nodes.len()];
        is_turned[self.nodes.len() - 1] = Some(false);
        // From the whole formula down to its operands.
        for (place, node) in self.nodes.iter().enumerate().rev() {
            let own = is_turned[place];
            let other = own.map(|it: bool| !it);
            match *node {
                Node::Comparison(_) | Node::Edge { .. } => {}
                Node::Not(operand) => is_turned[operand] = other,
                Node::And(a, b) | Node::Or(a, b) => [is_turned[a], is_turned[b]] = [own; 2],
                Node::Implies(a, b) => [is_turned[a], is_turned[b]] = [other, own],
                Node::Over { operand, .. } => is_turned[operand] = own,
                Node::Chain { hold, reach, .. } => [is_turned[hold], is_turned[reach]] = [own; 2],
            }
        }
        (self.implications.iter())
            .filter(|(place, _)| is_turned[*place] == Some(false))
            .map(|(place, span)| (*place, &self.text[span.clone()]))
            .collect()
    }

    /// Lists the nodes, operands first.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    pub(crate) fn error(&self, span: Range<usize>, message: impl Into<String>) -> ExpressionError {
        ExpressionError::new(&self.text, span, message)
    }

    /// Relocates an error of an expression that begins at byte `start`.
    pub(crate) fn inside(&self, error: ExpressionError, start: usize) -> ExpressionError {
        error.inside(&self.text, start)
    }

    fn sides(&self) -> impl Iterator<Item = &FormulaSide> {
        let comparisons = self.nodes.iter().filter_map(|node| match node {
            Node::Comparison(comparison) => Some(comparison),
            _ => None,
        });
        comparisons.flat_map(|Comparison { left, right, .. }| [left, right])
    }
}
