//! Parts before they work: tasks, and the steps of each that are wanted.
//!
//! Made by [`build`](super::build) for all formulas together; becomes the [`Part`]s and [`Span`]s of
//! [`Monitors`](super::Monitors). Comparisons that formulas share become one part.

use std::collections::{HashMap, VecDeque};

use super::due::Span;
use super::margin::{Choice, Margin};
use super::part::{Chained, Comparison, Delay, Growing, Join, Part, PartWork};
use super::window::{Chain, Extreme, Taking};

/// A part to be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draft {
    pub task: Task,
    pub delay: u64,
    /// The last step at which it can be judged.
    pub until: u64,
    /// First and last step at which it is wanted.
    pub wanted: Option<(u64, u64)>,
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
        /// The least of what the formula says, the greatest of its opposite, or for
        /// [`WindowKind::Extreme`] what is chosen.
        choice: Choice,
        /// Begin and end from the step that is judged.
        begin: i64,
        end: i64,
        /// Number of rows by which a step of the operands is taken later than its own row.
        delay: u64,
    },
}

/// Kind of window: what the window does with its operands.
#[derive(Clone, Copy, Debug)]
pub(super) enum WindowKind {
    /// `always` and `historically` choose the least margin, `eventually` and `once` the greatest.
    Extreme(usize),
    Until(Chained),
    Since(Chained),
}

/// Finds which steps are wanted of the parts of one formula, which begin at a place and end with the whole.
pub(super) fn want(drafts: &mut [Draft], begin: usize) {
    let whole = drafts.len() - 1;
    drafts[whole].want((0, 0));
    for at in (begin..=whole).rev() {
        let Some(wanted) = drafts[at].wanted else {
            continue;
        };
        let wanted = match drafts[at].task {
            Task::Window { begin, end, .. } => taken(wanted, begin, end),
            _ => Some(wanted),
        };
        for operand in drafts[at].operands().into_iter().flatten() {
            if let Some(wanted) = wanted {
                drafts[operand].want(wanted);
            }
        }
    }
}

/// Makes the parts of all formulas, the rows at which each part looks, and the part of each draft.
pub(super) fn parts(drafts: &[Draft]) -> (Vec<Part>, Vec<Span>, Vec<usize>) {
    let (mut parts, mut spans, mut places) = (Vec::new(), Vec::new(), Vec::new());
    let mut shared = HashMap::new();
    // Three are one stage: joins, windows that grow, and all others.
    let mut stages: Vec<usize> = Vec::new();
    for draft in drafts {
        let next = parts.len();
        let place = match draft.task {
            // The margin of a single step is kept for the verdict, and so by one formula alone.
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

/// The steps of its operands that a window takes for these of its own.
fn taken((first, last): (u64, u64), begin: i64, end: i64) -> Option<(u64, u64)> {
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
        self.wanted = Some(match self.wanted {
            Some((least, most)) => (least.min(first), most.max(last)),
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
    pub(super) fn kept(&self) -> u64 {
        match (self.task, self.wanted) {
            (Task::Delay { by, .. }, Some((first, last))) => by.min(last - first + 1),
            (Task::Window { .. }, _) => {
                // Two for each step of each operand: two stacks, or one queue with rows.
                let each = 2 * self.operands().into_iter().flatten().count() as u64;
                self.slides().unwrap_or(0).saturating_mul(each)
            }
            _ => 0,
        }
    }

    /// Returns true if one of its margins is wanted.
    fn is_single(&self) -> bool {
        self.wanted.is_some_and(|(first, last)| first == last)
    }

    /// First and last row that it looks at, if any.
    fn rows(&self) -> Option<(u64, u64)> {
        let (first, last) = self.wanted?;
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

    /// Rows at which a window takes its steps; none if it is no window.
    fn taking(&self) -> Option<Taking> {
        let Task::Window {
            begin, end, delay, ..
        } = self.task
        else {
            return None;
        };
        let taken = self.wanted.and_then(|wanted| taken(wanted, begin, end));
        Some(Taking {
            from: taken.map_or(u64::MAX, |(oldest, _)| oldest + delay),
            stays: (end - begin).unsigned_abs(),
        })
    }

    /// Makes the part; `places` has that of each draft before.
    fn part(&self, places: &[usize]) -> Part {
        let (first, last) = self.wanted.unwrap_or_default();
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
                kept: vec![Margin::BOTTOM; self.kept() as usize],
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
