//! `[bus]`.

use super::{Key, KeyKind, TEXT, integer_or, number};

/// `[bus]`.
pub(crate) const BUS: &[Key] = keys! {
    file: TEXT,
        "Port file, relative to the scenario, whose frames stand between plant and controller. Its media are not opened.";
    text: TEXT, "Text of the port file, in place of file; `hil config show` writes it.";
    dbc: KeyKind::Described, "Texts of the DBC files that text names, by their names.";
    redundancy: integer_or(1, 2, 1),
        "Number of networks. Each of two carries every frame with a sequence number; the first valid one wins.";
    skew_limit_s: number("s", 0.0, 1e9),
        "Time for which a received frame suppresses older and equal ones of the other network. Default: the period of the frame.";
};
