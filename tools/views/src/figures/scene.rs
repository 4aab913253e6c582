//! Scene of a figure: lines and texts at places in points, before they become SVG or PDF.
//!
//! The origin is the upper left corner and `y` points down, as in SVG. Knows nothing of signals and no file format.

use super::font::Font;

/// Points in a millimetre.
pub(crate) const POINTS_PER_MM: f64 = 72.0 / 25.4;

/// Colour as red, green and blue.
pub(super) type Colour = [u8; 3];

/// Colour of texts and frames.
pub(super) const BLACK: Colour = [0; 3];

/// Rectangle by its left, top, right and bottom edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rect {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

/// Style of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    pub(super) colour: Colour,
    /// Width in points.
    pub(super) width: f64,
    /// Lengths of dashes and gaps in points; empty for a solid line.
    pub(super) dash: &'static [f64],
}

/// Part of a text's line at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    /// Beginning.
    Start,
    /// Middle.
    Middle,
    /// End.
    End,
}

/// Text on one line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    pub(super) text: String,
    /// Place of the anchor on the base line.
    pub(super) at: [f64; 2],
    /// Size of the font in points.
    pub(super) size: f64,
    pub(super) anchor: Anchor,
    /// `true` if the text reads upwards.
    pub(super) is_upright: bool,
}

/// Line of one or several parts.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Line {
    pub(super) parts: Vec<Vec<[f64; 2]>>,
    pub(super) stroke: Stroke,
    /// `true` if only the part inside the panel of the same number is visible.
    pub(super) clip: Option<usize>,
}

/// Element of a scene.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    /// Line.
    Line(Line),
    /// Text.
    Text(Text),
}

/// Scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Scene {
    /// Title for readers that do not see.
    pub(super) title: String,
    /// Width and height in points.
    pub(super) size: [f64; 2],
    /// Rectangles by which lines are clipped.
    pub(super) panels: Vec<Rect>,
    pub(super) items: Vec<Item>,
}

impl Scene {
    pub(super) fn line(&mut self, points: &[[f64; 2]], stroke: Stroke) {
        self.items.push(Item::Line(Line {
            parts: vec![points.to_vec()],
            stroke,
            clip: None,
        }));
    }

    pub(super) fn text(&mut self, text: &str, at: [f64; 2], size: f64, anchor: Anchor) {
        self.items.push(Item::Text(Text {
            text: text.to_owned(),
            at,
            size,
            anchor,
            is_upright: false,
        }));
    }

    /// Returns the texts.
    pub(super) fn texts(&self) -> impl Iterator<Item = &Text> {
        self.items.iter().filter_map(|item| match item {
            Item::Text(text) => Some(text),
            Item::Line(_) => None,
        })
    }
}

impl Text {
    /// Returns the place at which the text begins.
    pub(super) fn start(&self, font: &Font) -> [f64; 2] {
        let width = font.width(&self.text, self.size);
        let back = match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5 * width,
            Anchor::End => width,
        };
        let [x, y] = self.at;
        match self.is_upright {
            true => [x, y + back],
            false => [x - back, y],
        }
    }
}
