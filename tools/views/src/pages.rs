//! Scripts, styles and controls shared by all pages with plots: curves and events, zoom and pan, cursors, the list of
//! everything, and reading a part of a run. Nothing here knows a session or a recording.

use maud::{Markup, html};

/// Scripts for looking closer, in order, behind those of numbers and axes.
pub(crate) const CLOSER: [&str; 4] = [
    include_str!("pages/assets/plot.js"),
    include_str!("pages/assets/zoom.js"),
    include_str!("pages/assets/cursors.js"),
    include_str!("pages/assets/palette.js"),
];
/// Script that reads a part of a run from a server.
pub(crate) const LENS: &str = include_str!("pages/assets/lens.js");
/// Style of what [`CLOSER`] shows.
pub(crate) const CLOSER_STYLE: &str = include_str!("pages/assets/closer.css");

/// Renders the fields of the range in sight.
pub(crate) fn range_fields() -> Markup {
    html! {
        label { "From " input #from .time inputmode="decimal" autocomplete="off"; }
        label { "to " input #to .time inputmode="decimal" autocomplete="off"; " s" }
        button #whole type="button" title="Home" { "Whole run" }
    }
}

/// Renders the drawer with the figures at the cursors and between them.
pub(crate) fn drawer() -> Markup {
    html! {
        section #measure aria-label="Cursors" hidden {
            div.row {
                label { "A " input #cursor-a .time inputmode="decimal" title="a" autocomplete="off"; }
                label { "B " input #cursor-b .time inputmode="decimal" title="b" autocomplete="off" placeholder="-"; " s" }
                span #gap .n {}
                button #copy-figures type="button" { "Copy table" }
                button #clear-cursors type="button" title="c" { "Clear" }
                span #basis .hint {}
            }
            div.scroll tabindex="0" role="region" aria-label="Figures" {
                table { thead #figures-head {} tbody #figures {} }
            }
            pre #copied hidden tabindex="0" aria-label="Copied text" {}
        }
    }
}
