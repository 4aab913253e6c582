//! Plots: signals worth looking at.

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

/// Contents of a panel beside the plots. Nothing of a run depends on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Width of the time axis in s.
    pub window_s: f64,
    /// Names and patterns of signals; empty: the first of the plots.
    pub readings: Vec<String>,
    /// Names and patterns of keys that can be changed; empty: all.
    pub tune: Vec<String>,
    /// Faults, in the words of `hil inject`.
    pub inject: Vec<String>,
}

impl Default for Panel {
    fn default() -> Self {
        Self {
            window_s: 5.0,
            readings: Vec::new(),
            tune: Vec::new(),
            inject: Vec::new(),
        }
    }
}

/// Scale of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Linear.
    #[default]
    Linear,
    /// Logarithms of magnitudes.
    Log,
}

impl Scale {
    /// Returns the name in a scenario.
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
