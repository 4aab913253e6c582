//! Drafts of parts: tasks, and the needed steps of each.
//!
//! Created by [`build`](super::build) for all formulas together; turned into the [`Part`]s and [`Span`]s of
//! [`Monitors`](super::Monitors). Comparisons that formulas share become one part.

use std::collections::{HashMap, VecDeque};

use super::due::Span;
use super::margin::{Choice, Margin};
use super::part::{Chained, Comparison, Delay, Growing, Join, Part, PartWork};
use super::window::{Chain, Extreme, Taking};

/// Draft of a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draft {
    pub task: Task,
    pub delay: u64,
    /// Last step at which the part can be evaluated.
    pub until: u64,
    /// First and last needed step.
    pub needed_steps: Option<(u64, u64)>,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Task {
    Comparison(Comparison),
    Join(Choice, usize, usize),
    Delay {
        operand: usize,
        by: u64,
    },
    Window {
        kind: WindowKind,
        /// Minimum for the formula itself, maximum for its negation; for [`WindowKind::Extreme`] the extremum to take.
        choice: Choice,
        /// Beginning and end relative to the evaluated step.
        begin: i64,
        end: i64,
        /// Number of rows by which a step of the operands is delayed.
        delay: u64,
    },
}

/// Kind of window, that is, the operation on its operands.
#[derive(Clone, Copy, Debug)]
pub(super) enum WindowKind {
    /// `always` and `historically` take the minimum margin, `eventually` and `once` the maximum.
    Extreme(usize),
    Until(Chained),
    Since(Chained),
}

/// Computes, for each part of one formula, the steps whose margin is needed; `begin` is the first part, the last is the
/// whole, whose margin is needed at `steps`.
pub(super) fn want(drafts: &mut [Draft], begin: usize, steps: (u64, u64)) {
    let whole = drafts.len() - 1;
    drafts[whole].want(steps);
    for at in (begin..=whole).rev() {
        let Some(span) = drafts[at].needed_steps else {
            continue;
        };
        let span = match drafts[at].task {
            Task::Window { begin, end, .. } => window_of(span, begin, end),
            _ => Some(span),
        };
        for operand in drafts[at].operands().into_iter().flatten() {
            if let Some(span) = span {
                drafts[operand].want(span);
            }
        }
    }
}

/// Builds the parts of all formulas, the active rows of each part, and the part of each draft.
pub(super) fn parts(drafts: &[Draft]) -> (Vec<Part>, Vec<Span>, Vec<usize>) {
    let (mut parts, mut spans, mut places) = (Vec::new(), Vec::new(), Vec::new());
    let mut shared = HashMap::new();
    // Each stage has three groups: joins, growing windows, and all others.
    let mut stages: Vec<usize> = Vec::new();
    for draft in drafts {
        let next = parts.len();
        let place = match draft.task {
            // The margin of a single step is kept for the verdict, and so cannot be shared between formulas.
            Task::Comparison(comparison) if !draft.is_single() => {
                *shared.entry(comparison).or_insert(next)
            }
            _ => next,
        };
        places.push(place);
        if place == next {
            let part = draft.part(&places);
            let operands = draft.operands().into_iter().flatten();
            let after = operands.map(|operand| stages[places[operand]]).max();
            let after = after.unwrap_or(0);
            let within = match part.work {
                PartWork::Comparison(_) | PartWork::Join(_) => 0,
                PartWork::Growing(_) => 1,
                _ => 2,
            };
            stages.push(after + (within + 3 - after % 3) % 3);
            parts.push(part);
        }
        spans.extend(draft.rows().map(|(from, until)| Span {
            stage: stages[place] / 3,
            part: place,
            from,
            until,
        }));
    }
    spans.sort_unstable();
    spans.dedup();
    (parts, spans, places)
}

/// Returns the operand steps from which a window computes these steps of its own.
fn window_of((first, last): (u64, u64), begin: i64, end: i64) -> Option<(u64, u64)> {
    Some((
        first.saturating_add_signed(begin),
        last.checked_add_signed(end)?,
    ))
}

impl Draft {
    const fn operands(&self) -> [Option<usize>; 2] {
        match self.task {
            Task::Comparison(_) => [None; 2],
            Task::Join(_, a, b) => [Some(a), Some(b)],
            Task::Delay { operand, .. } => [Some(operand), None],
            Task::Window { kind, .. } => match kind {
                WindowKind::Extreme(operand) => [Some(operand), None],
                WindowKind::Until(of) | WindowKind::Since(of) => [Some(of.hold), Some(of.reach)],
            },
        }
    }

