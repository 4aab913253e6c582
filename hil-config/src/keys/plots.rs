//! `[[plots]]` and `[panel]`.

use super::{Key, KeyKind, TEXT, choice, number_or};

/// `[[plots]]`.
pub(crate) const PLOT: &[Key] = keys! {
    title!: TEXT, "Title of the plot.";
    signals!: KeyKind::Texts,
        "Names of signals (truth.x, measured.x, .., or a derived signal) that share the axes of the plot.";
    laws: KeyKind::Texts,
        "Laws that the plot is for; it is omitted for other laws, so it may show signals that only these laws have. Default: all.";
    scale: choice(&["linear", "log"]), "Scale of the vertical axis; log shows magnitudes.";
    lines: KeyKind::Numbers, "Values drawn as horizontal lines, in the unit of the signals.";
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
