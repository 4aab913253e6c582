//! The window of a temporal operator: what its steps come to, in constant time for each step.
//!
//! Steps in a row are a [`Stretch`], and two stretches in a row are one again. A window that only
//! grows is one stretch; one that slides is a queue of two stacks (Tangwongsan, Hirzel and Schneider
//! 2015, section 2): each step is pushed once, turned over once and taken away once.

use super::margin::{self, Margin, larger, smaller};

/// Result of some steps in a row.
pub(super) trait Stretch: Copy {
    /// Of no step.
    const NONE: Self;

    /// This stretch and the one after it.
    fn then(self, later: Self) -> Self;

    /// Returns the operator's margin of the stretch.
    fn margin(self) -> Margin;

    /// Returns true if the operator holds whatever comes after, false if it fails whatever comes.
    fn certain(self) -> Option<bool>;

    /// Between which two sizes the operator's margin will be, whatever comes after.
    fn bounds(self) -> [f64; 2];
}

/// `always` and `historically`: the least margin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Least(pub Margin);

/// `eventually` and `once`: the greatest margin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Greatest(pub Margin);

/// `f until g` from the first step of the stretch on, or with `FALLS` its opposite, in which least
/// and greatest change places.
#[derive(Clone, Copy, Debug)]
pub(super) struct Until<const FALLS: bool> {
    /// The least margin of `f`.
    pub hold: Margin,
    /// The greatest, over all steps, of the margin of `g` there and of `f` before.
    pub reach: Margin,
}

/// `f since g` at the last step of the stretch, or its opposite.
#[derive(Clone, Copy, Debug)]
pub(super) struct Since<const FALLS: bool> {
    /// The least margin of `f`.
    pub hold: Margin,
    /// The greatest, over all steps, of the margin of `g` there and of `f` after.
    pub reach: Margin,
}

impl Stretch for Least {
    const NONE: Self = Self(Margin::TOP);

    #[inline]
    fn then(self, later: Self) -> Self {
        Self(self.0.least(later.0))
    }

    fn margin(self) -> Margin {
        self.0
    }

    #[inline]
    fn certain(self) -> Option<bool> {
        (!self.0.holds()).then_some(false)
    }

    fn bounds(self) -> [f64; 2] {
        [f64::NEG_INFINITY, self.0.size]
    }
}

impl Stretch for Greatest {
    const NONE: Self = Self(Margin::BOTTOM);

    #[inline]
    fn then(self, later: Self) -> Self {
        Self(self.0.greatest(later.0))
    }

    fn margin(self) -> Margin {
        self.0
    }

    #[inline]
    fn certain(self) -> Option<bool> {
        self.0.holds().then_some(true)
    }

    fn bounds(self) -> [f64; 2] {
        [self.0.size, f64::INFINITY]
    }
}

/// The least, or with `FALLS` the greatest.
#[inline]
fn both<const FALLS: bool>(a: Margin, b: Margin) -> Margin {
    if FALLS { a.greatest(b) } else { a.least(b) }
}

/// The margin of holding everywhere over no step; that of reaching is the other one.
const fn everywhere<const FALLS: bool>() -> Margin {
    if FALLS { Margin::BOTTOM } else { Margin::TOP }
}

const fn nowhere<const FALLS: bool>() -> Margin {
    if FALLS { Margin::TOP } else { Margin::BOTTOM }
}

impl<const FALLS: bool> Stretch for Until<FALLS> {
    const NONE: Self = Self {
        hold: everywhere::<FALLS>(),
        reach: nowhere::<FALLS>(),
    };

    fn then(self, later: Self) -> Self {
        let later_reach = both::<FALLS>(self.hold, later.reach);
        Self {
            hold: both::<FALLS>(self.hold, later.hold),
            reach: if FALLS {
                self.reach.least(later_reach)
            } else {
                self.reach.greatest(later_reach)
            },
        }
    }

    fn margin(self) -> Margin {
        self.reach
    }

    fn certain(self) -> Option<bool> {
        // Reached; or not, and what must hold until then has failed.
        if self.reach.holds() != FALLS {
            Some(!FALLS)
        } else if self.hold.holds() == FALLS {
            Some(FALLS)
        } else {
            None
        }
    }

    fn bounds(self) -> [f64; 2] {
        // What comes reaches no further than what must hold until then.
        let (reach, hold) = (self.reach.size, self.hold.size);
        if FALLS {
            [smaller(reach, hold), reach]
        } else {
            [reach, larger(reach, hold)]
        }
    }
}

impl<const FALLS: bool> Stretch for Since<FALLS> {
    const NONE: Self = Self {
        hold: everywhere::<FALLS>(),
        reach: nowhere::<FALLS>(),
    };

    fn then(self, later: Self) -> Self {
        let earlier_reach = both::<FALLS>(self.reach, later.hold);
        Self {
            hold: both::<FALLS>(self.hold, later.hold),
            reach: if FALLS {
                earlier_reach.least(later.reach)
            } else {
                earlier_reach.greatest(later.reach)
            },
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
    /// The oldest step in it.
    oldest: u64,
    /// For each of the older steps what it and all after it in this stack come to, the oldest on top.
    front: Vec<S>,
    /// The newer steps, the newest on top, and what they come to.
    back: Vec<S>,
    back_total: S,
}

impl<S: Stretch> Steps<S> {
    /// A window that slides from `first` on and holds at most `capacity` steps.
    pub(super) fn sliding(first: u64, capacity: usize) -> Self {
        Self::Sliding(Sliding {
            oldest: first,
            front: Vec::with_capacity(capacity),
            back: Vec::with_capacity(capacity),
            back_total: S::NONE,
        })
    }

    /// Bytes that it keeps.
    pub(super) fn kept_bytes(&self) -> usize {
        match self {
            Self::Growing(_) => 0,
            Self::Sliding(Sliding { front, back, .. }) => {
                (front.capacity() + back.capacity()) * size_of::<S>()
            }
        }
    }

    /// Takes the next step.
    #[inline]
    pub(super) fn push(&mut self, step: S) {
        match self {
            Self::Growing(total) => *total = total.then(step),
            Self::Sliding(sliding) => {
                sliding.back.push(step);
                sliding.back_total = sliding.back_total.then(step);
            }
        }
    }

    /// Forgets the steps before this one.
    #[inline]
    pub(super) fn begin_at(&mut self, step: u64) {
        if let Self::Sliding(sliding) = self {
            while sliding.oldest < step {
                sliding.drop_oldest();
            }
        }
    }

    /// Returns the stretch of all steps.
    #[inline]
    pub(super) fn total(&self) -> S {
        match self {
            Self::Growing(total) => *total,
            Self::Sliding(sliding) => {
                let front = sliding.front.last().copied().unwrap_or(S::NONE);
                front.then(sliding.back_total)
            }
        }
    }
}

impl<S: Stretch> Sliding<S> {
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
