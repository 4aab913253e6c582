//! `[[plots]]`.

use super::{Key, Kind, TEXT};

/// `[[plots]]`.
pub(crate) const PLOT: &[Key] = &[
    Key::new("title", TEXT, "What it shows; its heading.").required(),
    Key::new(
        "signals",
        Kind::Texts,
        "Names of signals (truth.x, measured.x, .., or a derived one) that share its axes.",
    )
    .required(),
    Key::new(
        "laws",
        Kind::Texts,
        "The laws that it is for; with others it is left out, so that it may show what only these have. Default: all.",
    ),
    Key::new(
        "scale",
        Kind::Text {
            choices: &["linear", "log"],
            default: Some("linear"),
        },
        "Scale of its vertical axis; log shows magnitudes.",
    ),
    Key::new(
        "lines",
        Kind::Numbers,
        "Values that are drawn as level lines, in the unit of the signals.",
    ),
];
