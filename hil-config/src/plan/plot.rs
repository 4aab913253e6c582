//! What is worth looking at.

/// A plot over simulated time. Nothing of a run depends on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Signals as expressions name them, at least one.
    pub signals: Vec<String>,
    /// The laws that it is for; empty: all. Only with these its signals are known to be there.
    pub laws: Vec<String>,
    /// Vertical axis.
    pub scale: Scale,
    /// Values of level lines, in the unit of the signals.
    pub lines: Vec<f64>,
}

/// Scale of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// As it is.
    #[default]
    Linear,
    /// Logarithms of magnitudes.
    Log,
}

impl Scale {
    /// As it is written in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Log => "log",
        }
    }
}

impl Plot {
    /// Returns true if the plot is for a law.
    #[must_use]
    pub fn is_for(&self, law: &str) -> bool {
        self.laws.is_empty() || self.laws.iter().any(|one| one == law)
    }
}
