//! `[[plots]]` and `[panel]`.

use super::{Key, KeyKind, TEXT, number_or};

/// `[[plots]]`.
pub(crate) const PLOT: &[Key] = &[
    Key::new("title", TEXT, "What it shows; its heading.").required(),
    Key::new(
        "signals",
        KeyKind::Texts,
        "Names of signals (truth.x, measured.x, .., or a derived one) that share its axes.",
    )
    .required(),
    Key::new(
        "laws",
        KeyKind::Texts,
        "The laws that it is for; with others it is left out, so that it may show what only these have. Default: all.",
    ),
    Key::new(
        "scale",
        KeyKind::Text {
            choices: &["linear", "log"],
            default: Some("linear"),
        },
        "Scale of its vertical axis; log shows magnitudes.",
    ),
    Key::new(
        "lines",
        KeyKind::Numbers,
        "Values that are drawn as level lines, in the unit of the signals.",
    ),
];

/// `[panel]`.
pub(crate) const PANEL: &[Key] = &[
    Key::new(
        "window_s",
        number_or("s", 1e-6, 86_400.0, 5.0),
        "Width of the time axis to begin with, in simulated time; `--window` goes before it.",
    ),
    Key::new(
        "readings",
        KeyKind::Texts,
        "Signals whose newest values stand beside the plots: names, or patterns with * and ?. Default: the first of the plots.",
    ),
    Key::new(
        "tune",
        KeyKind::Texts,
        "Keys that have a slider, as `hil get --tunable` lists them: names, or patterns with * and ?. Default: all.",
    ),
    Key::new(
        "inject",
        KeyKind::Texts,
        "Faults that have a button, each with the words of `hil inject`; those of `--inject` come first. Default: none.",
    ),
];
