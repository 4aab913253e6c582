//! The windows of temporal operators: what their steps come to, in constant time for each step.
//!
//! Of `always` and its like a window keeps the steps that can still become its least margin. Of `until`
//! and `since` steps in a row are a [`Stretch`], and two stretches in a row are one again: a window that
//! only grows is one stretch, one that slides is a queue of two stacks (Tangwongsan, Hirzel and
//! Schneider 2015, section 2), in which each step is pushed once, turned over once and taken away once.

use std::collections::VecDeque;

use super::margin::{self, Choice, Margin, larger};

/// A window that slides, of `always`, `eventually`, `historically` or `once`.
#[derive(Clone, Debug)]
pub(super) struct Extreme {
    pub choice: Choice,
    pub taking: Taking,
    /// The steps that no later one is as good as, each with the row at which it was taken, in both their
    /// orders. Never more than the capacity that the window was made with.
    pub candidates: VecDeque<(u64, Margin)>,
}

/// Rows at which the steps of a window are taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taking {
    /// The first row at which a step of the operands is taken.
    pub from: u64,
    /// Number of rows for which a step stays in the window after the row at which it was taken.
    pub stays: u64,
}

impl Extreme {
    /// Takes the operand's step of this row, if it is one of the window's, and gives what the window
    /// comes to.
    #[inline]
    pub(super) fn observe(&mut self, row: u64, operand: Margin) -> Margin {
        let Self {
            choice,
            taking,
            candidates,
        } = self;
        // Rows follow each other, so no more than one leaves.
        if candidates
            .front()
            .is_some_and(|(taken, _)| taken + taking.stays < row)
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

/// Result of some steps in a row.
pub(super) trait Stretch: Copy {
    /// Of no step.
    const NONE: Self;

    /// Of one step, at which `f` and `g` have these margins.
    fn new(hold: Margin, reach: Margin) -> Self;

    /// This stretch and the one after it.
    fn then(self, later: Self) -> Self;

    /// Returns the operator's margin of the stretch.
    fn margin(self) -> Margin;

    /// Returns true if the operator holds whatever comes after, false if it fails whatever comes.
    fn certain(self) -> Option<bool>;

    /// Between which two sizes the operator's margin will be, whatever comes after.
    fn bounds(self) -> [f64; 2];
}

/// `f until g` from the first step of the stretch on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Until {
    /// The least margin of `f`.
    hold: Margin,
    /// The greatest, over all steps, of the margin of `g` there and of `f` before.
    reach: Margin,
}

/// `f since g` at the last step of the stretch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Since {
    /// The least margin of `f`.
    hold: Margin,
    /// The greatest, over all steps, of the margin of `g` there and of `f` after.
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
        // Reached; or not, and what must hold until then has failed.
        if self.reach.holds() {
            Some(true)
        } else {
            (!self.hold.holds()).then_some(false)
        }
    }

    fn bounds(self) -> [f64; 2] {
        // What comes reaches no further than what must hold until then.
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

/// The window of `until` or `since`.
#[derive(Clone, Debug)]
pub(super) struct Chain<S> {
    /// The greatest of the opposites, in which least and greatest change places.
    pub choice: Choice,
    pub taking: Taking,
    pub steps: Steps<S>,
}

/// The steps of a window.
#[derive(Clone, Debug)]
pub(super) enum Steps<S> {
    /// Window that only grows.
    Growing(S),
    /// Window that slides.
    Sliding(Sliding<S>),
}

/// A window that slides. Its contents never exceed the capacity that the window was made with.
#[derive(Clone, Debug)]
pub(super) struct Sliding<S> {
    /// The row at which the oldest step in it was taken.
    oldest: u64,
    /// For each of the older steps what it and all after it in this stack come to, the oldest on top.
    front: Vec<S>,
    /// The newer steps, the newest on top, and what they come to.
    back: Vec<S>,
    back_total: S,
}

impl<S: Stretch> Chain<S> {
    /// A window before its first step, of which at most `slides` stay if steps ever leave it.
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

    /// Takes the operands' step of this row, if it is one of the window's, and gives what the window
    /// comes to.
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

    /// Bytes that it keeps.
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
    /// Forgets the steps taken before a row, takes the next, if any, and gives the stretch of all.
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
