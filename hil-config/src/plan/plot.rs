//! Plots of signals.

/// Plot of signals or of a response. No run depends on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Kind.
    pub kind: PlotKind,
    /// Name of the figure's files; `None` for one from the title.
    pub name: Option<String>,
    /// Caption of the figure; `None` for the title.
    pub caption: Option<String>,
    /// Signals as expressions name them; none in plots of a response, at least one in others.
    pub signals: Vec<String>,
    /// First and last time in s that a figure shows; `None` for the beginning and the end of the run.
    pub span_s: [Option<f64>; 2],
    /// Laws for which the plot is meant; empty means all. Only these laws are known to have its signals.
    pub laws: Vec<String>,
    /// Vertical axis.
    pub scale: Scale,
    /// Values of horizontal lines, in the unit of the signals.
    pub lines: Vec<f64>,
}

/// Kind of plot.
#[derive(Clone, Debug, PartialEq)]
pub enum PlotKind {
    /// Signals over time.
    Time,
    /// Signals over another one.
    Xy {
        /// Signal on the horizontal axis, as expressions name it.
        x: String,
    },
    /// Spectra of signals.
    Spectrum(SpectrumPlan),
    /// Gain and phase of a response over frequency.
    Bode {
        /// Frequency response among the metrics; `None` for measured open loops.
        metric: Option<String>,
    },
    /// Gain of a response over its phase.
    Nichols {
        /// Frequency response among the metrics; `None` for measured open loops.
        metric: Option<String>,
    },
}

impl PlotKind {
    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Xy { .. } => "xy",
            Self::Spectrum(_) => "spectrum",
            Self::Bode { .. } => "bode",
            Self::Nichols { .. } => "nichols",
        }
    }
}

/// Settings of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectrumPlan {
    /// Window by which each segment is multiplied.
    pub window: SpectralWindow,
    /// `true` for an amplitude spectral density, `false` for amplitudes.
    pub is_density: bool,
    /// Distance of frequencies in Hz; `None` for the usual one.
    pub resolution_hz: Option<f64>,
}

impl SpectrumPlan {
    /// Returns the name of the quantity in a scenario.
    #[must_use]
    pub const fn quantity(&self) -> &'static str {
        if self.is_density {
            "density"
        } else {
            "amplitude"
        }
    }
}

/// Window of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpectralWindow {
    /// Raised cosine: `0.5 - 0.5 cos(2 pi k / n)`.
    Hann,
    /// Five cosines whose main lobe is flat, for exact amplitudes.
    FlatTop,
    /// No window.
    Rectangular,
}

impl SpectralWindow {
    /// All windows.
    pub const ALL: [Self; 3] = [Self::Hann, Self::FlatTop, Self::Rectangular];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hann => "hann",
            Self::FlatTop => "flat-top",
            Self::Rectangular => "rectangular",
        }
    }
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
    /// Lists all signals that the plot reads.
    pub fn read_signals(&self) -> impl Iterator<Item = &String> {
        let x = match &self.kind {
            PlotKind::Xy { x } => Some(x),
            _ => None,
        };
        x.into_iter().chain(&self.signals)
    }

    /// Returns `true` if the plot is meant for a law.
    #[must_use]
    pub fn is_for(&self, law: &str) -> bool {
        self.laws.is_empty() || self.laws.iter().any(|one| one == law)
    }
}
