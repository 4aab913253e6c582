//! Chart: curves in one or two panels over a shared axis, with limits and marks, and the styles of its lines.
//!
//! Curves differ by colour and by dash. Never reads a recording and draws nothing.

use shared_types::extremes::larger;

use super::axis::{Extent, Quantity};
use super::scene::{Colour, Stroke};

/// Sizes of texts in points: titles of axes, and ticks and legend.
pub(super) const TITLE_SIZE: f64 = 7.5;
pub(super) const TEXT_SIZE: f64 = 7.0;
/// Distance of base lines.
pub(super) const LEADING: f64 = 9.0;
/// Colours of Okabe and Ito (2008), which the colour-blind tell apart, in an order of decreasing contrast to white,
/// each with its own dash.
const STYLES: [(Colour, &[f64]); 6] = [
    ([0x00, 0x72, 0xb2], &[]),
    ([0xd5, 0x5e, 0x00], &[4.0, 1.6]),
    ([0x00, 0x9e, 0x73], &[5.0, 1.6, 1.2, 1.6]),
    ([0xcc, 0x79, 0xa7], &[1.2, 1.2]),
    ([0x00, 0x00, 0x00], &[8.0, 2.0]),
    ([0xe6, 0x9f, 0x00], &[5.0, 1.4, 1.2, 1.4, 1.2, 1.4]),
];
/// Number of distinct styles.
pub(super) const MOST_CURVES: usize = STYLES.len();
pub(super) const LIMIT: Stroke = Stroke {
    colour: [0x55; 3],
    width: 0.7,
    dash: &[1.6, 1.6],
};
/// Largest growth of an axis for a limit: beyond it the limit is left out and named.
const MOST_GROWTH: f64 = 3.0;

/// Line of a chart.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Curve {
    /// Text of the legend; empty for none.
    pub(super) label: String,
    pub(super) parts: Vec<Vec<[f64; 2]>>,
    /// `true` if the curve may go back along the horizontal axis.
    pub(super) is_free: bool,
}

/// Level of a requirement, or one that the scenario draws.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Level {
    pub(super) value: f64,
    /// Part of the horizontal axis.
    pub(super) span: [f64; 2],
    /// Requirement that sets it; `None` for a line of the scenario.
    pub(super) requirement: Option<String>,
}

/// Panel of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Panel {
    pub(super) y: Quantity,
    pub(super) curves: Vec<Curve>,
    pub(super) levels: Vec<Level>,
    /// Point that is marked by a cross.
    pub(super) cross: Option<[f64; 2]>,
    /// Least length of the vertical axis.
    pub(super) least_length: f64,
}

/// Chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Chart {
    pub(super) title: String,
    pub(super) x: Quantity,
    /// Range of the horizontal axis, without room beside it; `None` for that of the curves with room.
    pub(super) span: Option<[f64; 2]>,
    /// Least length of the horizontal axis.
    pub(super) least_length: f64,
    pub(super) panels: Vec<Panel>,
    /// Vertical lines with their labels.
    pub(super) marks: Vec<(f64, String)>,
    /// Texts under the legend.
    pub(super) notes: Vec<String>,
}

/// Returns the line of a curve.
pub(super) fn stroke(place: usize) -> Stroke {
    let (colour, dash) = STYLES[place % STYLES.len()];
    Stroke {
        colour,
        width: 0.9,
        dash,
    }
}

impl Panel {
    /// Returns the extent of the curves and of what is drawn with them, and the requirements whose limits are too far
    /// away.
    pub(super) fn extent(&self, span: Option<[f64; 2]>) -> (Extent, Vec<&Level>) {
        let mut extent = Extent::EMPTY;
        let is_inside = |x: f64| span.is_none_or(|[from, until]| (from..=until).contains(&x));
        let points = self
            .curves
            .iter()
            .flat_map(|curve| curve.parts.iter().flatten());
        for [_, y] in points.filter(|[x, _]| is_inside(*x)) {
            match self.y.is_log {
                true if *y == 0.0 => {}
                true => extent.include(y.abs()),
                false => extent.include(*y),
            }
        }
        for y in self.cross.iter().map(|[_, y]| *y) {
            extent.include(y);
        }
        let mut far = Vec::new();
        for level in &self.levels {
            let mut with = extent;
            with.include(level.value);
            let is_far = level.requirement.is_some()
                && !extent.is_empty()
                && !self.y.is_log
                && with.length() > MOST_GROWTH * larger(extent.length(), 1e-300);
            let is_unseen = self.y.is_log && level.value <= 0.0;
            match is_far || is_unseen {
                true => far.push(level),
                false => extent = with,
            }
        }
        extent.lengthen(self.least_length);
        (extent, far)
    }
}
