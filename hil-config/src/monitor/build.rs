//! Conversion of formulas into the parts that evaluate them.
//!
//! Called by [`Monitors::new`](super::Monitors::new) and [`EveryStep::new`](super::EveryStep::new). Works from the
//! operands up to determine the computation of each part and its delay in rows, then from the whole formula down to
//! determine the needed steps.

use std::collections::HashMap;
use std::ops::Range;

use super::draft::{Draft, Task, WindowKind};
use super::margin::Choice;
use super::part::{self, Chained};
use super::{ComparedSide, FormulaContext, draft};
use crate::expression::{ExpressionError, Program};
use crate::formula::{self, Comparison, Formula, Node};

/// Maximum number of margins that a formula may keep, which takes 64 MiB.
const MOST_KEPT: u64 = 1 << 22;

/// Parts of formulas, operands first, and the sides that they compare.
#[derive(Default)]
pub(super) struct Built {
    pub drafts: Vec<Draft>,
    /// Part that represents each whole formula.
    pub wholes: Vec<usize>,
    /// Operands of the comparisons, each expression once.
    pub sides: Vec<ComparedSide>,
    /// Index of each expression.
    places: HashMap<String, usize>,
}

impl Built {
    /// Adds the parts of a formula, judged at step 0 alone or at every step at which it can be judged; with `unused`, of
    /// the formula in which the conclusion of that `implies` is false.
    pub(super) fn add(
        &mut self,
        formula: &Formula,
        unused: Option<usize>,
        context: &FormulaContext<'_>,
        at_start: bool,
    ) -> Result<(), ExpressionError> {
        let nodes = formula.nodes();
        let begin = self.drafts.len();
        let mut builder = Builder {
            formula,
            unused,
            context,
            built: self,
            known: vec![[None; 2]; nodes.len()],
        };
        let whole = builder.draft(nodes.len() - 1, at_start)?;
        let last = if at_start {
            0
        } else {
            self.drafts[whole].until
        };
        draft::want(&mut self.drafts, begin, (0, last));
        self.wholes.push(whole);
        let margins: u64 = self.drafts[begin..].iter().map(Draft::margins).sum();
        if margins <= MOST_KEPT {
            return Ok(());
        }
        let message = format!(
            "the formula would keep {margins} numbers at a time, more than {MOST_KEPT}: shorten the windows inside other operators"
        );
        Err(formula.error(0..formula.to_string().len(), message))
    }

    /// Returns the index of an expression among the sides.
    fn side(&mut self, program: Program, constant: Option<f64>) -> usize {
        let next = self.sides.len();
        // Keyed by operations and columns, as equal expressions may differ in spaces.
        let place = *(self.places.entry(format!("{program:?}"))).or_insert(next);
        if place == next {
            self.sides.push(match constant {
                Some(value) => ComparedSide {
                    value,
                    program: None,
                },
                None => ComparedSide {
                    value: f64::NAN,
                    program: Some(program),
                },
            });
        }
        place
    }
}

struct Builder<'a> {
    formula: &'a Formula,
    /// Index of the `implies` whose conclusion counts as false.
    unused: Option<usize>,
    context: &'a FormulaContext<'a>,
    built: &'a mut Built,
    /// Drafts of each node and of its negation: parts that `rise` and `until` need twice are created only once.
    known: Vec<[Option<usize>; 2]>,
}

type Drafted = Result<usize, ExpressionError>;

/// Node whose part is needed.
#[derive(Clone, Copy, Debug)]
struct Request {
    node: usize,
    /// `true` for the part of the node, `false` for the part of its negation.
    holds: bool,
    /// `true` for a part that is evaluated at step 0 only.
    at_start: bool,
}