    fn want(&mut self, (first, last): (u64, u64)) {
        self.needed_steps = Some(match self.needed_steps {
            Some((least, most)) => (least.min(first), most.max(last)),
            None => (first, last),
        });
    }

    /// Returns the number of steps in the part's window, if steps ever leave the window.
    fn slides(&self) -> Option<u64> {
        let Task::Window { begin, end, .. } = self.task else {
            return None;
        };
        let (first, last) = self.needed_steps?;
        let oldest = first.saturating_add_signed(begin);
        let slides = last.saturating_add_signed(begin) > oldest;
        slides.then(|| (end - begin).unsigned_abs() + 1)
    }

    /// Returns the number of margins that the part keeps.
    pub(super) fn margins(&self) -> u64 {
        match (self.task, self.needed_steps) {
            (Task::Delay { by, .. }, Some((first, last))) => by.min(last - first + 1),
            (Task::Window { .. }, _) => {
                // Two per step of each operand: two stacks, or one queue with rows.
                let each = 2 * self.operands().into_iter().flatten().count() as u64;
                self.slides().unwrap_or(0).saturating_mul(each)
            }
            _ => 0,
        }
    }

    /// Returns `true` if only one margin of the part is needed.
    fn is_single(&self) -> bool {
        self.needed_steps.is_some_and(|(first, last)| first == last)
    }

    /// Returns the first and last row at which the part is active, if any.
    fn rows(&self) -> Option<(u64, u64)> {
        let (first, last) = self.needed_steps?;
        let gives_from = first + self.delay;
        let from = match (self.task, self.taking()) {
            (Task::Delay { by, .. }, _) => gives_from - by,
            (
                Task::Window {
                    kind: WindowKind::Extreme(_),
                    ..
                },
                Some(taking),
            ) if self.slides().is_none() => taking.from,
            (Task::Window { .. }, Some(taking)) => gives_from.min(taking.from),
            _ => gives_from,
        };
        Some((from, last + self.delay))
    }

    /// Returns the rows at which a window takes its steps; `None` for a part that is not a window.
    fn taking(&self) -> Option<Taking> {
        let Task::Window {
            begin, end, delay, ..
        } = self.task
        else {
            return None;
        };
        let span = self
            .needed_steps
            .and_then(|steps| window_of(steps, begin, end));
        Some(Taking {
            from: span.map_or(u64::MAX, |(oldest, _)| oldest + delay),
            stays: (end - begin).unsigned_abs(),
        })
    }

    /// Builds the part; `places` maps earlier drafts to parts.
    fn part(&self, places: &[usize]) -> Part {
        let (first, last) = self.needed_steps.unwrap_or_default();
        let slides = self.slides();
        let work = match (self.task, self.taking()) {
            (Task::Comparison(comparison), _) => PartWork::Comparison(comparison),
            (Task::Join(choice, a, b), _) => PartWork::Join(Join {
                choice,
                a: places[a],
                b: places[b],
            }),
            (Task::Delay { operand, by }, _) => PartWork::Delay(Delay {
                operand: places[operand],
                takes_until: last + self.delay - by,
                gives_from: first + self.delay,
                margins: vec![Margin::BOTTOM; self.margins() as usize],
                next_in: 0,
                next_out: 0,
            }),
            (Task::Window { kind, choice, .. }, taking) => {
                let taking = taking.expect("a window takes");
                let placed = |of: Chained| Chained {
                    hold: places[of.hold],
                    reach: places[of.reach],
                };
                match (kind, slides) {
                    (WindowKind::Extreme(operand), None) => PartWork::Growing(Growing {
                        choice,
                        operand: places[operand],
                    }),
                    (WindowKind::Extreme(operand), Some(steps)) => PartWork::Extreme(
                        places[operand],
                        Extreme {
                            choice,
                            taking,
                            candidates: VecDeque::with_capacity(steps as usize),
                        },
                    ),
                    (WindowKind::Until(of), _) => {
                        PartWork::Until(placed(of), Chain::new(choice, taking, slides))
                    }
                    (WindowKind::Since(of), _) => {
                        PartWork::Since(placed(of), Chain::new(choice, taking, slides))
                    }
                }
            }
        };
        Part {
            work,
            is_single: self.is_single(),
            done_at: last + self.delay,
        }
    }
}
