//! `[[plots]]` and `[panel]`.

use super::{Key, KeyKind, MAX_S, SectionKind, TEXT, choice, number, number_or};

/// `[[plots]]`; in addition the keys of the kind in [`PLOTS`].
pub(crate) const PLOT: &[Key] = keys! {
    title!: TEXT, "Title of the plot.";
    kind: KeyKind::Text { choices: &[], default: Some("time"), }, "Kind of plot.";
    name: TEXT, "Name of the files of `hil report --figures`: letters, digits, - and _. Default: from the title.";
    caption: TEXT, "Caption in the file of captions of `hil report --figures`. Default: the title.";
    laws: KeyKind::Texts,
        "Laws that the plot is for; it is omitted for other laws, so it may show signals that only these laws have. Default: all.";
};

const SIGNALS: Key = key! { signals!: KeyKind::Texts,
"Names of signals (truth.x, measured.x, .., or a derived signal) that share the axes of the plot." };

const FROM_S: Key = key! { from_s: number("s", 0.0, MAX_S), "First time that a figure shows. Default: the beginning of the run." };

const UNTIL_S: Key = key! { until_s: number("s", 0.0, MAX_S), "Last time that a figure shows. Default: the end of the run." };

const METRIC: Key = key! { metric: TEXT,
"Name of a metric of kind frequency-response. Default: the open loops in the file of `hil report --margins`." };

/// Kinds of plots.
pub(crate) const PLOTS: &[SectionKind] = kinds! {
    "time": "Signals over time." {
        ..SIGNALS;
        scale: choice(&["linear", "log"]), "Scale of the vertical axis; log shows magnitudes.";
        lines: KeyKind::Numbers, "Values drawn as horizontal lines, in the unit of the signals.";
        ..FROM_S;
        ..UNTIL_S;
    }
    "xy": "Signals over another signal." {
        x!: TEXT, "Name of the signal on the horizontal axis.";
        ..SIGNALS;
        ..FROM_S;
        ..UNTIL_S;
    }
    "spectrum": "Spectra of signals, without their means, over a logarithmic axis of frequency." {
        ..SIGNALS;
        quantity: choice(&["amplitude", "density"]),
            "amplitude: a sine of amplitude a has a line of height a. density: amplitude spectral density, in the unit of the signal per root hertz.";
        window: choice(&["hann", "flat-top", "rectangular"]), "Window by which each segment is multiplied.";
        resolution_hz: number("Hz", 1e-9, 1e6),
            "Distance of frequencies; the squares of segments of its inverse length, each overlapping half of the one before, are averaged. Default: one segment for amplitudes, eight lengths in the time shown for densities.";
        scale: choice(&["log", "linear"]), "Scale of the vertical axis.";
        ..FROM_S;
        ..UNTIL_S;
    }
    "bode": "Gain and phase over frequency." {
        ..METRIC;
    }
    "nichols": "Gain over phase." {
        ..METRIC;
    }
};

/// `[panel]`.
pub(crate) const PANEL: &[Key] = keys! {
    window_s: number_or("s", 1e-6, 86_400.0, 5.0),
        "Initial width of the time axis, in simulated time; `--window` overrides it.";
    readings: KeyKind::Texts,
        "Signals whose newest values are shown beside the plots: names, or patterns with * and ?. Default: the first of the plots.";
    tune: KeyKind::Texts,
        "Keys that have a slider, as `hil get --tunable` lists them: names, or patterns with * and ?. Default: all.";
    inject: KeyKind::Texts,
        "Faults that have a button, each written as for `hil inject`; those of `--inject` come first. Default: none.";
};