impl Builder<'_> {
    /// Drafts the part of a formula that ends with this node.
    ///
    /// Operands come first, using an explicit stack, because a chain of `and` is as deep as it is long.
    fn draft(&mut self, node: usize, at_start: bool) -> Drafted {
        let whole = Request {
            node,
            holds: true,
            at_start,
        };
        let mut waiting = vec![whole];
        while let Some(&next) = waiting.last() {
            let operands = self.operands(next).into_iter().flatten().rev();
            let missing: Vec<Request> =
                (operands.filter(|one| self.known(*one).is_none())).collect();
            if !missing.is_empty() {
                waiting.extend(missing);
                continue;
            }
            waiting.pop();
            if self.known(next).is_none() {
                let drafted = self.join_operands(next)?;
                self.known[next.node][usize::from(next.holds)] = Some(drafted);
            }
        }
        Ok(self.drafted(whole))
    }

    fn known(&self, request: Request) -> Option<usize> {
        self.known[request.node][usize::from(request.holds)]
    }

    fn drafted(&self, request: Request) -> usize {
        self.known(request).expect("operands are drafted first")
    }

    /// Returns the operands of a node, or a single operand twice; `None` for a comparison.
    fn operands(&self, request: Request) -> Option<[Request; 2]> {
        let Request {
            holds, at_start, ..
        } = request;
        let of = |node, holds, at_start| Request {
            node,
            holds,
            at_start,
        };
        Some(match self.formula.nodes()[request.node] {
            Node::Comparison(_) => return None,
            Node::Not(operand) => [of(operand, !holds, at_start); 2],
            Node::And(a, b) | Node::Or(a, b) => [a, b].map(|node| of(node, holds, at_start)),
            Node::Implies(a, b) => [of(a, !holds, at_start), of(b, holds, at_start)],
            Node::Over { operand, .. } => [of(operand, holds, false); 2],
            Node::Chain { hold, reach, .. } => [hold, reach].map(|node| of(node, holds, false)),
            // `rise f` is `f and once[1 step] not f`; its negation negates every part.
            Node::Edge { rises, operand } => {
                [rises == holds, rises != holds].map(|holds| of(operand, holds, false))
            }
        })
    }

    /// Creates the part of a node whose operands are drafted.
    fn join_operands(&mut self, request: Request) -> Drafted {
        let Request {
            node,
            holds,
            at_start,
        } = request;
        let formula = self.formula;
        let operands = self.operands(request);
        let drafted = operands.map(|both| both.map(|one| self.drafted(one)));
        let [one, other] = drafted.unwrap_or_default();
        match &formula.nodes()[node] {
            Node::Comparison(comparison) => self.comparison(comparison, holds),
            Node::Not(_) => Ok(one),
            Node::Implies(..) if self.unused == Some(node) => {
                // `not premise`, at the steps at which the whole implication can be evaluated.
                let Draft { delay, until, .. } = self.built.drafts[one];
                let until = until.min(self.built.drafts[other].until);
                let task = Task::Join(Choice::least_if(true), one, one);
                Ok(self.push(task, delay, until))
            }
            Node::And(..) => Ok(self.join(one, other, holds)),
            Node::Or(..) | Node::Implies(..) => Ok(self.join(one, other, !holds)),
            Node::Over {
                is_past,
                every,
                window,
                ..
            } => {
                let until = self.built.drafts[one].until;
                let (begin, end) = self.offsets(window, *is_past, at_start, until)?;
                self.over(*every == holds, one, begin, end, &window.span)
            }
            Node::Chain {
                is_past, window, ..
            } => self.chain(*is_past, window, one, other, holds, at_start),
            Node::Edge { .. } => {
                let nowhere = 0..0; // a step earlier is always inside the run
                let before = self.over(!holds, other, -1, -1, &nowhere)?;
                Ok(self.join(one, before, holds))
            }
        }
    }

    fn comparison(&mut self, comparison: &Comparison, holds: bool) -> Drafted {
        let Comparison {
            relation,
            left,
            right,
        } = comparison;
        let mut sides = [left, right].into_iter();
        let ends_early = sides.any(|side| self.context.is_without_end(&side.expression));
        let relation = if holds { *relation } else { relation.negated() };
        let (left, right) = (self.side(left)?, self.side(right)?);
        let task = Task::Comparison(part::Comparison::new(relation, left, right));
        let until = self.context.steps - u64::from(ends_early);
        Ok(self.push(task, 0, until))
    }

    fn side(&mut self, side: &formula::FormulaSide) -> Drafted {
        let program = side.expression.compile_signal(self.context.columns);
        let program = program.map_err(|error| self.formula.inside(error, side.start))?;
        Ok(self.built.side(program, side.expression.constant()))
    }

    /// Creates `and`, or `or` if `and` is `false`.
    fn join(&mut self, a: usize, b: usize, and: bool) -> usize {
        let Built { drafts, .. } = &*self.built;
        let delay = drafts[a].delay.max(drafts[b].delay);
        let until = drafts[a].until.min(drafts[b].until);
        let (a, b) = (self.delayed(a, delay), self.delayed(b, delay));
        let task = Task::Join(Choice::least_if(and), a, b);
        self.push(task, delay, until)
    }

    fn over(
        &mut self,
        every: bool,
        operand: usize,
        begin: i64,
        end: i64,
        span: &Range<usize>,
    ) -> Drafted {
        let Draft { delay, until, .. } = self.built.drafts[operand];
        let delay = delay.max(end.min(0).unsigned_abs());
        let operand = self.delayed(operand, delay);
        self.window(
            WindowKind::Extreme(operand),
            Choice::least_if(every),
            (begin, end),
            delay,
            until,
            span,
        )
    }

    /// For a window that does not begin at the current step, `until` and `since` also require the first operand to hold
    /// over the gap.
    fn chain(
        &mut self,
        is_past: bool,
        window: &formula::Window,
        hold: usize,
        reach: usize,
        holds: bool,
        at_start: bool,
    ) -> Drafted {
        let drafts = [hold, reach].map(|at| self.built.drafts[at]);
        let until = drafts[0].until.min(drafts[1].until);
        let (begin, end) = self.offsets(window, is_past, at_start, until)?;
        let gap = match (is_past, begin, end) {
            (false, 1.., _) => Some((0, begin - 1)),
            (true, _, ..=-1) => Some((end + 1, 0)),
            _ => None,
        };
        let longest = drafts[0].delay.max(drafts[1].delay);
        let delay = longest.max(end.min(0).unsigned_abs());
        let of = Chained {
            hold: self.delayed(hold, delay),
            reach: self.delayed(reach, delay),
        };
        let kind = if is_past {
            WindowKind::Since(of)
        } else {
            WindowKind::Until(of)
        };
        let choice = Choice::least_if(holds);
        let chain = self.window(kind, choice, (begin, end), delay, until, &window.span)?;
        let Some((begin, end)) = gap else {
            return Ok(chain);
        };
        let gap = self.over(holds, hold, begin, end, &window.span)?;
        Ok(self.join(gap, chain, holds))
    }

    fn window(
        &mut self,
        kind: WindowKind,
        choice: Choice,
        (begin, end): (i64, i64),
        delay: u64,
        operand_until: u64,
        span: &Range<usize>,
    ) -> Drafted {
        let Some(until) = operand_until.checked_add_signed(-end) else {
            let message = self.context.beyond_the_run(operand_until);
            return Err(self.formula.error(span.clone(), message));
        };
        let task = Task::Window {
            kind,
            choice,
            begin,
            end,
            delay,
        };
        let until = until.min(self.context.steps);
        Ok(self.push(task, delay.saturating_add_signed(end), until))
    }

    /// Delays a part, so that its margin is known N rows after each step.
    fn delayed(&mut self, operand: usize, delay: u64) -> usize {
        let Draft {
            delay: own, until, ..
        } = self.built.drafts[operand];
        if own == delay {
            return operand;
        }
        let task = Task::Delay {
            operand,
            by: delay - own,
        };
        self.push(task, delay, until)
    }

    fn offsets(
        &self,
        window: &formula::Window,
        is_past: bool,
        at_start: bool,
        until: u64,
    ) -> Result<(i64, i64), ExpressionError> {
        let offsets = self.context.offsets(window, is_past, at_start, until);
        offsets.map_err(|message| self.formula.error(window.span.clone(), message))
    }

    fn push(&mut self, task: Task, delay: u64, until: u64) -> usize {
        self.built.drafts.push(Draft {
            task,
            delay,
            until,
            needed_steps: None,
        });
        self.built.drafts.len() - 1
    }
}
