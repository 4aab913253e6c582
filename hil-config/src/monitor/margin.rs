//! By how much something holds or fails, and which step says so.

/// Bounds of a size that may be any.
pub(super) const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// The smaller of two sizes, which are never NaN.
pub(super) const fn smaller(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// The larger of two sizes, which are never NaN.
pub(super) const fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// A robustness with the step whose comparison it comes from. Never NaN: what does not exist fails
/// by minus infinity. The sign bit is the verdict, so -0 fails and +0 holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Margin {
    pub size: f64,
    pub step: u64,
}

impl Margin {
    /// Above every other: `always` over nothing.
    pub(super) const TOP: Self = Self {
        size: f64::INFINITY,
        step: u64::MAX,
    };
    /// Below every other: `eventually` over nothing.
    pub(super) const BOTTOM: Self = Self {
        size: f64::NEG_INFINITY,
        step: 0,
    };

    #[inline]
    pub(super) const fn holds(self) -> bool {
        self.size.is_sign_positive()
    }

    /// Returns true if the margin is below another. Of equal sizes the earlier step is below: one
    /// order of all margins makes least and greatest distributive, so that any way to compute a
    /// formula finds the same step.
    #[inline]
    fn is_below(self, other: Self) -> bool {
        if self.size < other.size {
            return true;
        }
        if self.size > other.size {
            return false;
        }
        match (self.holds(), other.holds()) {
            (false, true) => true,
            (true, false) => false,
            _ => self.step < other.step,
        }
    }

    #[inline]
    pub(super) fn least(self, other: Self) -> Self {
        if other.is_below(self) { other } else { self }
    }

    #[inline]
    pub(super) fn greatest(self, other: Self) -> Self {
        if self.is_below(other) { other } else { self }
    }
}
