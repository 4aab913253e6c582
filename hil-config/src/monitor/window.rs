//! Windows of temporal operators, evaluated in constant time per step.
//!
//! For `always` and similar operators a window keeps the steps that can still become its minimum margin. For `until`
//! and `since` consecutive steps are combined into a [`Stretch`], and two consecutive stretches into one: a growing
//! window is a single stretch, a sliding one is a queue of two stacks (Tangwongsan, Hirzel and Schneider 2015, section
//! 2), in which each step is pushed, moved and popped once.

use shared_types::extremes::larger;
use std::collections::VecDeque;

use super::margin::{self, Choice, Margin};

/// Sliding window of `always`, `eventually`, `historically` or `once`.
#[derive(Clone, Debug)]
pub(super) struct Extreme {
    pub choice: Choice,
    pub taking: Taking,
    /// Steps that no later step dominates, each with the row at which it was taken, ordered both by row and by margin.
    /// Never more than the initial capacity.
    pub candidates: VecDeque<(u64, Margin)>,
}

/// Rows at which the steps of a window are taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taking {
    /// First row at which a step of the operands is taken.
    pub from: u64,
    /// Number of rows for which a step stays in the window after the row at which it was taken.
    pub stays: u64,
}

impl Extreme {
    /// Takes the operand's step of this row, if it belongs to the window, and returns the window's result.
    #[inline]
    pub(super) fn observe(&mut self, row: u64, operand: Margin) -> Margin {
        let Self {
            choice,
            taking,
            candidates,
        } = self;
        // Rows are consecutive, so at most one step leaves.
        if candidates
            .front()
            .is_some_and(|(first, _)| first + taking.stays < row)
        {
            candidates.pop_front();
        }
        if row >= taking.from {
            let newest = choice.turn(operand);
            while candidates.back().is_some_and(|(_, older)| *older >= newest) {
                candidates.pop_back();
            }
            candidates.push_back((row, newest));
        }
        let best = candidates.front().map_or(Margin::TOP, |(_, best)| *best);
        choice.turn(best)
    }
}

/// Combined result of consecutive steps.
pub(super) trait Stretch: Copy {
    /// Result of no steps.
    const NONE: Self;

    /// Creates the result of one step, at which `f` and `g` have these margins.
    fn new(hold: Margin, reach: Margin) -> Self;

    /// Combines this stretch with the following one.
    fn then(self, later: Self) -> Self;

    /// Returns the operator's margin over the stretch.
    fn margin(self) -> Margin;

    /// Returns `true` if the operator holds whatever follows, `false` if it fails whatever follows.
    fn certain(self) -> Option<bool>;

    /// Returns bounds on the operator's margin, whatever follows.
    fn bounds(self) -> [f64; 2];
}

/// `f until g` from the first step of the stretch on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Until {
    /// Minimum margin of `f`.
    hold: Margin,
    /// Maximum, over all steps, of the margin of `g` at the step and of `f` before it.
    reach: Margin,
}

/// `f since g` at the last step of the stretch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Since {
    /// Minimum margin of `f`.
    hold: Margin,
    /// Maximum, over all steps, of the margin of `g` at the step and of `f` after it.
    reach: Margin,
}

impl Stretch for Until {
    const NONE: Self = Self {
        hold: Margin::TOP,
        reach: Margin::BOTTOM,
    };

    fn new(hold: Margin, reach: Margin) -> Self {
        Self { hold, reach }
    }

    fn then(self, later: Self) -> Self {
        Self {
            hold: self.hold.least(later.hold),
            reach: self.reach.greatest(self.hold.least(later.reach)),
        }
    }

    fn margin(self) -> Margin {
        self.reach
    }

    fn certain(self) -> Option<bool> {
        // `g` was reached; or it was not, and `f` has already failed.
        if self.reach.holds() {
            Some(true)
        } else {
            (!self.hold.holds()).then_some(false)
        }
    }

    fn bounds(self) -> [f64; 2] {
        // Later steps cannot exceed the margin of `f` so far.
        let (reach, hold) = (self.reach.size(), self.hold.size());
        [reach, larger(reach, hold)]
    }
}

impl Stretch for Since {
    const NONE: Self = Self {
        hold: Margin::TOP,
        reach: Margin::BOTTOM,
    };

