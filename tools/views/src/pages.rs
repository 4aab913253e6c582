//! Scripts and styles shared by all pages with plots: zoom and pan, cursors, the list of everything, and reading a part
//! of a run. Nothing here knows a session or a recording.

/// Scripts for looking closer, in order, behind those of numbers and axes.
pub(crate) const CLOSER: [&str; 4] = [
    include_str!("pages/assets/zoom.js"),
    include_str!("pages/assets/lens.js"),
    include_str!("pages/assets/cursors.js"),
    include_str!("pages/assets/palette.js"),
];
/// Their style.
pub(crate) const CLOSER_STYLE: &str = include_str!("pages/assets/closer.css");
