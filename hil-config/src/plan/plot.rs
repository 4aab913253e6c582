//! Plots of signals.

/// Plot over simulated time. No run depends on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Signals as expressions name them, at least one.
    pub signals: Vec<String>,
    /// Laws for which the plot is meant; empty means all. Only these laws are known to have its signals.
    pub laws: Vec<String>,
    /// Vertical axis.
    pub scale: Scale,
    /// Values of horizontal lines, in the unit of the signals.
    pub lines: Vec<f64>,
}

/// Contents of a panel in addition to the plots. No run depends on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Width of the time axis in s.
    pub window_s: f64,
    /// Names and patterns of signals; empty means the signals of the first plots.
    pub readings: Vec<String>,
    /// Names and patterns of tunable keys; empty means all.
    pub tune: Vec<String>,
    /// Faults, each as an argument of `hil inject`.
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
    /// Returns `true` if the plot is meant for a law.
    #[must_use]
    pub fn is_for(&self, law: &str) -> bool {
        self.laws.is_empty() || self.laws.iter().any(|one| one == law)
    }
}
