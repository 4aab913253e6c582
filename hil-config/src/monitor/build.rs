//! From a formula to the parts that judge it.
//!
//! Called once, by [`Monitor::new`](super::Monitor::new). Works from the operands up: what each part
//! computes and how many rows later; then from the whole down: which of its steps are wanted.

use std::collections::HashSet;
use std::ops::Range;

use shared_types::number::exact as number;
use shared_types::time::{Rate, Step};

use super::FormulaContext;
use super::margin::Margin;
use super::part::{Chained, Delay, Part, Window, Work};
use super::window::{Greatest, Least, Since, Steps, Stretch, Until};
use crate::expression::{Columns, Expression, ExpressionError, Program};
use crate::formula::{self, Comparison, Formula, Node, Relation, Side};
use crate::plan::Derived;

/// Most margins that a formula may keep: 64 MiB of them.
const MOST_KEPT: u64 = 1 << 22;

/// The parts of a formula, operands before what is made of them.
pub(super) fn parts(
    formula: &Formula,
    context: &FormulaContext<'_>,
) -> Result<Vec<Part>, ExpressionError> {
    let nodes = formula.nodes();
    let mut builder = Builder {
        formula,
        context,
        drafts: Vec::new(),
        known: vec![[None; 2]; nodes.len()],
    };
    let whole = builder.draft(nodes.len() - 1)?;
    builder.want(whole);
    builder.refuse_too_many()?;
    Ok(builder.drafts.into_iter().map(Draft::part).collect())
}

impl<'a> FormulaContext<'a> {
    /// The context of a run to step `steps`. The columns are those of a row with the derived signals.
    #[must_use]
    pub fn new(columns: &'a Columns, derived: &'a [Derived], rate: Rate, steps: u64) -> Self {
        let mut context = Self {
            columns,
            without_end: HashSet::new(),
            rate,
            steps,
        };
        for Derived {
            name, expression, ..
        } in derived
        {
            if context.is_without_end(expression) {
                context.without_end.insert(name);
            }
        }
        context
    }

    /// True of an expression without a value in the last row.
    fn is_without_end(&self, expression: &Expression) -> bool {
        expression
            .signals()
            .any(|signal| match signal.split_once('.') {
                Some((group, _)) => matches!(group, "command" | "applied" | "internal"),
                None => self.without_end.contains(signal),
            })
    }
}

struct Builder<'a> {
    formula: &'a Formula,
    context: &'a FormulaContext<'a>,
    drafts: Vec<Draft>,
    /// The drafts of each node and of its opposite: what `rise` and `until` need twice is made once.
    known: Vec<[Option<usize>; 2]>,
}

/// A part to be.
#[derive(Debug)]
struct Draft {
    task: Task,
    delay: u64,
    /// The last step at which it can be judged.
    until: u64,
    /// First and last step at which it is wanted.
    wanted: Option<(u64, u64)>,
}

#[derive(Debug)]
enum Task {
    Comparison {
        relation: Relation,
        left: Program,
        right: Program,
    },
    And(usize, usize),
    Or(usize, usize),
    Delay {
        operand: usize,
        by: u64,
    },
    Window {
        kind: Kind,
        /// Begin and end from the step that is judged.
        begin: i64,
        end: i64,
        /// Number of rows by which a step of the operands is taken later than its own row.
        delay: u64,
    },
}

/// Kind of window: what the window does with its operands.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Every(usize),
    Any(usize),
    /// `until`, `since`, or with `falls` the opposite of one.
    Chain {
        is_past: bool,
        falls: bool,
        of: Chained,
    },
}

type Drafted = Result<usize, ExpressionError>;

/// A node whose part is wanted.
#[derive(Clone, Copy, Debug)]
struct Wanted {
    node: usize,
    /// True of the part of the node, false of that of its opposite.
    holds: bool,
    /// True of a part that is judged at step 0 only.
    at_start: bool,
}

