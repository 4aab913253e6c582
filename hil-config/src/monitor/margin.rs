//! Margin by which a formula holds or fails, and the decisive step.

/// Bounds of an unknown size.
pub(super) const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Robustness combined with the step of its comparison in one number, ordered by value, -0 below +0, then by step.
/// Under this total order minimum and maximum are distributive, so every way to compute a formula yields the same step.
/// The upper half is the value in the order of [`f64::total_cmp`], and the lower half is the step. A size is never NaN:
/// a missing value fails by minus infinity. The sign is the verdict, so -0 fails and +0 holds.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(super) struct Margin(i128);

/// Selection of the minimum or maximum of two margins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    /// All bits set for the maximum: inverting all bits of the margins turns the maximum into the minimum.
    mask: i64,
}

impl Margin {
    /// Above every other margin: `always` over nothing.
    pub(super) const TOP: Self = Self::new(f64::INFINITY, 0, u64::MAX);
    /// Below every other margin: `eventually` over nothing.
    pub(super) const BOTTOM: Self = Self(!Self::TOP.0);

    /// Creates the margin of a size or, if all bits of `turned` are set, of its negation.
    #[inline]
    pub(super) const fn new(size: f64, turned: i64, step: u64) -> Self {
        let bits = size.to_bits() as i64;
        // As in `f64::total_cmp`; with all bits inverted it is the negation's.
        let ordered = bits ^ (((bits >> 63) as u64) >> 1) as i64;
        Self(((ordered ^ turned) as i128) << 64 | step as i128)
    }

    #[inline]
    pub(super) const fn holds(self) -> bool {
        self.0 >= 0
    }

    pub(super) const fn size(self) -> f64 {
        let size = (self.0 >> 64) as i64;
        if size < 0 {
            -f64::from_bits(!size as u64)
        } else {
            f64::from_bits(size as u64)
        }
    }

    /// Returns the step, or `None` for a margin over nothing.
    pub(super) const fn step(self) -> Option<u64> {
        let step = self.0 as u64;
        if step == u64::MAX { None } else { Some(step) }
    }

    #[inline]
    pub(super) fn least(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }

    #[inline]
    pub(super) fn greatest(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }
}

impl Choice {
    pub(super) const LEAST: Self = Self { mask: 0 };
    pub(super) const GREATEST: Self = Self { mask: -1 };

    /// Creates the choice of the formula, or of its negation.
    pub(super) const fn least_if(least: bool) -> Self {
        if least { Self::LEAST } else { Self::GREATEST }
    }

    /// Returns the choice among no margins.
    pub(super) const fn none(self) -> Margin {
        self.turn(Margin::TOP)
    }

    /// Inverts the order of margins if the maximum is chosen, so that the minimum can be taken; a second call restores
    /// the margin.
    #[inline]
    pub(super) const fn turn(self, margin: Margin) -> Margin {
        Margin(margin.0 ^ self.mask as i128)
    }

    /// Returns `true` if the first margin is chosen.
    #[inline]
    pub(super) fn prefers(self, a: Margin, b: Margin) -> bool {
        self.turn(a) < self.turn(b)
    }

    /// Returns `true` if the first margin is not chosen, regardless of the steps.
    #[inline]
    pub(super) const fn is_worse(self, a: Margin, b: Margin) -> bool {
        (a.0 >> 64) as i64 ^ self.mask > (b.0 >> 64) as i64 ^ self.mask
    }

    /// Returns the bounds of a size from those of its inversion.
    pub(super) fn turn_bounds(self, [low, high]: [f64; 2]) -> [f64; 2] {
        if self == Self::LEAST {
            [low, high]
        } else {
            [-high, -low]
        }
    }
}