    fn new(hold: Margin, reach: Margin) -> Self {
        Self { hold, reach }
    }

    fn then(self, later: Self) -> Self {
        Self {
            hold: self.hold.least(later.hold),
            reach: self.reach.least(later.hold).greatest(later.reach),
        }
    }

    fn margin(self) -> Margin {
        self.reach
    }

    fn certain(self) -> Option<bool> {
        None
    }

    fn bounds(self) -> [f64; 2] {
        margin::ANY
    }
}

/// Window of `until` or `since`.
#[derive(Clone, Debug)]
pub(super) struct Chain<S> {
    /// Maximum for the negation, in which minimum and maximum swap.
    pub choice: Choice,
    pub taking: Taking,
    pub steps: Steps<S>,
}

/// Steps of a window.
#[derive(Clone, Debug)]
pub(super) enum Steps<S> {
    /// Growing window.
    Growing(S),
    /// Sliding window.
    Sliding(Sliding<S>),
}

/// Sliding window. Its contents never exceed the initial capacity.
#[derive(Clone, Debug)]
pub(super) struct Sliding<S> {
    /// Row at which the window's oldest step was taken.
    oldest: u64,
    /// Combined result of each older step and all later ones in this stack, the oldest on top.
    front: Vec<S>,
    /// Newer steps, the newest on top, and their combined result.
    back: Vec<S>,
    back_total: S,
}

impl<S: Stretch> Chain<S> {
    /// Creates a window before its first step, keeping at most `slides` steps if steps ever leave it.
    pub(super) fn new(choice: Choice, taking: Taking, slides: Option<u64>) -> Self {
        let steps = match slides {
            None => Steps::Growing(S::NONE),
            Some(steps) => Steps::Sliding(Sliding {
                oldest: taking.from,
                front: Vec::with_capacity(steps as usize),
                back: Vec::with_capacity(steps as usize),
                back_total: S::NONE,
            }),
        };
        Self {
            choice,
            taking,
            steps,
        }
    }

    /// Takes the operands' step of this row, if it belongs to the window, and returns the window's result.
    pub(super) fn observe(&mut self, row: u64, hold: Margin, reach: Margin) -> Margin {
        let Self {
            choice,
            taking,
            steps,
        } = self;
        let step = (row >= taking.from).then(|| S::new(choice.turn(hold), choice.turn(reach)));
        let total = match steps {
            Steps::Growing(total) => {
                *total = step.map_or(*total, |step| total.then(step));
                *total
            }
            Steps::Sliding(sliding) => sliding.observe(row.saturating_sub(taking.stays), step),
        };
        choice.turn(total.margin())
    }

    pub(super) fn certain(&self) -> Option<bool> {
        let certain = self.growing()?.certain();
        certain.map(|holds| holds == (self.choice == Choice::LEAST))
    }

    pub(super) fn bounds(&self) -> [f64; 2] {
        let bounds = self.growing().map_or(margin::ANY, Stretch::bounds);
        self.choice.turn_bounds(bounds)
    }

    fn growing(&self) -> Option<S> {
        match &self.steps {
            Steps::Growing(total) => Some(*total),
            Steps::Sliding(_) => None,
        }
    }

    /// Returns the window's heap memory in bytes.
    pub(super) fn kept_bytes(&self) -> usize {
        match &self.steps {
            Steps::Growing(_) => 0,
            Steps::Sliding(Sliding { front, back, .. }) => {
                (front.capacity() + back.capacity()) * size_of::<S>()
            }
        }
    }
}

impl<S: Stretch> Sliding<S> {
    /// Drops the steps taken before a row, adds the next, if any, and returns the combined stretch.
    fn observe(&mut self, from: u64, step: Option<S>) -> S {
        while self.oldest < from {
            self.drop_oldest();
        }
        if let Some(step) = step {
            self.back.push(step);
            self.back_total = self.back_total.then(step);
        }
        let front = self.front.last().copied().unwrap_or(S::NONE);
        front.then(self.back_total)
    }

    fn drop_oldest(&mut self) {
        if self.front.is_empty() {
            let mut total = S::NONE;
            while let Some(step) = self.back.pop() {
                total = step.then(total);
                self.front.push(total);
            }
            self.back_total = S::NONE;
        }
        self.front.pop();
        self.oldest += 1;
    }
}