impl Builder<'_> {
    /// The part of a formula whose last node this is.
    ///
    /// Operands come first, from a stack of its own: a chain of `and` is as deep as it is long.
    fn draft(&mut self, node: usize) -> Drafted {
        let whole = Wanted {
            node,
            holds: true,
            at_start: true,
        };
        let mut waiting = vec![whole];
        while let Some(&next) = waiting.last() {
            let operands = self.operands(next).into_iter().flatten().rev();
            let missing: Vec<Wanted> =
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

    fn known(&self, wanted: Wanted) -> Option<usize> {
        self.known[wanted.node][usize::from(wanted.holds)]
    }

    fn drafted(&self, wanted: Wanted) -> usize {
        self.known(wanted).expect("operands are drafted first")
    }

    /// The operands of a node, a single one twice; none of a comparison.
    fn operands(&self, wanted: Wanted) -> Option<[Wanted; 2]> {
        let Wanted {
            holds, at_start, ..
        } = wanted;
        let of = |node, holds, at_start| Wanted {
            node,
            holds,
            at_start,
        };
        Some(match self.formula.nodes()[wanted.node] {
            Node::Comparison(_) => return None,
            Node::Not(operand) => [of(operand, !holds, at_start); 2],
            Node::And(a, b) | Node::Or(a, b) => [a, b].map(|node| of(node, holds, at_start)),
            Node::Implies(a, b) => [of(a, !holds, at_start), of(b, holds, at_start)],
            Node::Over { operand, .. } => [of(operand, holds, false); 2],
            Node::Chain { hold, reach, .. } => [hold, reach].map(|node| of(node, holds, false)),
            // `rise f` is `f and once[1 step] not f`, whose opposite turns all of it.
            Node::Edge { rises, operand } => {
                [rises == holds, rises != holds].map(|holds| of(operand, holds, false))
            }
        })
    }

    /// The part of a node whose operands are drafted.
    fn join_operands(&mut self, wanted: Wanted) -> Drafted {
        let Wanted {
            node,
            holds,
            at_start,
        } = wanted;
        let formula = self.formula;
        let operands = self.operands(wanted);
        let drafted = operands.map(|both| both.map(|one| self.drafted(one)));
        let [one, other] = drafted.unwrap_or_default();
        match &formula.nodes()[node] {
            Node::Comparison(comparison) => self.comparison(comparison, holds),
            Node::Not(_) => Ok(one),
            Node::And(..) => Ok(self.join(one, other, holds)),
            Node::Or(..) | Node::Implies(..) => Ok(self.join(one, other, !holds)),
            Node::Over {
                is_past,
                every,
                window,
                ..
            } => {
                let until = self.drafts[one].until;
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
        let task = Task::Comparison {
            relation: if holds { *relation } else { relation.negated() },
            left: self.program(left)?,
            right: self.program(right)?,
        };
        let until = self.context.steps - u64::from(ends_early);
        Ok(self.push(task, 0, until))
    }

    fn program(&self, side: &Side) -> Result<Program, ExpressionError> {
        let program = side.expression.compile_signal(self.context.columns);
        program.map_err(|error| self.formula.inside(error, side.start))
    }

    /// `and`, or else `or`.
    fn join(&mut self, a: usize, b: usize, and: bool) -> usize {
        let delay = larger(self.drafts[a].delay, self.drafts[b].delay);
        let (a, b) = (self.delayed(a, delay), self.delayed(b, delay));
        let until = smaller(self.drafts[a].until, self.drafts[b].until);
        let task = if and { Task::And(a, b) } else { Task::Or(a, b) };
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
        let kind = if every { Kind::Every } else { Kind::Any };
        let delay = larger(self.drafts[operand].delay, end.min(0).unsigned_abs());
        let until = self.drafts[operand].until;
        let operand = self.delayed(operand, delay);
        self.window(kind(operand), (begin, end), delay, until, span)
    }

    /// `until` and `since` over a window that does not begin at the step itself need what holds to
    /// hold over the gap.
    fn chain(
        &mut self,
        is_past: bool,
        window: &formula::Window,
        hold: usize,
        reach: usize,
        holds: bool,
        at_start: bool,
    ) -> Drafted {
        let until = smaller(self.drafts[hold].until, self.drafts[reach].until);
        let (begin, end) = self.offsets(window, is_past, at_start, until)?;
        let gap = match (is_past, begin, end) {
            (false, 1.., _) => Some((0, begin - 1)),
            (true, _, ..=-1) => Some((end + 1, 0)),
            _ => None,
        };
        let longest = larger(self.drafts[hold].delay, self.drafts[reach].delay);
        let delay = larger(longest, end.min(0).unsigned_abs());
        let of = Chained {
            hold: self.delayed(hold, delay),
            reach: self.delayed(reach, delay),
        };
        let kind = Kind::Chain {
            is_past,
            falls: !holds,
            of,
        };
        let chain = self.window(kind, (begin, end), delay, until, &window.span)?;
        let Some((begin, end)) = gap else {
            return Ok(chain);
        };
        let gap = self.over(holds, hold, begin, end, &window.span)?;
        Ok(self.join(gap, chain, holds))
    }

    fn window(
        &mut self,
        kind: Kind,
        (begin, end): (i64, i64),
        delay: u64,
        operand_until: u64,
        span: &Range<usize>,
    ) -> Drafted {
        let Some(until) = operand_until.checked_add_signed(-end) else {
            return Err(self.beyond_the_run(operand_until, span));
        };
        let task = Task::Window {
            kind,
            begin,
            end,
            delay,
        };
        let until = smaller(until, self.context.steps);
        Ok(self.push(task, delay.saturating_add_signed(end), until))
    }

    fn beyond_the_run(&self, until: u64, span: &Range<usize>) -> ExpressionError {
        let FormulaContext { rate, steps, .. } = self.context;
        let last_s = number(rate.seconds(Step(until)));
        let why = if until == *steps {
            format!("the run ends at {last_s} s")
        } else if until + 1 == *steps {
            format!("there is a command for the last time at {last_s} s, a step before the end")
        } else {
            format!("what is inside looks ahead itself and can be judged until {last_s} s only")
        };
        let message = format!(
            "the window reaches too far: {why}; shorten it, or leave out the bounds of an outermost operator to go as far as the run does"
        );
        self.formula.error(span.clone(), message)
    }

    /// The same part, known so many rows after each step.
    fn delayed(&mut self, operand: usize, delay: u64) -> usize {
        let Draft {
            delay: own, until, ..
        } = self.drafts[operand];
        if own == delay {
            return operand;
        }
        let task = Task::Delay {
            operand,
            by: delay - own,
        };
        self.push(task, delay, until)
    }

    fn push(&mut self, task: Task, delay: u64, until: u64) -> usize {
        self.drafts.push(Draft {
            task,
            delay,
            until,
            wanted: None,
        });
        self.drafts.len() - 1
    }

    /// Begin and end of a window from the step that is judged, in steps.
    fn offsets(
        &self,
        window: &formula::Window,
        is_past: bool,
        at_start: bool,
        until: u64,
    ) -> Result<(i64, i64), ExpressionError> {
        let span = &window.span;
        let Some((begin_s, end_s)) = window.bounds_s else {
            if is_past {
                return Ok((-(self.context.steps as i64), 0));
            }
            if at_start {
                return Ok((0, until as i64));
            }
            let message = "without bounds it goes as far as the run does, which only an outermost operator can; give it bounds, such as [0s,1s]";
            return Err(self.formula.error(span.clone(), message));
        };
        let rate = self.context.rate;
        let first = rate.step_at_or_after(begin_s);
        let Some(last) = last_step(rate, end_s).filter(|last| *last >= first) else {
            let period_s = number(rate.period_s());
            let message = format!("no step lies in this window; steps are {period_s} s apart");
            return Err(self.formula.error(span.clone(), message));
        };
        // Longer than any run: kept from overflowing, and refused where it matters.
        let steps = |step: Step| smaller(step.0, 1 << 41) as i64;
        let (first, last) = (steps(first), steps(last));
        if is_past {
            Ok((-last, -first))
        } else {
            Ok((first, last))
        }
    }

    /// Finds which steps of each part are wanted, from step 0 of the whole down.
    fn want(&mut self, whole: usize) {
        self.drafts[whole].wanted = Some((0, 0));
        for at in (0..=whole).rev() {
            let Some(wanted) = self.drafts[at].wanted else {
                continue;
            };
            match self.drafts[at].task {
                Task::Comparison { .. } => {}
                Task::And(a, b) | Task::Or(a, b) => {
                    self.drafts[a].want(wanted);
                    self.drafts[b].want(wanted);
                }
                Task::Delay { operand, .. } => self.drafts[operand].want(wanted),
                Task::Window {
                    kind, begin, end, ..
                } => {
                    let Some(wanted) = taken(wanted, begin, end) else {
                        continue;
                    };
                    for operand in kind.operands() {
                        self.drafts[operand].want(wanted);
                    }
                }
            }
        }
    }

    fn refuse_too_many(&self) -> Result<(), ExpressionError> {
        let kept: u64 = self.drafts.iter().map(Draft::kept).sum();
        if kept <= MOST_KEPT {
            return Ok(());
        }
        let message = format!(
            "it would keep {kept} numbers at a time, more than {MOST_KEPT}: shorten the windows inside other operators"
        );
        let whole = 0..self.formula.to_string().len();
        Err(self.formula.error(whole, message))
    }
}

/// The steps of its operands that a window takes for these of its own.
fn taken((first, last): (u64, u64), begin: i64, end: i64) -> Option<(u64, u64)> {
    Some((
        first.saturating_add_signed(begin),
        last.checked_add_signed(end)?,
    ))
}

/// The last step that is not after a time.
fn last_step(rate: Rate, at_s: f64) -> Option<Step> {
    let after = rate.step_at_or_after(at_s);
    if rate.seconds(after) > at_s {
        after.0.checked_sub(1).map(Step)
    } else {
        Some(after)
    }
}

const fn larger(a: u64, b: u64) -> u64 {
    if a > b { a } else { b }
}

const fn smaller(a: u64, b: u64) -> u64 {
    if a < b { a } else { b }
}

impl Kind {
    fn operands(self) -> impl Iterator<Item = usize> {
        let (one, other) = match self {
            Self::Every(operand) | Self::Any(operand) => (operand, None),
            Self::Chain { of, .. } => (of.hold, Some(of.reach)),
        };
        [one].into_iter().chain(other)
    }
}

impl Draft {
    fn want(&mut self, (first, last): (u64, u64)) {
        self.wanted = Some(match self.wanted {
            Some((least, most)) => (smaller(least, first), larger(most, last)),
            None => (first, last),
        });
    }

    /// Returns the number of steps in the part's window if steps ever leave the window.
    fn slides(&self) -> Option<u64> {
        let Task::Window { begin, end, .. } = self.task else {
            return None;
        };
        let (first, last) = self.wanted?;
        let oldest = first.saturating_add_signed(begin);
        let slides = last.saturating_add_signed(begin) > oldest;
        slides.then(|| (end - begin).unsigned_abs() + 1)
    }

    /// Returns the number of margins that the part keeps.
    fn kept(&self) -> u64 {
        match (&self.task, self.wanted) {
            (Task::Delay { by, .. }, Some((first, last))) => smaller(by + 1, last - first + 1),
            (Task::Window { kind, .. }, _) => {
                // Two stacks, of one or two margins for each step.
                let each = 2 * kind.operands().count() as u64;
                self.slides().unwrap_or(0).saturating_mul(each)
            }
            _ => 0,
        }
    }

    fn part(self) -> Part {
        let kept = self.kept();
        let slides = self.slides();
        // What is not wanted has no step: its last is before its first.
        let (first, last) = self.wanted.unwrap_or((u64::MAX, 0));
        let mut from_row = first.saturating_add(self.delay);
        let work = match self.task {
            Task::Comparison {
                relation,
                left,
                right,
            } => Work::Comparison {
                relation,
                left,
                right,
            },
            Task::And(a, b) => Work::And(a, b),
            Task::Or(a, b) => Work::Or(a, b),
            Task::Delay { operand, by } => {
                from_row = from_row.saturating_sub(by);
                Work::Delay(Delay {
                    operand,
                    by,
                    kept: vec![Margin::BOTTOM; kept as usize],
                })
            }
            Task::Window {
                kind,
                begin,
                end,
                delay,
            } => {
                let taken = self.wanted.and_then(|wanted| taken(wanted, begin, end));
                let (oldest, newest) = taken.unwrap_or((u64::MAX, 0));
                from_row = smaller(from_row, oldest.saturating_add(delay));
                let frame = Frame {
                    delay,
                    first: oldest,
                    last: newest,
                    begin,
                    slides,
                };
                match kind {
                    Kind::Every(operand) => Work::Every(operand, frame.window::<Least>()),
                    Kind::Any(operand) => Work::Any(operand, frame.window::<Greatest>()),
                    Kind::Chain { is_past, falls, of } => match (is_past, falls) {
                        (false, false) => Work::Until(of, frame.window::<Until<false>>()),
                        (false, true) => Work::NotUntil(of, frame.window::<Until<true>>()),
                        (true, false) => Work::Since(of, frame.window::<Since<false>>()),
                        (true, true) => Work::NotSince(of, frame.window::<Since<true>>()),
                    },
                }
            }
        };
        Part {
            work,
            first,
            last,
            delay: self.delay,
            from_row,
        }
    }
}

/// A window before its steps.
struct Frame {
    delay: u64,
    first: u64,
    last: u64,
    begin: i64,
    slides: Option<u64>,
}

impl Frame {
    fn window<S: Stretch>(&self) -> Window<S> {
        Window {
            delay: self.delay,
            first: self.first,
            last: self.last,
            begin: self.begin,
            steps: match self.slides {
                Some(steps) => Steps::sliding(self.first, steps as usize),
                None => Steps::Growing(S::NONE),
            },
        }
    }
}
